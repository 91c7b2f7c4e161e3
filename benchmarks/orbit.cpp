// One variable-level midpoint step: H given as a formula, beside the same algorithm written by hand (orbit_by_hand.hpp)
// with H, its gradient and its Hessian written by hand. Before anything is measured both must give the same orbit with
// the same number of evaluations. None of these orbits comes to a zero of Γ, and neither looks out for one.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/midpoint_scheme.hpp>
#include <rubato/variation/time_levels.hpp>

#include "orbit_by_hand.hpp"

namespace {

using by_hand::Matrix;
using by_hand::Vector;

struct Pendulum {
  static constexpr const char* name = "pendulum";
  static constexpr std::size_t size = 2;
  static constexpr Vector<size> start{0.0, 1.9};
  static constexpr double step = 0.1;

  static rubato::Hamiltonian formula() { return {{"q"}, {"p"}, "p^2/2 - cos(q)"}; }

  static double gradient(const Vector<size>& z, Vector<size>& g) {
    g = {std::sin(z[0]), z[1]};
    return 0.5 * z[1] * z[1] - std::cos(z[0]);
  }
  static double hessian(const Vector<size>& z, Vector<size>& g, Matrix<size>& H_zz) {
    const double cosine = std::cos(z[0]);
    g = {std::sin(z[0]), z[1]};
    H_zz = {{{cosine, 0.0}, {0.0, 1.0}}};
    return 0.5 * z[1] * z[1] - cosine;
  }
};

struct Kepler {
  static constexpr const char* name = "kepler";
  static constexpr std::size_t size = 4;
  static constexpr Vector<size> start{0.4, 0.0, 0.0, 2.0};  // eccentricity 0.6, at the pericentre
  static constexpr double step = 0.005;

  static rubato::Hamiltonian formula() {
    return {{"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - mu/sqrt(x^2 + y^2)", {{"mu", 1.0}}};
  }

  static double gradient(const Vector<size>& z, Vector<size>& g) {
    const auto [x, y, u, v] = z;
    const double square = x * x + y * y;
    const double inverse = 1.0 / std::sqrt(square);
    const double force = inverse / square;
    g = {force * x, force * y, u, v};
    return 0.5 * (u * u + v * v) - inverse;
  }
  static double hessian(const Vector<size>& z, Vector<size>& g, Matrix<size>& H_zz) {
    const auto [x, y, u, v] = z;
    const double square = x * x + y * y;
    const double inverse = 1.0 / std::sqrt(square);
    const double force = inverse / square;
    const double tide = 3.0 * force / square;
    g = {force * x, force * y, u, v};
    H_zz = {{{force - tide * x * x, -tide * x * y, 0.0, 0.0},
             {-tide * x * y, force - tide * y * y, 0.0, 0.0},
             {0.0, 0.0, 1.0, 0.0},
             {0.0, 0.0, 0.0, 1.0}}};
    return 0.5 * (u * u + v * v) - inverse;
  }
};

struct HenonHeiles {
  static constexpr const char* name = "henon_heiles";
  static constexpr std::size_t size = 4;
  static constexpr Vector<size> start{0.0, 0.1, 0.39581140290126395, 0.0};  // H = 1/12
  static constexpr double step = 0.1;

  static rubato::Hamiltonian formula() {
    return {{"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3"};
  }

  static double value(const Vector<size>& z) {
    const auto [x, y, u, v] = z;
    return 0.5 * (u * u + v * v + x * x + y * y) + y * (x * x - y * y / 3.0);
  }
  static double gradient(const Vector<size>& z, Vector<size>& g) {
    const auto [x, y, u, v] = z;
    g = {x + 2.0 * x * y, y + x * x - y * y, u, v};
    return value(z);
  }
  static double hessian(const Vector<size>& z, Vector<size>& g, Matrix<size>& H_zz) {
    const auto [x, y, u, v] = z;
    H_zz = {{{1.0 + 2.0 * y, 2.0 * x, 0.0, 0.0},
             {2.0 * x, 1.0 - 2.0 * y, 0.0, 0.0},
             {0.0, 0.0, 1.0, 0.0},
             {0.0, 0.0, 0.0, 1.0}}};
    return gradient(z, g);
  }
};

/// The library's orbit, with the interface of the one by hand.
template <typename System>
class FormulaOrbit {
public:
  explicit FormulaOrbit(const Vector<System::size>& z)
      : scheme_(rubato::make_midpoint_scheme(System::formula(), z)),
        levels_(*scheme_, {.on_singular = rubato::OnSingular::stop}, 0.0, System::step) {}

  bool first_step(double) { return step(); }  // its length was given to the constructor
  bool step() {
    const rubato::StepReport report = levels_.step();
    iterations_ = report.iterations;
    return report.status == rubato::Status::success && !report.off_law;
  }
  [[nodiscard]] auto state() const { return scheme_->state(); }
  [[nodiscard]] double time() const { return levels_.time(); }
  [[nodiscard]] int iterations() const { return iterations_; }

private:
  std::unique_ptr<rubato::SegmentScheme> scheme_;
  rubato::TimeLevels levels_;
  int iterations_ = 0;
};

[[noreturn]] void fail(const std::string& what) {
  fmt::print(stderr, "benchmark_orbit: {}\n", what);
  std::exit(EXIT_FAILURE);
}

constexpr int steps = 1000;

/// Both orbits over `steps` steps must agree to 1e-10 at every level, and after as many evaluations but for 1%.
template <typename System>
void compare() {
  FormulaOrbit<System> formula(System::start);
  by_hand::Orbit<System> hand(System::start);
  int formula_evaluations = 0;
  int hand_evaluations = 0;
  double largest = 0.0;
  for (int k = 0; k < steps; ++k) {
    const bool made =
        k == 0 ? formula.first_step(System::step) && hand.first_step(System::step) : formula.step() && hand.step();
    if (!made) {
      fail(fmt::format("{}: step {} could not be made", System::name, k));
    }
    formula_evaluations += formula.iterations();
    hand_evaluations += hand.iterations();
    largest = std::max(largest, std::abs(formula.time() - hand.time()));
    for (std::size_t i = 0; i < System::size; ++i) {
      largest = std::max(largest, std::abs(formula.state()[i] - hand.state()[i]));
    }
  }
  fmt::print("{:>13}: {:.2f} evaluations a step, {:.2f} by hand; orbits differ by {:.1e}\n", System::name,
             static_cast<double>(formula_evaluations) / steps, static_cast<double>(hand_evaluations) / steps, largest);
  if (!(largest <= 1e-10)) {
    fail(fmt::format("{}: the orbits differ by {}", System::name, largest));
  }
  // Where rounding decides whether a correction still shrinks, one of them may iterate once more than the other.
  if (100 * std::abs(formula_evaluations - hand_evaluations) > hand_evaluations) {
    fail(fmt::format("{}: {} evaluations, {} by hand", System::name, formula_evaluations, hand_evaluations));
  }
}

/// Time per step, over the first `steps` steps again and again.
template <typename Orbit, typename System>
void run(benchmark::State& state) {
  for (auto _ : state) {
    state.PauseTiming();
    Orbit orbit(System::start);
    bool made = orbit.first_step(System::step);
    state.ResumeTiming();
    for (int k = 1; k < steps; ++k) {
      made = orbit.step() && made;
    }
    benchmark::DoNotOptimize(orbit.state());
    if (!made) {
      state.SkipWithError("a step could not be made");
    }
  }
  state.SetItemsProcessed(state.iterations() * (steps - 1));
}

/// Prints as usual, and keeps the CPU time of every repetition.
class Reporter final : public benchmark::ConsoleReporter {
public:
  void ReportRuns(const std::vector<Run>& runs) override {
    ConsoleReporter::ReportRuns(runs);
    for (const Run& run : runs) {
      if (run.run_type == Run::RT_Iteration && !run.error_occurred) {
        times_[run.run_name.function_name].push_back(run.GetAdjustedCPUTime());
      }
    }
  }

  /// Median time of a benchmark over that of another, or nothing if one of them was filtered out.
  [[nodiscard]] std::optional<double> ratio(const std::string& name, const std::string& reference) const {
    if (!times_.contains(name) || !times_.contains(reference)) {
      return std::nullopt;
    }
    return median(times_.at(name)) / median(times_.at(reference));
  }

private:
  static double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::ranges::nth_element(values, middle);
    return *middle;
  }

  std::map<std::string, std::vector<double>> times_;
};

/// A system's two benchmarks and, after all have run, the ratio of their times.
template <typename System>
struct Pair {
  static std::string formula() { return fmt::format("formula/{}", System::name); }
  static std::string hand() { return fmt::format("by_hand/{}", System::name); }

  static void add(const std::string& name, void (*function)(benchmark::State&)) {
    benchmark::RegisterBenchmark(name.c_str(), function)->Unit(benchmark::kMicrosecond)->Repetitions(7);
  }
  static void add() {
    compare<System>();
    add(formula(), &run<FormulaOrbit<System>, System>);
    add(hand(), &run<by_hand::Orbit<System>, System>);
  }
  static void print(const Reporter& reporter) {
    if (const auto ratio = reporter.ratio(formula(), hand())) {
      fmt::print("{:>13}: formula / by hand = {:.2f} (median CPU times)\n", System::name, *ratio);
    }
  }
};

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) {
    return EXIT_FAILURE;
  }
  Pair<Pendulum>::add();
  Pair<Kepler>::add();
  Pair<HenonHeiles>::add();
  Reporter reporter;
  benchmark::RunSpecifiedBenchmarks(&reporter);
  Pair<Pendulum>::print(reporter);
  Pair<Kepler>::print(reporter);
  Pair<HenonHeiles>::print(reporter);
}
