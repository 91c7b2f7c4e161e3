// CPU time of a step of orbits of the catalogue, by scheme, with equal levels and with variable ones. Run it with
// RUBATO_JIT=0 and with RUBATO_JIT=1 in turns to see what machine code for formulas gives.
//
//   benchmark_steps [problem [scheme]]

#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/problem.hpp>

namespace {

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

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

}  // namespace

int main(int argc, char** argv) {
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
