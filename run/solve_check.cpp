#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/solve.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/run/conclusion.hpp>
#include <rubato/run/disagreements.hpp>
#include <rubato/run/solution_measures.hpp>
#include <rubato/run/solution_rows.hpp>
#include <rubato/run/solve.hpp>

namespace rubato {

namespace {

/// The nodes and levels of a record, and its step potential.
BoundaryValueSolution stored_solution(const record::Reader& reader, const Problem& problem) {
  const std::size_t n = problem.hamiltonian()->q.size();
  StoredRows q(reader, "/states/q", n), p(reader, "/states/p", n), h(reader, "/levels/h");
  if (q.rows() != p.rows() || h.rows() + 1 != q.rows()) {
    throw record::Error(reader.file(),
                        fmt::format("it has {} states and {} steps, which do not fit together", q.rows(), h.rows()));
  }
  BoundaryValueSolution solution{.orbit = {.dimension = 2 * n, .z = {}, .h = {}}};
  for (std::size_t k = 0; k < q.rows(); ++k) {
    for (StoredRows* part : {&q, &p}) {
      const std::span<const double> row = part->row(k);
      solution.orbit.z.insert(solution.orbit.z.end(), row.begin(), row.end());
    }
    if (k < h.rows()) {
      solution.orbit.h.push_back(h.at(k));
    }
  }
  const std::vector<double> potential = reader.read(solution_potential);
  if (potential.size() != 3) {
    throw record::Error(reader.file(), fmt::format("{} has to be three numbers", solution_potential));
  }
  solution.potential = {.strength = potential[0], .length = potential[1], .exponent = potential[2]};
  StoredRows target(reader, "/levels/target");
  solution.conserved = target.at(0);
  return solution;
}

class SolutionCheck {
public:
  SolutionCheck(const record::Reader& reader, const Problem& problem) : reader_(reader), problem_(problem) {}

  Outcome run() {
    const Hamiltonian hamiltonian = make_hamiltonian(problem_);
    EndConditions ends = problem_.solve->ends == StatedSolve::Ends::symmetric
                             ? EndConditions::periodic(hamiltonian)
                             : make_end_conditions(problem_, hamiltonian);
    const BoundaryValueSolution stored = stored_solution(reader_, problem_);
    BoundaryValueSolution found = boundary_value_residual(hamiltonian, std::move(ends), stored.orbit, stored.potential,
                                                          make_boundary_value_options(problem_));
    findings_.count(1);
    if (!found.found()) {
      findings_.add({.dataset = "/states",
                     .recomputed = found.residual,
                     .tolerance = problem_.solve->tolerance,
                     .reason = fmt::format("what the states and levels leave of {}", found.worst)});
    }
    if (found.energy.size() == stored.orbit.segments()) {
      compare(SolutionRows(problem_, found));
    }
    return outcome(SolutionRows(problem_, found), found, check_measures(found));
  }

private:
  void compare(const SolutionRows& rows) {
    const double energy = Rounding::roundings * rows.rounding;
    column("/levels/t", rows.t, [](double t) { return Rounding::unit * std::abs(t); });
    column("/levels/node_energy", rows.node_energy, [=](double) { return energy; });
    column("/levels/energy", rows.energy, [=](double) { return energy; });
    column("/levels/target", std::vector<double>(rows.h.size(), reader_.read("/levels/target", 0, 1).front()),
           [](double) { return 0.0; });
    if (reader_.has("/levels/step_potential")) {
      column("/levels/step_potential", rows.potential, [](double f) { return Rounding::unit * std::abs(f); });
    }
    check_velocities(rows.q_dot);
    for (std::size_t i = 0; i < rows.invariant_names.size(); ++i) {
      column("/laws/" + rows.invariant_names[i], rows.invariants[i],
             [](double value) { return Rounding::unit * std::abs(value); });
    }
  }

  /// Those of the verdict, from the orbit; but whether it rests where the guess moves is what the record says. A record
  /// of an earlier version has none.
  figures::Measures check_measures(const BoundaryValueSolution& found) {
    const std::string path(figures::measures_path);
    const figures::Measures stored = reader_.has(path) ? figures::measures_of(reader_.read(path)) : figures::Measures{};
    if (!found.found()) {
      return stored;
    }
    const figures::Measures recomputed = measure_solution(problem_, found.orbit, stored.rest == 1.0).measures;
    constexpr double errors_of_newton = 1e-6;
    const std::vector<double> was = figures::to_values(stored), is = figures::to_values(recomputed);
    for (std::size_t i = 0; i < is.size() && reader_.has(path); ++i) {
      findings_.compare(
          path, i, {}, was[i], is[i], [&] { return errors_of_newton * (1.0 + std::abs(is[i])); },
          "from the states and the conditions");
    }
    return recomputed;
  }

  void check_velocities(const std::vector<double>& recomputed) {
    if (recomputed.empty()) {
      return;
    }
    const std::size_t n = problem_.hamiltonian()->q.size();
    StoredRows stored(reader_, "/states/q_dot", n);
    const auto size = [](double largest, double value) { return std::max(largest, std::abs(value)); };
    const double scale = std::accumulate(recomputed.begin(), recomputed.end(), 0.0, size);
    for (std::size_t place = 0; place < recomputed.size(); ++place) {
      findings_.compare(
          stored.path(), place / n, place % n, stored.row(place / n)[place % n], recomputed[place],
          [&] { return Rounding::unit * scale; }, "from the states");
    }
  }

  template <typename Tolerance>
  void column(const std::string& path, const std::vector<double>& recomputed, const Tolerance& tolerance) {
    StoredRows stored(reader_, path);
    if (stored.rows() != recomputed.size()) {
      throw figures::Mismatch(
          reader_.file(), path,
          fmt::format("{} rows are stored, and the states make {}", stored.rows(), recomputed.size()));
    }
    for (std::size_t k = 0; k < recomputed.size(); ++k) {
      findings_.compare(
          path, k, {}, stored.at(k), recomputed[k], [&] { return tolerance(recomputed[k]); }, "from the states");
    }
  }

  Outcome outcome(const SolutionRows& rows, const BoundaryValueSolution& found, const figures::Measures& measures) {
    Outcome result;
    result.title = problem_.title;
    result.file = reader_.file().string();
    result.variable_levels = problem_.scheme.levels == Levels::variable;
    result.complete = true;
    result.statistics = rows.statistics(found);
    result.statistics.measures = measures;
    Spread residual;
    residual.add(found.residual);
    result.statistics.residuals.push_back({"stationarity", residual});
    result.judgement = figures::judge(result.statistics);
    conclude(reader_, findings_, result);
    return result;
  }

  const record::Reader& reader_;
  const Problem& problem_;
  Disagreements findings_;
};

}  // namespace

bool is_solution(const record::Reader& reader) {
  return reader.has(solution_history);
}

Outcome check_solution(const record::Reader& reader) {
  const Problem problem = stored_problem(reader);
  if (problem.solve == nullptr) {
    throw record::Error(reader.file(), "its problem has no [solve], and it has the history of a solution");
  }
  return SolutionCheck(reader, problem).run();
}

}  // namespace rubato
