// CPU time of a step of orbits of the catalogue, by scheme, with equal levels and with variable ones. Run it with
// RUBATO_JIT=0 and with RUBATO_JIT=1 in turns to see what machine code for formulas gives.
//
//   benchmark_steps [problem [scheme]]
//   benchmark_steps runs [problem]       whole runs of 20 000 steps, those that an error of 1e-6 of the energy takes

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/problem.hpp>

#include "peers/cpu_clock.hpp"

namespace {

using peers::cpu_seconds;

struct Scheme {
  std::string name;
  std::vector<std::string> settings;
};

/// Nanoseconds a step, over about a third of a second; negative where a step failed.
double time_of(const std::string& problem, const Scheme& scheme, const std::string& levels) {
  std::vector<std::string> settings = scheme.settings;
  settings.push_back("scheme.levels=" + levels);
  settings.emplace_back("scheme.until=1e9");
  rubato::OrbitIntegrator orbit = rubato::make_integrator(rubato::read_problem(problem, settings));
  constexpr double enough = 0.3;
  constexpr int block = 50;
  for (int i = 0; i < block; ++i) {
    (void)orbit.step();
  }
  const double start = cpu_seconds();
  int steps = 0;
  while (cpu_seconds() - start < enough) {
    for (int i = 0; i < block; ++i) {
      if (orbit.step().status != rubato::Status::success) {
        return -1.0;
      }
    }
    steps += block;
  }
  return 1e9 * (cpu_seconds() - start) / steps;
}

struct Run {
  std::string problem, scheme;
  std::vector<std::string> settings;
};

/// Milliseconds of a whole run to the time of `steps` equal steps, what is done once (the look-ahead, the choice of a
/// step potential) included, construction not; the median of five, and the largest deviation of H.
struct Price {
  double ms, deviation;
  long steps;
};
Price price_of(const Run& run, double step, const std::string& levels, long steps) {
  std::vector<std::string> settings = run.settings;
  settings.push_back("scheme.levels=" + levels);
  settings.push_back("scheme.step=" + std::to_string(step));
  settings.emplace_back("scheme.until=1e12");
  const rubato::Problem problem = rubato::read_problem(run.problem, settings);
  Price price{};
  std::vector<double> times;
  for (int turn = 0; turn < 6; ++turn) {  // the first for the deviation, which costs time
    rubato::OrbitIntegrator orbit = rubato::make_integrator(problem);
    const double before = turn == 0 ? orbit.node().energy : 0.0;
    const double until = orbit.t() + step * static_cast<double>(steps);
    price.steps = 0;
    const double start = cpu_seconds();
    while (orbit.t() < until) {
      if (orbit.step().status != rubato::Status::success) {
        return {-1.0, 0.0, 0};
      }
      if (turn == 0) {
        price.deviation = std::max(price.deviation, std::abs(orbit.node().energy - before) / std::abs(before));
      }
      ++price.steps;
    }
    if (turn > 0) {
      times.push_back(1e3 * (cpu_seconds() - start));
    }
  }
  std::ranges::sort(times);
  price.ms = times[2];
  return price;
}

void print_runs(const std::string& only) {
  const std::vector<std::string> rkn{"scheme.lagrangian=splitting", "scheme.composition=blanes-moan-rkn-6"};
  const std::vector<std::string> gauss_6{"scheme.lagrangian=gauss", "scheme.stages=6"};
  struct Row {
    Run run;
    double step;
  };
  std::vector<std::string> fast_pendulum = rkn;
  fast_pendulum.emplace_back("initial.p=1.9");
  const std::vector<Row> rows{
      {{"pendulum", "blanes-moan-rkn-6", fast_pendulum}, 0.76},  {{"kepler", "blanes-moan-rkn-6", rkn}, 0.1599},
      {{"henon-heiles", "blanes-moan-rkn-6", rkn}, 0.83},        {{"non-separable", "gauss-6", gauss_6}, 0.83},
      {{"outer-solar-system", "blanes-moan-rkn-6", rkn}, 877.0}, {{"fput-chain", "blanes-moan-rkn-6", rkn}, 1.5}};
  constexpr long steps = 20000;
  for (const Row& row : rows) {
    if (!only.empty() && only != row.run.problem) {
      continue;
    }
    const Price fixed = price_of(row.run, row.step, "fixed", steps);
    const Price variable = price_of(row.run, row.step, "variable", steps);
    std::printf("%s %s %g: fixed %.2f ms, H off by %.1e; variable %.2f ms in %ld steps, %.1e; ratio %.2f\n",
                row.run.problem.c_str(), row.run.scheme.c_str(), row.step, fixed.ms, fixed.deviation, variable.ms,
                variable.steps, variable.deviation, variable.ms / fixed.ms);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "runs") {
    print_runs(argc > 2 ? argv[2] : "");
    return 0;
  }
  const std::vector<Scheme> schemes{{"midpoint", {"scheme.lagrangian=midpoint"}},
                                    {"golden", {"scheme.lagrangian=splitting", "scheme.composition=golden"}},
                                    {"gauss-4", {"scheme.lagrangian=gauss", "scheme.stages=4"}}};
  for (const std::string problem :
       {"pendulum", "kepler", "henon-heiles", "non-separable", "outer-solar-system", "fput-chain"}) {
    for (const Scheme& scheme : schemes) {
      if ((argc > 1 && problem != argv[1]) || (argc > 2 && scheme.name != argv[2]) ||
          (problem == "non-separable" && scheme.name == "golden")) {
        continue;
      }
      for (const std::string levels : {"fixed", "variable"}) {
        std::printf("%s %s %s %.1f\n", problem.c_str(), scheme.name.c_str(), levels.c_str(),
                    time_of(problem, scheme, levels));
      }
    }
  }
}
