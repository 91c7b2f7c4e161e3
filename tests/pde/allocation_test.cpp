// A step of a lattice allocates nothing, for every scheme that the registry has.

#include <catch2/catch.hpp>

#include "allocations.hpp"

#include <cstddef>

namespace rubato::tests {

/// Those of this program so far; 0 where they are not counted.
std::size_t allocations_so_far() {
#ifdef RUBATO_COUNTS_ALLOCATIONS
  return allocations;
#else
  return 0;
#endif
}

}  // namespace rubato::tests

#ifdef RUBATO_COUNTS_ALLOCATIONS

#include <cmath>
#include <string>

#include <rubato/pde/lattice_method.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

TEST_CASE("a step of a lattice allocates nothing") {
  const grids::Grid line({{"x", -8, 8, 45}});
  const MultisymplecticSystem system = sine_gordon();
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    for (const int stages : {1, 2}) {
      if (stages > 1 && !entry.has_stages) {
        continue;
      }
      const auto method = make_lattice_method({.name = std::string(entry.name), .stages = stages});
      InitialFields initial(3);
      initial[0] = sampled(line, [](double x) { return std::exp(-x * x); });
      initial[1] = sampled(line, [](double x) { return 0.5 * std::exp(-x * x); });
      const auto scheme = method->scheme(system, line, method->first_level(system, line, initial).level, 0.1);
      std::size_t counted = 0;
      bool stepped = true;
      const auto step = [&](double h) {
        const std::size_t before = allocations;
        const Status status = scheme->advance(h, 0.0);
        const double reported = scheme->discrete_energy() + scheme->discrete_energy_slope() + scheme->node().energy;
        scheme->accept();
        counted = allocations - before;
        stepped = stepped && status == Status::success && std::isfinite(reported);
      };
      for (const double h : {0.1, 0.11, 0.1, 0.12, 0.105}) {  // the first ones make their room
        step(h);
      }
      INFO(entry.name << ", stages " << stages);
      CHECK(stepped);
      CHECK(counted == 0);
      const std::size_t before = allocations;
      const LatticeLevel copy = scheme->level();
      CHECK(allocations > before);  // the twin: one is counted
    }
  }
}

#endif
