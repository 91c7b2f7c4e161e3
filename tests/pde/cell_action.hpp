#pragma once

#include <array>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/formula_action.hpp>

namespace rubato::tests {

namespace cell_action_detail {

using formula::Expression;
using Corners = std::array<Expression, 4>;

inline Expression mean(const Corners& c) {
  return (c[0] + c[1] + c[2] + c[3]) * 0.25;
}
inline Expression in_time(const Corners& c) {
  return ((c[2] - c[0]) + (c[3] - c[1])) * 0.5;
}
inline Expression in_space(const Corners& c) {
  return ((c[1] - c[0]) + (c[3] - c[2])) * 0.5;
}

}  // namespace cell_action_detail

/// The discrete action of the box scheme on one cell of a lattice in one space dimension, as a function of the
/// coordinates (t, x) and the values of its four corners (theory, section 5): on the bilinearly mapped quadrilateral,
///
///     A = ½ z̄ᵀ[M(δ₁z δ₂x - δ₂z δ₁x) + K(δ₂z δ₁t - δ₁z δ₂t)] - (δ₁t δ₂x - δ₁x δ₂t) S(z̄),
///
/// z̄ the mean of the corners, δ₁ the mean difference in the direction of time, δ₂ in that of space. On a rectangle it
/// is A = hΔx [½ z̄ᵀ(M D_t z + K D_x z) - S(z̄)]. Corners are ordered (t_k,x_i), (t_k,x_{i+1}), (t_{k+1},x_i),
/// (t_{k+1},x_{i+1}).
///
/// This states the scheme; its variations are taken by total_variation.hpp. Varying values gives Σ_cells hΔx/4 R = 0
/// with the cell residual R = M D_t z + K D_x z - ∇S(z̄), of which the production form R = 0 is the solution that starts
/// so (see LatticeScheme).
/// \throws std::invalid_argument unless the system has one space direction
inline FormulaAction box_cell_action(const MultisymplecticSystem& system) {
  using namespace cell_action_detail;
  if (system.directions() != 1) {
    throw std::invalid_argument(
        fmt::format("the cell action is stated for one space direction; the system has {}", system.directions()));
  }
  auto graph = std::make_shared<formula::Graph>();
  const int d = system.field_count();
  std::vector<Expression> corners;
  Corners t, x;
  std::vector<Corners> z(static_cast<std::size_t>(d));
  for (std::size_t c = 0; c < 4; ++c) {
    const auto at_corner = [&](const std::string& name) {
      corners.push_back(graph->variable(fmt::format("{} at corner {}", name, c)));
      return corners.back();
    };
    t[c] = at_corner("t");
    x[c] = at_corner("x");
    for (std::size_t f = 0; f < z.size(); ++f) {
      z[f][c] = at_corner(system.fields()[f]);
    }
  }

  std::vector<Expression> means;
  means.reserve(z.size());
  for (const Corners& field : z) {
    means.push_back(mean(field));
  }
  if (!system.coordinates().empty()) {
    means.push_back(mean(x));
  }
  const Expression S = formula::substitute(std::array{system.expression()}, *graph, system.variables(), means).front();
  Expression action = -(in_time(t) * in_space(x) - in_time(x) * in_space(t)) * S;
  for (int i = 0; i < d; ++i) {
    for (int j = 0; j < d; ++j) {
      const Corners& field = z[static_cast<std::size_t>(j)];
      const Expression weight = means[static_cast<std::size_t>(i)] * 0.5;
      if (const double m = system.M()(i, j); m != 0.0) {
        action += weight * (m * (in_time(field) * in_space(x) - in_space(field) * in_time(x)));
      }
      if (const double k = system.K(0)(i, j); k != 0.0) {
        action += weight * (k * (in_space(field) * in_time(t) - in_time(field) * in_space(t)));
      }
    }
  }
  return {graph, action, corners, Element{.corners = 4, .coordinates = 2, .values = static_cast<std::size_t>(d)}};
}

}  // namespace rubato::tests
