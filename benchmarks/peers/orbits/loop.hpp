#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "gauss.hpp"

/// \file
/// Whole integrations with equal steps as one would write them for one system: what a run of the program is measured
/// against.

namespace orbits {

/// The extremes of an energy along an orbit.
struct Extremes {
  double least = std::numeric_limits<double>::infinity(), greatest = -least;

  void add(double energy) {
    least = std::min(least, energy);
    greatest = std::max(greatest, energy);
  }
};

/// Blanes and Moan's splitting of order 4 for unit masses, with compensated sums, and the extremes of the discrete
/// energy and of H. \return whether all is finite
template <typename System>
bool split(long steps, double h) {
  static_assert(System::separable && System::unit_masses);
  constexpr std::size_t n = System::n, kicks = 6;
  constexpr double a1 = 0.0792036964311957, a2 = 0.353172906049774, a3 = -0.0420650803577195;
  constexpr double b1 = 0.209515106613362, b2 = -0.143851773179818, b3 = 0.5 - b1 - b2;
  constexpr std::array a{a1, a2, a3, 1.0 - 2.0 * (a1 + a2 + a3), a3, a2, a1};
  constexpr std::array b{b1, b2, b3, b3, b2, b1};
  constexpr double at_rest[n] = {};
  double q[n], p[n], low_q[n] = {}, low_p[n] = {}, force[n];
  System::start(q, p);
  const auto add = [](double& x, double& low, double change) {
    change += low;
    const double sum = x + change;
    low = change - (sum - x);
    x = sum;
  };
  Extremes discrete, nodes;
  for (long step = 0; step < steps; ++step) {
    double energy = 0.0;
    for (std::size_t i = 0; i <= kicks; ++i) {
      for (std::size_t k = 0; k < n; ++k) {
        add(q[k], low_q[k], a[i] * h * p[k]);
        energy += 0.5 * a[i] * p[k] * p[k];
      }
      if (i < kicks) {
        System::force(q, force);
        energy += b[i] * System::energy(q, at_rest);
        for (std::size_t k = 0; k < n; ++k) {
          add(p[k], low_p[k], b[i] * h * force[k]);
        }
      }
    }
    discrete.add(energy);
    nodes.add(System::energy(q, p));
  }
  return std::isfinite(discrete.greatest - discrete.least + (nodes.greatest - nodes.least));
}

/// The same by Gauss collocation, with the extremes of H.
template <typename System, int Stages>
bool collocate(long steps, double h) {
  State<System> state;
  Extremes nodes;
  auto watch = [&](const double* q, const double* p) { nodes.add(System::energy(q, p)); };
  Gauss<System, Stages>()(static_cast<int>(steps), static_cast<double>(steps) * h, state, watch);
  return std::isfinite(nodes.greatest - nodes.least);
}

}  // namespace orbits
