// Work against accuracy on lattices: Rubato's schemes of high order beside pseudospectral codes written by hand for one
// equation each, with FFTW at its best plans. One thread. docs/performance-tables.md has what it prints.
//
//     build/benchmarks/benchmark_waves [repeats [equation...]]
#include <omp.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include "equations.hpp"

int main(int argc, char** argv) {
  omp_set_num_threads(1);
  constexpr std::array<std::pair<const char*, void (*)(int)>, 8> equations = {
      {{"sine-gordon", comparison::sine_gordon},
       {"klein-gordon", comparison::klein_gordon},
       {"nls", comparison::schroedinger},
       {"kdv", comparison::korteweg_de_vries},
       {"kdv-two-solitons", comparison::two_solitons},
       {"bbm", comparison::benjamin_bona_mahony},
       {"frames", comparison::frames},
       {"second-order", comparison::second_order}}};
  const int repeats = argc > 1 ? std::max(1, std::atoi(argv[1])) : 5;
  for (int a = 2; a < argc; ++a) {
    if (std::ranges::none_of(equations, [&](const auto& one) { return std::string(one.first) == argv[a]; })) {
      std::fprintf(stderr, "there is no equation \"%s\"\n", argv[a]);
      return 2;
    }
  }
  for (const auto& [name, compare] : equations) {
    if (argc <= 2 || std::find(argv + 2, argv + argc, std::string(name)) != argv + argc) {
      compare(repeats);
    }
  }
}
