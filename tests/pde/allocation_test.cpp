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
#include <memory>
#include <string>
#include <vector>

#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/sponge.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

/// Counts what the last of some steps allocates; the first ones make their room.
void check_steps(const LatticeMethod& method, const grids::Grid& line) {
  const MultisymplecticSystem system = sine_gordon();
  InitialFields initial(3);
  initial[0] = sampled(line, [](double x) { return std::exp(-x * x); });
  initial[1] = sampled(line, [](double x) { return 0.5 * std::exp(-x * x); });
  const auto scheme = method.scheme(system, line, method.first_level(system, line, initial).level, 0.1);
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
  for (const double h : {0.1, 0.11, 0.1, 0.12, 0.105}) {
    step(h);
  }
  CHECK(stepped);
  CHECK(counted == 0);
  const std::size_t before = allocations;
  const LatticeLevel copy = scheme->level();
  CHECK(allocations > before);  // the twin: one is counted
}

}  // namespace

TEST_CASE("a step of a lattice allocates nothing") {
  const grids::Grid ring({{.name = "x", .from = -8, .to = 8, .cells = 45}});
  const grids::Grid between(
      {{.name = "x", .from = -8, .to = 8, .cells = 46, .left = grids::End::fixed, .right = grids::End::free}});
  const auto sponge = std::make_shared<const Sponge>(
      std::vector<Sponge::Layer>{{.axis = 0, .from = -8, .to = 8, .width = 4, .strength = 1}});
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    for (const int stages : {1, 2}) {
      if (stages > 1 && !entry.has_stages) {
        continue;
      }
      const LatticeMethodChoice choice{.name = std::string(entry.name), .stages = stages};
      for (const grids::Grid* line : {&ring, &between}) {
        if (line->has_walls() && !make_lattice_method(choice)->in_mirror()) {
          continue;
        }
        for (const auto& layers : {std::shared_ptr<const Sponge>(), sponge}) {
          INFO(entry.name << ", stages " << stages << (line->has_walls() ? ", between walls" : "")
                          << (layers != nullptr ? ", with a sponge" : ""));
          check_steps(*with_sponge(make_lattice_method(choice, *line), layers), *line);
        }
      }
    }
  }
}

#endif
