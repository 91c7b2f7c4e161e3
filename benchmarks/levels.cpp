// The tables of docs/performance-tables.md: equal steps, the levels of the pure law where they all exist, those with a
// step potential, and Gauss collocation that keeps H at equal steps (peers/energy_preserving_gauss.hpp), on the same
// orbits. Prints Markdown.
//
//     build/benchmarks/benchmark_levels [repeats]
//
// evaluations   of the gradient or Hessian, at all stages of a step at once; the look-ahead's are not counted
// off the law   steps that do not meet the law of their row; for the rival those for which no α was found
// H off by      max |H(z_k) - H(z_0)| over the levels
// position      median over time of the distance max_i |q_i - q_i(t_k)| from the true orbit at the levels' own times,
//               over the last 2 % of the run
// equal H,      evaluations that errors as large as those of equal steps would take, in units of what these take, by
// position      evaluations ~ 1/h and errors ~ h^s; of position after a tenth of the run, where it is still small;
//               nothing where it is not, or where errors are rounding
// CPU           least of the repeats, without the first step, which has the look-ahead; in units of equal steps
//
// First it checks the rival, and itself fails if that is not what it is to be.
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <tuple>
#include <vector>

#include <fmt/format.h>
#include <Eigen/Dense>

#include <rubato/ode/gauss_scheme.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/problem/lattice_problem.hpp>

#include "peers/cpu_clock.hpp"
#include "peers/energy_preserving_gauss.hpp"

namespace {

using namespace rubato;
using peers::cpu_seconds;
using Kind = StepPotentialChoice::Kind;

struct Case {
  std::string name;
  Hamiltonian hamiltonian;
  std::vector<double> q, p;
  double step, until;
  SegmentLagrangian scheme = Midpoint{};

  [[nodiscard]] std::vector<double> start() const {
    std::vector<double> z = q;
    z.insert(z.end(), p.begin(), p.end());
    return z;
  }
};

Hamiltonian pendulum() {
  return {{"q"}, {"p"}, "p^2/2 - cos(q)"};
}
Hamiltonian double_well() {
  return {{"q"}, {"p"}, "p^2/2 + (q^4 - q^2)/2"};
}

/// From the pericentre, for a hundred revolutions; the step is a tenth of the time scale there.
Case kepler(std::string name, double e, SegmentLagrangian scheme, double part) {
  return {.name = std::move(name),
          .hamiltonian = {{"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)"},
          .q = {1.0 - e, 0.0},
          .p = {0.0, std::sqrt((1.0 + e) / (1.0 - e))},
          .step = part * std::pow(1.0 - e, 1.5),
          .until = 200.0 * std::numbers::pi,
          .scheme = scheme};
}

/// The levels of a run: t and z = (q, p).
struct Levels {
  std::vector<double> t, z;

  void add(double time, std::span<const double> state) {
    t.push_back(time);
    z.insert(z.end(), state.begin(), state.end());
  }
  [[nodiscard]] std::span<const double> at(std::size_t k) const {
    const std::size_t size = z.size() / t.size();
    return {z.data() + k * size, size};
  }
};

/// The true orbit: Gauss collocation of order 16, from the nearest of its levels to the time asked for.
class TrueOrbit {
public:
  TrueOrbit(const Case& problem, double step)
      : scheme_(make_gauss_scheme(problem.hamiltonian, 8, problem.start())), step_(step) {
    for (long k = 0; static_cast<double>(k) * step <= problem.until + step; ++k) {
      levels_.add(static_cast<double>(k) * step, scheme_->state());
      advance(step);
    }
  }

  [[nodiscard]] std::vector<double> at(double t) {
    const auto k = static_cast<std::size_t>(std::lround(t / step_));
    scheme_->restart(levels_.at(k));
    if (const double rest = t - levels_.t[k]; rest != 0.0) {
      advance(rest);
    }
    return {scheme_->state().begin(), scheme_->state().end()};
  }

private:
  void advance(double h) {
    if (scheme_->advance(h, 0.0) != Status::success) {
      std::fprintf(stderr, "the reference was not found\n");
      std::exit(1);
    }
    scheme_->accept();
  }

  std::unique_ptr<OneStepScheme> scheme_;
  double step_;
  Levels levels_;
};

double distance(std::span<const double> a, std::span<const double> b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size() / 2; ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]));
  }
  return largest;
}

/// Median over time of the distance of levels from the true orbit, between two times.
double position_error(const Levels& levels, TrueOrbit& truth, double from, double to) {
  struct Part {
    double error, weight;
  };
  std::vector<Part> parts;
  double all = 0.0;
  for (std::size_t k = 1; k < levels.t.size(); ++k) {
    if (levels.t[k] >= from && levels.t[k] <= to) {
      const double weight = levels.t[k] - levels.t[k - 1];
      parts.push_back({distance(levels.at(k), truth.at(levels.t[k])), weight});
      all += weight;
    }
  }
  std::ranges::sort(parts, {}, &Part::error);
  double sum = 0.0;
  for (const Part& part : parts) {
    sum += part.weight;
    if (sum >= 0.5 * all) {
      return part.error;
    }
  }
  return std::numeric_limits<double>::quiet_NaN();
}

struct Row {
  std::string levels;
  std::size_t steps = 0, off = 0;
  long evaluations = 0;
  double energy = 0.0, cpu = 0.0;
  /// At the end, and after a tenth of the run.
  double position = std::numeric_limits<double>::quiet_NaN(), early = position;
  double ended = std::numeric_limits<double>::quiet_NaN();  ///< where it ended too early
  double largest_alpha = 0.0;
  bool keeps_energy = false;  ///< which then says nothing of the order
  bool equal = false;
};

double energy_error(const Case& problem, const Levels& levels) {
  HamiltonianEvaluator evaluator(problem.hamiltonian);
  const double start = evaluator.value(levels.at(0).data());
  double worst = 0.0;
  for (std::size_t k = 0; k < levels.t.size(); ++k) {
    worst = std::max(worst, std::abs(evaluator.value(levels.at(k).data()) - start));
  }
  return worst;
}

/// The errors of a run.
void judge(Row& row, const Case& problem, const Levels& levels, TrueOrbit& truth) {
  row.energy = energy_error(problem, levels);
  if (std::isnan(row.ended)) {
    row.position = position_error(levels, truth, 0.98 * problem.until, problem.until);
    row.early = position_error(levels, truth, 0.08 * problem.until, 0.1 * problem.until);
  }
}

/// Runs to the end and counts; after(report) follows every step. The first step, with the look-ahead, is not timed.
template <typename Run, typename After>
void count_steps(Run& run, Row& row, const After& after) {
  row.steps = row.off = 0;
  row.evaluations = 0;
  double start = 0.0;
  while (!run.finished()) {
    const StepReport report = run.step();
    if (report.status != Status::success) {
      row.ended = run.t();
      break;
    }
    start = row.steps == 0 ? cpu_seconds() : start;
    ++row.steps;
    row.evaluations += report.iterations;
    row.off += report.off_law ? 1 : 0;
    after(report);
  }
  row.cpu = std::min(row.cpu, cpu_seconds() - start);
}

Row run_library(const Case& problem, TrueOrbit& truth, int repeats, rubato::Levels kind,
                const StepPotentialChoice& potential, const std::string& name) {
  Row row{.levels = name, .cpu = std::numeric_limits<double>::infinity(), .equal = kind == rubato::Levels::fixed};
  IntegrationOptions options{.lagrangian = problem.scheme,
                             .step = problem.step,
                             .until = problem.until,
                             .levels = kind,
                             .potential = potential};
  for (int repeat = 0; repeat < repeats; ++repeat) {
    OrbitIntegrator run(problem.hamiltonian, {.q = problem.q, .p = problem.p}, options);
    Levels levels;
    double largest_part = 0.0;
    levels.add(0.0, run.scheme().state());
    count_steps(run, row, [&](const StepReport& report) {
      largest_part = std::max(largest_part, std::abs(report.potential));
      levels.add(run.t(), run.scheme().state());
    });
    if (repeat + 1 == repeats) {
      judge(row, problem, levels, truth);
      if (potential.kind == Kind::automatic && largest_part < 0.01 * row.energy) {
        row.levels += " (hardly felt)";
      }
    }
  }
  return row;
}

Row run_rival(const Case& problem, TrueOrbit& truth, int repeats) {
  Row row{.levels = "H kept by α", .cpu = std::numeric_limits<double>::infinity(), .keeps_energy = true};
  for (int repeat = 0; repeat < repeats; ++repeat) {
    const std::vector<double> z = problem.start();
    EnergyPreservingGauss run(problem.hamiltonian, z);
    Levels levels;
    row.steps = row.off = 0;
    row.evaluations = 0;
    row.largest_alpha = 0.0;
    levels.add(0.0, z);
    double start = 0.0;
    for (double t = 0.0; t < problem.until - 1e-9 * problem.step;) {
      if (!run.step(problem.step)) {
        row.ended = t;
        break;
      }
      start = row.steps == 0 ? cpu_seconds() : start;
      ++row.steps;
      t = static_cast<double>(row.steps) * problem.step;
      row.evaluations += run.evaluations();
      row.off += run.tuned() ? 0 : 1;
      row.largest_alpha = std::max(row.largest_alpha, run.tuned() ? std::abs(run.alpha()) : 0.0);
      levels.add(t, {run.state().data(), z.size()});
    }
    row.cpu = std::min(row.cpu, cpu_seconds() - start);
    if (repeat + 1 == repeats) {
      judge(row, problem, levels, truth);
    }
  }
  return row;
}

/// Steps that have no α, of those for which none is found.
std::size_t count_without_alpha(const Case& problem) {
  const std::vector<double> z = problem.start();
  EnergyPreservingGauss run(problem.hamiltonian, z);
  std::size_t count = 0;
  for (double t = 0.0; t < problem.until - 1e-9 * problem.step; t += problem.step) {
    EnergyPreservingGauss before = run;
    if (!run.step(problem.step)) {
      break;
    }
    count += !run.tuned() && !before.has_alpha(problem.step) ? 1 : 0;
  }
  return count;
}

/// 1.2e-3, 0.12, 1.2.
std::string number(double value) {
  char text[32];
  if (!std::isfinite(value)) {
    return "-";
  }
  if (value == 0.0 || (value >= 0.095 && value < 99.5)) {
    std::snprintf(text, sizeof text, value < 0.995 ? "%.2f" : value < 9.95 ? "%.1f" : "%.0f", value);
    return text;
  }
  std::snprintf(text, sizeof text, "%.1e", value);
  std::string result = text;
  for (const char* zero : {"e-0", "e+0"}) {
    if (const auto place = result.find(zero); place != std::string::npos) {
      result.erase(place + 2, 1);
    }
  }
  return result;
}

/// What as many errors as those of equal steps would take beside them.
std::string work(const Row& row, const Row& equal, int order, double Row::*error) {
  const double least = 1e-12, most = 0.3;
  if (!std::isnan(row.ended) || !(row.*error > least) || !(row.*error < most) || !(equal.*error < most)) {
    return "-";
  }
  return number(static_cast<double>(row.evaluations) / static_cast<double>(equal.evaluations) *
                std::pow(row.*error / equal.*error, 1.0 / order));
}

void print_head() {
  std::printf(
      "| orbit | levels | steps | evaluations | off the law | H off by | position | equal H | equal position | CPU |\n"
      "|---|---|---|---|---|---|---|---|---|---|\n");
}

void print(const std::string& orbit, const Row& row, const Row& equal, int order) {
  std::string levels = row.levels;
  if (!std::isnan(row.ended)) {
    levels += ", ends at t = " + number(row.ended);
  }
  std::printf("| %s | %s | %zu | %ld | %s | %s | %s | %s | %s | %s |\n", orbit.c_str(), levels.c_str(), row.steps,
              row.evaluations, row.equal ? "-" : std::to_string(row.off).c_str(), number(row.energy).c_str(),
              number(row.position).c_str(), (row.keeps_energy ? "-" : work(row, equal, order, &Row::energy)).c_str(),
              work(row, equal, order, &Row::early).c_str(),
              std::isnan(row.ended) ? number(row.cpu / equal.cpu).c_str() : "-");
  std::fflush(stdout);
}

/// All rows of one orbit.
void measure(const Case& problem, int repeats, bool with_rival) {
  // Of order 16, with steps that resolve the orbit well: half of them show how well.
  const double fine = std::holds_alternative<Midpoint>(problem.scheme) ? 2.0 * problem.step : problem.step;
  TrueOrbit truth(problem, fine);
  TrueOrbit finer(problem, 0.6 * fine);
  const int order = std::holds_alternative<Midpoint>(problem.scheme) ? 2 : 4;

  const Row equal = run_library(problem, truth, repeats, rubato::Levels::fixed, {.kind = Kind::none}, "equal");
  print(problem.name, equal, equal, order);
  const Row law = run_library(problem, truth, repeats, rubato::Levels::variable, {.kind = Kind::none}, "pure law");
  if (law.off == 0 && std::isnan(law.ended)) {
    print("", law, equal, order);
  }
  print("", run_library(problem, truth, repeats, rubato::Levels::variable, {.kind = Kind::automatic}, "potential"),
        equal, order);
  if (with_rival) {
    const Row rival = run_rival(problem, truth, repeats);
    print("", rival, equal, order);
    std::fprintf(stderr, "%s: |α| up to %s; of %zu steps without, %zu have none\n", problem.name.c_str(),
                 number(rival.largest_alpha).c_str(), rival.off, count_without_alpha(problem));
  }
  const std::vector<double> one = truth.at(0.99 * problem.until), other = finer.at(0.99 * problem.until);
  std::fprintf(stderr, "%s: references %s apart\n", problem.name.c_str(), number(distance(one, other)).c_str());
}

/// What becomes of a run with first steps that differ by 1e-7 of themselves.
void vary(Case problem, TrueOrbit& truth) {
  const double step = problem.step;
  std::size_t least = std::numeric_limits<std::size_t>::max(), most = 0;
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0.0;
  for (int i = -3; i <= 3; ++i) {
    problem.step = step * (1.0 + 1e-7 * i);
    const Row row = run_library(problem, truth, 1, rubato::Levels::variable, {.kind = Kind::automatic}, "potential");
    least = std::min(least, row.off);
    most = std::max(most, row.off);
    nearest = std::min(nearest, row.energy);
    farthest = std::max(farthest, row.energy);
  }
  std::printf("%s, potential, first steps that differ by 1e-7: %zu to %zu steps off the law, H off by %s to %s\n",
              problem.name.c_str(), least, most, number(nearest).c_str(), number(farthest).c_str());
}

/// A kink and an antikink on a ring, which meet: the lattice of the catalogue with spectral derivatives in space.
void measure_kinks(int repeats) {
  const auto run_with = [&](const std::string& name, const std::string& setting) {
    Row row{.levels = name, .cpu = std::numeric_limits<double>::infinity(), .equal = name == "equal"};
    const std::vector<std::string> settings = {"scheme.lagrangian=fourier", setting};
    for (int repeat = 0; repeat < repeats; ++repeat) {
      LatticeIntegrator run = rubato::make_lattice(rubato::read_problem("sine-gordon-kinks", settings));
      const double energy = run.node().energy;
      count_steps(run, row,
                  [&](const StepReport&) { row.energy = std::max(row.energy, std::abs(run.node().energy - energy)); });
    }
    return row;
  };
  const Row equal = run_with("equal", "scheme.levels=fixed");
  print("kink and antikink, `fourier`, h = 0.1", equal, equal, 2);
  print("", run_with("potential", "scheme.step_potential=auto"), equal, 2);
}

// What the rival is to be.

/// max |MᵀJM - J| of a map by differences of fourth order.
double two_form_defect(const std::vector<double>& z,
                       const std::function<Eigen::VectorXd(const std::vector<double>&)>& map) {
  const auto size = static_cast<Eigen::Index>(z.size()), n = size / 2;
  Eigen::MatrixXd M(size, size);
  constexpr double d = 1e-3;
  for (Eigen::Index i = 0; i < size; ++i) {
    const auto at = [&](double shift) {
      std::vector<double> moved = z;
      moved[static_cast<std::size_t>(i)] += shift;
      return map(moved);
    };
    M.col(i) = (8.0 * (at(d) - at(-d)) - (at(2.0 * d) - at(-2.0 * d))) / (12.0 * d);
  }
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(size, size);
  J.topRightCorner(n, n).setIdentity();
  J.bottomLeftCorner(n, n) = -Eigen::MatrixXd::Identity(n, n);
  return (M.transpose() * J * M - J).cwiseAbs().maxCoeff();
}

bool check(const char* what, double value, bool holds) {
  std::fprintf(stderr, "%s: %.3g%s\n", what, value, holds ? "" : "  FAILED");
  return holds;
}

bool check_rival() {
  bool holds = true;
  const Case orbit = kepler("", 0.3, Gauss{2}, 0.1);
  // One step from a place that is not symmetric. Differences are off by d⁴ times fifth derivatives, 1e-12 of some 100,
  // and by rounding, ε/d. With α that depends on z the map is no longer symplectic, by what α has to mend, h⁵: the
  // twin.
  const std::vector<double> z = {0.6, 0.5, -0.7, 0.9};
  const auto step = [&](bool tuned) {
    return two_form_defect(z, [&](const std::vector<double>& from) -> Eigen::VectorXd {
      EnergyPreservingGauss run(orbit.hamiltonian, from);
      if (!(tuned ? run.step(0.3) : run.step(0.3, 0.02)) || !run.tuned()) {
        std::exit(1);
      }
      return run.state();
    });
  };
  const double fixed = step(false), tuned = step(true);
  holds = check("two-form of a step with one α off by", fixed, fixed < 1e-9) && holds;
  holds = check("the same with α tuned to the state", tuned, tuned > 1e-6) && holds;

  // Order, from the last of three halvings: 4 with α tuned, 2 with another.
  const Case rotating{.name = "", .hamiltonian = pendulum(), .q = {0.0}, .p = {2.2}, .step = 0.1, .until = 10.0};
  TrueOrbit truth(rotating, 0.05);
  const auto error = [&](double h, double alpha) {
    EnergyPreservingGauss run(rotating.hamiltonian, rotating.start());
    for (int k = 0; k < std::lround(10.0 / h); ++k) {
      if (!(alpha == 0.0 ? run.step(h) : run.step(h, alpha))) {
        std::exit(1);
      }
    }
    return std::abs(run.state()[0] - truth.at(10.0)[0]);
  };
  for (const auto& [alpha, order] : {std::pair(0.0, 4.0), std::pair(0.02, 2.0)}) {
    for (const double h : {0.2, 0.1, 0.05}) {
      const double slope = std::log2(error(h, alpha) / error(0.5 * h, alpha));
      holds = check(alpha == 0.0 ? "order, H kept" : "order with an α of its own", slope,
                    h > 0.1 || std::abs(slope - order) < 0.1) &&
              holds;
    }
  }
  return holds;
}

}  // namespace

int main(int count, char** arguments) {
  const int repeats = count > 1 ? std::max(1, std::atoi(arguments[1])) : 3;
  if (!check_rival()) {
    return EXIT_FAILURE;
  }
  const auto pendulum_from = [](std::string name, double p, double h, SegmentLagrangian scheme) {
    return Case{std::move(name), pendulum(), {0.0}, {p}, h, 1000.0, scheme};
  };
  const auto well_from = [](std::string name, double h, SegmentLagrangian scheme) {
    return Case{std::move(name), double_well(), {1.02}, {0.0}, h, 1000.0, scheme};
  };

  std::printf("Midpoint, and order 4 by generating functions:\n\n");
  print_head();
  measure(pendulum_from("pendulum, rotating, p = 2.2, h = 0.05", 2.2, 0.05, Midpoint{}), repeats, false);
  measure(pendulum_from("pendulum beside the separatrix, p = 2.001", 2.001, 0.05, Midpoint{}), repeats, false);
  measure(well_from("double well, across both, from q = 1.02", 0.05, Midpoint{}), repeats, false);
  measure(kepler("Kepler, e = 0.6", 0.6, Midpoint{}, 0.1), repeats, false);
  measure(kepler("Kepler, e = 0.8", 0.8, Midpoint{}, 0.1), repeats, false);
  measure(kepler("Kepler, e = 0.9", 0.9, Midpoint{}, 0.1), repeats, false);
  measure(pendulum_from("pendulum, p = 2.2, order 4, h = 0.1", 2.2, 0.1, Generating{.order = 4}), repeats, false);
  measure_kinks(repeats);

  std::printf("\nGauss collocation of two stages, order 4:\n\n");
  print_head();
  measure(pendulum_from("pendulum, rotating, p = 2.2, h = 0.1", 2.2, 0.1, Gauss{2}), repeats, true);
  measure(pendulum_from("pendulum, librating, p = 1.9, h = 0.1", 1.9, 0.1, Gauss{2}), repeats, true);
  measure(pendulum_from("pendulum beside the separatrix, p = 2.001, h = 0.1", 2.001, 0.1, Gauss{2}), repeats, true);
  measure(well_from("double well, across both, from q = 1.02, h = 0.1", 0.1, Gauss{2}), repeats, true);
  measure(kepler("Kepler, e = 0.6", 0.6, Gauss{2}, 0.2), repeats, true);
  measure(kepler("Kepler, e = 0.8", 0.8, Gauss{2}, 0.2), repeats, true);
  measure(kepler("Kepler, e = 0.9", 0.9, Gauss{2}, 0.2), repeats, true);
  measure(kepler("Kepler, e = 0.9, half the first step", 0.9, Gauss{2}, 0.1), repeats, true);

  std::printf("\n");
  for (const auto& [e, scheme, part] :
       {std::tuple(0.8, SegmentLagrangian(Midpoint{}), 0.1), std::tuple(0.8, SegmentLagrangian(Gauss{2}), 0.2),
        std::tuple(0.9, SegmentLagrangian(Gauss{2}), 0.2), std::tuple(0.9, SegmentLagrangian(Gauss{2}), 0.1)}) {
    const bool midpoint = std::holds_alternative<Midpoint>(scheme);
    const Case problem = kepler(
        fmt::format("Kepler, e = {}, {}, {}", e, midpoint ? "midpoint" : "Gauss, 2 stages", part), e, scheme, part);
    TrueOrbit truth(problem, problem.step);
    vary(problem, truth);
  }
  return EXIT_SUCCESS;
}
