#pragma once

#include <algorithm>
#include <random>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/pde/lattice_method.hpp>

#include "equations.hpp"

/// Systems on small grids, and states that solve nothing, for what has to hold of any.
namespace rubato::tests {

struct MeshCase {
  MultisymplecticSystem system;
  grids::Grid grid;
};

inline std::vector<MeshCase> mesh_cases() {
  const grids::Grid line({{"x", 0, 2, 7}});
  const grids::Grid plane({{"x", 0, 2, 5}, {"y", -1, 1, 7}});
  return {{sine_gordon(), line},
          {wave_equation("(1 + 0.4*sin(pi*x))*(1 - cos(u)) + 0.2*x*u"), line},
          {schroedinger(2), line},
          {korteweg_de_vries(6, 1), line},
          {benjamin_bona_mahony(1, 1, 0.5), line},
          {good_boussinesq(), line},
          {dirac(1, 1), line},
          {wave_equation_2d("1 - cos(u) + 0.3*sin(pi*y)*u"), plane},
          {zakharov_kuznetsov(), plane}};
}

/// Between -1 and 1.
inline grids::FieldSet random_fields(int fields, std::size_t size, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  grids::FieldSet result(fields, size);
  std::ranges::generate(result.all(), [&] { return value(random); });
  return result;
}

/// Those of all schemes that state one and take the system.
inline std::vector<LatticeAction> actions_of(const MultisymplecticSystem& system) {
  std::vector<LatticeAction> actions;
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    try {
      if (auto action = make_lattice_method({.name = std::string(entry.name)})->action(system)) {
        actions.push_back(*std::move(action));
      }
    } catch (const SchemeRefusal&) {
      continue;
    }
  }
  return actions;
}

}  // namespace rubato::tests
