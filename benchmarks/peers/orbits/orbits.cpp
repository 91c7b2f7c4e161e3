// Work against accuracy on orbits: Rubato's schemes beside libraries and codes written by hand for one problem each.
// One thread. docs/performance-tables.md has what it prints.
//
//     build/benchmarks/benchmark_orbits [repeats [problem...]]
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include "comparisons.hpp"

int main(int argc, char** argv) {
  constexpr std::array<std::pair<const char*, void (*)(int)>, 9> problems = {
      {{"pendulum", orbits::pendulum},
       {"kepler", orbits::kepler},
       {"eccentric-kepler", orbits::eccentric_kepler},
       {"henon-heiles", orbits::henon_heiles},
       {"non-separable", orbits::non_separable},
       {"outer-solar-system", orbits::outer_solar_system},
       {"fput-chain", orbits::chain_32},
       {"fput-chain-1024", orbits::chain_1024},
       {"comet", orbits::comet}}};
  const int repeats = argc > 1 ? std::max(1, std::atoi(argv[1])) : 5;
  for (int a = 2; a < argc; ++a) {
    if (std::ranges::none_of(problems, [&](const auto& one) { return std::string(one.first) == argv[a]; })) {
      std::fprintf(stderr, "there is no problem \"%s\"\n", argv[a]);
      return 2;
    }
  }
#if !RUBATO_HAS_ODEINT
  std::printf("built without Boost.Odeint, which is left out\n");
#endif
#if !RUBATO_HAS_SUNDIALS
  std::printf("built without SUNDIALS, which is left out\n");
#endif
  for (const auto& [name, compare] : problems) {
    if (argc <= 2 || std::find(argv + 2, argv + argc, std::string(name)) != argv + argc) {
      compare(repeats);
    }
  }
}
