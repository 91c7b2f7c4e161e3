#pragma once

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice_scheme.hpp>

#include "equations.hpp"

/// What tests of Gauss collocation on lattices begin from.
namespace rubato::tests {

/// An equation on a grid, and which of its fields are given: as humps that repeat.
struct Example {
  std::string name;
  MultisymplecticSystem system;
  grids::Grid grid;
  std::vector<std::string> given;  ///< fields that are given, humps
};

/// On as many cells as a spectral lattice takes, or on odd numbers alone.
inline std::vector<Example> examples(bool odd_alone = false) {
  const grids::Grid odd({{"x", -8, 8, 45}}), even = odd_alone ? odd : grids::Grid({{"x", -8, 8, 48}});
  const grids::Grid plane({{"x", -6, 6, 15}, {"y", -6, 6, odd_alone ? 11u : 12u}});
  return {{"sine-Gordon", sine_gordon(), even, {"u", "v"}},
          {"Schroedinger", schroedinger(2), odd, {"p", "q"}},
          {"KdV, odd", korteweg_de_vries(6, 1), odd, {"u"}},
          {"KdV, even", korteweg_de_vries(6, 1), even, {"u"}},
          {"BBM", benjamin_bona_mahony(1, 1, 1), even, {"u"}},
          {"Camassa-Holm", camassa_holm(1), odd, {"u"}},
          {"Boussinesq", good_boussinesq(), even, {"u", "v"}},
          {"Dirac", dirac(1, 0.5), odd, {}},
          {"Zakharov-Kuznetsov", zakharov_kuznetsov(), plane, {"u"}},
          {"wave in the plane", wave_equation_2d("1 - cos(u)"), plane, {"u", "v"}}};
}

inline LatticeLevel first_level(const Example& example, Collocation collocation = Collocation::nodes) {
  InitialFields initial(example.system.fields().size());
  double shift = 0.0;
  for (std::size_t f = 0; f < initial.size(); ++f) {
    const bool given =
        example.given.empty() || std::ranges::find(example.given, example.system.fields()[f]) != example.given.end();
    if (!given) {
      continue;
    }
    auto& values = initial[f].emplace(example.grid.size());
    shift += 0.7;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const auto place = example.grid.place(i);
      double square = 0.0;
      for (int a = 0; a < example.grid.dimensions(); ++a) {
        const auto& axis = example.grid.axis(a);
        const double length = axis.to - axis.from, pi = std::numbers::pi;  // a hump that repeats
        square +=
            std::pow(length / pi * std::sin(pi / length * (axis.node(place[static_cast<std::size_t>(a)]) - shift)), 2);
      }
      values[i] = (0.1 + 0.4 * std::exp(-square / 4.0)) * (f == 0 || example.given.size() != 2 ? 1.0 : 0.5);
    }
  }
  return initial_level(example.system, example.grid, initial, collocation);
}

/// z after `steps` equal steps; fields at midpoints left out.
inline grids::FieldSet after(LatticeScheme& scheme, double h, int steps) {
  for (int k = 0; k < steps; ++k) {
    REQUIRE(scheme.advance(h, 0.0) == Status::success);
    scheme.accept();
  }
  grids::FieldSet fields = scheme.level().fields;
  for (int f = 0; f < fields.fields(); ++f) {
    if (scheme.system().structure().at_midpoints(f)) {
      std::ranges::fill(fields.field(f), 0.0);
    }
  }
  return fields;
}

}  // namespace rubato::tests
