#include "audit/lattice_audit.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>

#include "audit/case_audit.hpp"
#include "audit/lattice_family.hpp"
#include "audit/lattice_oracle.hpp"

namespace audit {

namespace {

/// Steps of a family that are taken again in one record, about.
constexpr std::size_t most_steps = 10;

class LatticeJudge {
public:
  LatticeJudge(const LatticeProblem& problem, const Stored& record, const Json& reported, Disagreements& findings)
      : problem_(problem), record_(record), oracle_(problem), levels_(problem.rules(), record, reported, findings) {}

  Roundings judge() {
    if (levels_.judge_levels()) {
      oracle_.set_slope(state("/states", 0));
      judge_nodes();
      if (problem_.is_family()) {
        judge_family();
      } else {
        for (std::size_t row = 1; row < levels_.stored_levels().size(); ++row) {
          judge_step(row);
        }
      }
      judge_exact();
      levels_.judge_told();
    }
    return levels_.roundings();
  }

private:
  /// Fields of midpoints only come from the row of the level after, and stand for both ends of the step.
  [[nodiscard]] LatticeState state(const std::string& group, std::size_t row) const {
    std::vector<std::vector<double>> fields;
    for (std::size_t f = 0; f < problem_.fields.size(); ++f) {
      fields.push_back(
          record_.row((problem_.midpoint_only[f] ? "/states/midpoints/" : group + "/") + problem_.fields[f], row));
    }
    return oracle_.state(fields);
  }

  void judge_nodes() {
    for (std::size_t row = 0; row < levels_.stored_levels().size(); ++row) {
      const std::size_t level = levels_.stored_levels()[row];
      const LatticeState z = state("/states", row);
      levels_.add_scale(oracle_.magnitude_of_terms(z));
      levels_.compare("node energy", record_["/levels/node_energy"][level], oracle_.node_energy(z), level,
                      levels_.roundings().node_energy);
      if (problem_.axes.size() == 1 && !problem_.differences &&
          problem_.lagrangian != LatticeProblem::Lagrangian::euler_box) {
        levels_.compare("total momentum", record_["/laws/totals/momentum"][level], oracle_.momentum(z), level,
                        levels_.roundings().invariants["momentum"]);
      }
    }
  }

  void judge_exact() {
    if (!problem_.exact) {
      return;
    }
    const std::string& name = problem_.fields[problem_.initial[0].first];
    const std::size_t last = levels_.stored_levels().size() - 1;
    const std::vector<double> field = record_.row("/states/" + name, last);
    const std::vector<double> stored = record_.row("/exact/" + name, last);
    std::vector<Bounded> differences;
    for (std::size_t node = 0; node < field.size(); ++node) {
      std::vector<Bounded> place;
      std::size_t rest = node;
      for (const Axis& axis : problem_.axes) {
        const long double x = axis.from + static_cast<long double>(rest % axis.cells) * axis.width();
        place.push_back({x, 2 * unit_roundoff * (std::abs(x) + std::abs(static_cast<long double>(axis.from)))});
        rest /= axis.cells;
      }
      place.push_back(Bounded::stored(levels_.t(levels_.stored_levels()[last])));
      const Bounded exact = (*problem_.exact)(std::span<const Bounded>(place));
      levels_.compare("exact solution", stored[node], exact, node, levels_.roundings().errors[name]);
      differences.push_back(Bounded::stored(field[node]) - exact);
    }
    levels_.judge_error(name, differences);
  }

  [[nodiscard]] LatticeState state_before(std::size_t row) const {
    return problem_.every > 1 ? state("/states/previous", row) : state("/states", row - 1);
  }

  /// Some of the steps of a family, taken again; and all that are flagged.
  void judge_family() {
    const LatticeFamily family(problem_, oracle_);
    const std::size_t rows = levels_.stored_levels().size(), stride = 1 + rows / most_steps;
    for (std::size_t row = 1; row < rows; ++row) {
      const std::size_t k = levels_.stored_levels()[row] - 1;
      if (row % stride > 1 && !levels_.flagged(k)) {
        continue;
      }
      const LatticeState before = state_before(row), after = state("/states", row);
      const FamilyStep step = family.step(before, levels_.h(k));
      levels_.judge_energy(k, step.energy);
      if (k == 0 && problem_.every == 1) {
        const Bounded mean = Bounded(0.5L) * (oracle_.node_energy(before) + oracle_.node_energy(after));
        // A look-ahead solves its steps to 1e-5.
        levels_.judge_strength(step.energy - mean, 1e-3L, oracle_.magnitude_of_terms(before));
      }
      const LatticeState reached = oracle_.means(after);
      std::vector<Bounded> worst;
      for (std::size_t f = 0; f < reached.size(); ++f) {
        Values defects;
        for (std::size_t i = 0; i < reached[f].size(); ++i) {
          defects.push_back(reached[f][i] - step.end[f][i]);
        }
        worst.push_back(worst_of(defects));
      }
      levels_.judge_equation(worst, k);
      if (!step.places.empty()) {
        judge_law("energy", oracle_.energy_law(before, after, levels_.h(k), step.places), row, k);
        if (problem_.axes.size() == 1) {
          judge_law("momentum", oracle_.momentum_law(before, after, levels_.h(k), step.places), row, k);
        }
      }
    }
  }

  void judge_step(std::size_t row) {
    const std::size_t k = levels_.stored_levels()[row] - 1;
    LatticeState before = state_before(row);
    const LatticeState after = state("/states", row);
    for (std::size_t f = 0; f < before.size(); ++f) {
      before[f] = problem_.midpoint_only[f] ? after[f] : before[f];
    }
    levels_.judge_energy(k, oracle_.energy(before, after));
    const LatticeState rows = oracle_.residual(before, after, levels_.h(k));
    std::vector<Bounded> worst;
    for (const Values& values : rows) {
      worst.push_back(worst_of(values));
    }
    levels_.judge_equation(worst, k);
    if (problem_.lagrangian == LatticeProblem::Lagrangian::euler_box) {
      return;
    }
    judge_law("energy", oracle_.energy_law(before, after, levels_.h(k)), row, k);
    if (problem_.axes.size() == 1) {
      judge_law("momentum", oracle_.momentum_law(before, after, levels_.h(k)), row, k);
    }
  }

  /// One equation couples all cells: what is rounding in one of them is rounding in all.
  static Bounded worst_of(const Values& values) {
    Bounded worst;
    for (const Bounded& value : values) {
      worst.value =
          std::abs(value.value) > worst.value || std::isnan(value.value) ? std::abs(value.value) : worst.value;
      worst.error = std::max(worst.error, value.error);
    }
    return worst;
  }

  void judge_law(const std::string& name, const Values& law, std::size_t row, std::size_t k) {
    const long double limit = evaluations * worst_of(law).error;
    const std::vector<double> stored = record_.row("/laws/fields/" + name, row);
    long double off = 0.0L, largest = 0.0L, squares = 0.0L;
    for (std::size_t i = 0; i < law.size(); ++i) {
      off = std::max(off, std::abs(law[i].value - stored[i]));
      largest = std::max(largest, std::abs(law[i].value));
      squares += law[i].value * law[i].value;
    }
    const auto reported = [&](const char* what, long double difference) {
      levels_.findings().within("local " + name, difference, limit, [&] {
        return fmt::format("step {}: {} is off by {:.2g} in place of {:.2g}, in a residual of {:.2g}", k, what,
                           static_cast<double>(difference), static_cast<double>(limit), static_cast<double>(largest));
      });
    };
    reported("the field", off);
    reported("its largest value", std::abs(record_["/laws/" + name + "_max"][k] - largest));
    reported("its rms", std::abs(record_["/laws/" + name + "_rms"][k] -
                                 std::sqrt(squares / static_cast<long double>(law.size()))));
  }

  const LatticeProblem& problem_;
  const Stored& record_;
  LatticeOracle oracle_;
  LevelsJudge levels_;
};

Case case_of(const LatticeProblem& problem) {
  return {
      .problem = problem.toml(),
      .rules = problem.rules(),
      .max_steps = problem.max_steps,
      .shifted =
          [&problem](double constant) {
            double volume = 1.0;
            for (const Axis& axis : problem.axes) {
              volume *= axis.length();
            }
            LatticeProblem shifted = problem;
            shifted.S = shifted.S + constant / volume;
            return shifted.toml();
          },
      .judge = [&problem](const Stored& record, const Json& reported,
                          Disagreements& found) { return judge_lattice(problem, record, reported, found); },
  };
}

}  // namespace

Roundings judge_lattice(const LatticeProblem& problem, const Stored& record, const Json& reported,
                        Disagreements& findings) {
  return LatticeJudge(problem, record, reported, findings).judge();
}

void audit_lattice(const std::string& program, std::uint64_t number, Disagreements& findings) {
  const LatticeProblem problem = random_lattice(number);
  audit_case(program, case_of(problem), findings);
}

namespace {

struct Twin {
  const char* kind;
  std::string path;
  std::size_t place;
  double factor;
};

/// How many twins of the first random lattice that is `right` are taken for good, and of the findings where there is
/// nothing to find.
template <typename Right>
int missed_of(const std::string& program, const Right& right, std::vector<Twin> twins) {
  std::uint64_t number = 0;
  LatticeProblem problem = random_lattice(number);
  while (problem.axes.size() != 1 || problem.every != 1 || problem.fixed || problem.potential || !right(problem)) {
    problem = random_lattice(++number);
  }
  const Folder folder;
  write_text(folder.path() / "p.toml", problem.toml());
  const Json reported = parse_json(call(program, {"run", "p.toml", "--json", "-o", "p.h5"}, folder.path()).output);
  const Stored record = read_record(folder.path() / "p.h5");
  twins.push_back({"step equation", "/states/" + problem.fields[0], problem.nodes() + 2, 1 + 1e-11});
  twins.push_back({"local energy", "/laws/fields/energy", problem.nodes() + 1, 1.001});
  twins.push_back({"local momentum", "/laws/fields/momentum", problem.nodes() + 1, 1.001});
  int missed = 0;
  for (const Twin& twin : twins) {
    Stored damaged = record;
    double& value = damaged.datasets.at(twin.path).at(twin.place);
    value *= twin.factor;
    value += std::string(twin.kind).find("o") == 1 ? 1e-9 : 0.0;  // local laws and totals may be 0 to rounding
    Disagreements found;
    judge_lattice(problem, damaged, reported, found);
    if (!found.has(twin.kind)) {
      fmt::print("FAILED: lattice {}: a record with a wrong {} was taken for good\n", number, twin.path);
      ++missed;
    }
  }
  Disagreements none;
  judge_lattice(problem, record, reported, none);
  for (const auto& [kind, text] : none.list) {
    fmt::print("FAILED: lattice {}, undamaged: {}: {}\n", number, kind, text);
    ++missed;
  }
  return missed;
}

}  // namespace

int lattice_twins(const std::string& program) {
  // Box in a line, with every kind of figure in the record; and families with a step potential.
  const std::vector<Twin> of_all = {
      {"step equation", "/levels/h", 0, 1 + 1e-11},
      {"stored energy", "/levels/energy", 0, 1 + 1e-11},
      {"node energy", "/levels/node_energy", 4, 1 + 1e-11},
      {"total momentum", "/laws/totals/momentum", 4, 1.001},
      {"local energy", "/laws/energy_max", 0, 1.001},
      {"local energy", "/laws/energy_rms", 0, 1.001},
      {"times", "/levels/t", 4, 1 + 1e-12},
  };
  std::vector<Twin> of_families = of_all;
  of_families.push_back({"step potential", "/levels/step_potential", 4, 1 + 1e-12});
  using Lagrangian = LatticeProblem::Lagrangian;
  const auto box = [](const LatticeProblem& problem) {
    return problem.lagrangian == Lagrangian::box && !problem.has_step_potential() && problem.on_singular.empty();
  };
  const auto stages = [](const LatticeProblem& problem) { return problem.stages > 2 && problem.has_step_potential(); };
  const auto splitting = [](const LatticeProblem& problem) {
    return problem.lagrangian == Lagrangian::splitting && !problem.differences && problem.has_step_potential();
  };
  return missed_of(program, box, of_all) + missed_of(program, stages, of_families) +
         missed_of(program, splitting, of_families);
}

}  // namespace audit
