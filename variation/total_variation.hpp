#pragma once

#include <span>

#include <Eigen/Core>

#include <rubato/variation/discrete_action.hpp>

/// \file
/// The discrete total variation (theory, section 2): vary the values and the coordinates of
///
///     𝕊 = Σ_elements A(corner coordinates, corner values)
///
// clang-format off
/// | vary            | at                | gives                                                  | here                 |
/// |-----------------|-------------------|--------------------------------------------------------|----------------------|
/// | the value z     | an interior node  | discrete Euler–Lagrange equation (3.3): the integrator | value_variation      |
/// | the time t      | an interior node  | discrete energy law (3.4)                              | coordinate_variation |
/// | the position x  | an interior node  | discrete momentum law                                  | coordinate_variation |
/// | anything        | a boundary corner | one-forms θ⁻, θ⁺ (3.6)–(3.7); ω = dθ⁺ (3.13)           | boundary_one_form, two_form |
///
/// These act on single elements; on a whole lattice, LatticeVariation does the same for all nodes at once.
// clang-format on

namespace rubato {

/// One element that meets an interior node: its corners' data and which of its corners the node is.
struct Incidence {
  std::span<const double> corners;
  std::size_t corner = 0;
};

/// Σ ∂A/∂z(node) over the elements that meet a node: zero is the discrete Euler–Lagrange equation (3.3).
/// \return a vector of element().values entries
[[nodiscard]] Eigen::VectorXd value_variation(DiscreteAction& action, std::span<const Incidence> elements);

/// Σ ∂A/∂(coordinate i of the node): for i = 0 (time) zero is the discrete energy law (3.4), for i > 0 the discrete
/// momentum law in that direction.
[[nodiscard]] double coordinate_variation(DiscreteAction& action, std::span<const Incidence> elements,
                                          std::size_t coordinate);

/// The boundary one-form of a corner, θ = Σ ∂A/∂(corner's coordinates and values) d(…): for a segment, corner 0 gives
/// θ⁻ of (3.6) and corner 1 gives θ⁺ of (3.7) (with +𝕃 dt_{k+1}, where the paper prints −𝕃). Their sum is dA.
/// \return the components on the full corner vector of the element (zero off the corner)
[[nodiscard]] Eigen::VectorXd boundary_one_form(DiscreteAction& action, std::span<const double> corners,
                                                std::size_t corner);

/// ω = dθ⁺ = −dθ⁻ of a segment (3.13): the antisymmetric matrix W on (t_0, z_0, t_1, z_1) with
///
///     ω(u, v) = uᵀ W v,   W(0a, 1b) = ∂²A/∂(0a)∂(1b) = −W(1b, 0a),   other blocks zero.
///
/// The two-step map Φ preserves it: TᵀW₁T = W₀ for T its tangent (3.14).
/// \throws std::invalid_argument unless the element is a segment (2 corners, 1 coordinate)
[[nodiscard]] Eigen::MatrixXd two_form(DiscreteAction& action, std::span<const double> corners);

/// Tangent T of the two-step map Φ: (t_0,z_0,t_1,z_1) ↦ (t_1,z_1,t_2,z_2) of a segment action, at a pair of consecutive
/// segments that satisfies both (3.3) and (3.4); by implicit differentiation of the two variations at node 1,
///
///     ∂²A/∂1∂2 (12) · δ2 = −[∂²A/∂1∂1 (01) + ∂²A/∂1∂1 (12)] δ1 − ∂²A/∂1∂0 (01) · δ0,
///
/// where "1" stands for (t_1, z_1). The matrix on the left degenerates where the step does: det ∝ hΓ.
/// \throws std::invalid_argument unless the element is a segment and that matrix is regular
[[nodiscard]] Eigen::MatrixXd two_step_tangent(DiscreteAction& action, std::span<const double> first,
                                               std::span<const double> second);

}  // namespace rubato
