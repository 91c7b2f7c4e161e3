#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// A scaling z_i → λ^{fields_i} z_i, t → λ^{directions_0} t, x_a → λ^{directions_{1+a}} x_a, under which the density
/// ½zᵀMz_t + Σ ½zᵀK_a z_{x_a} - S(z) gets the factor λ^density. Solutions go to solutions.
struct Scaling {
  Eigen::VectorXd fields;      ///< exponents
  Eigen::VectorXd directions;  ///< exponents of t, x, y, z
  double density = 0.0;

  /// The exponent of the action ∫∫ L dx dt: 0 for a variational symmetry, which has a conservation law by Noether's
  /// theorem. Others change solutions alone.
  [[nodiscard]] double multiplier() const { return density + directions.sum(); }
};

/// All scalings of an equation, as a basis of the exponents. They solve linear equations: exponents of the fields that
/// an entry of M or K_a couples, and Σ a_i z_i ∂S/∂z_i + Σ b_a x_a ∂S/∂x_a = s S at random points (up to the constant
/// in S, which no equation of motion has). A basis is in reduced echelon form, those that move t, x and y first.
[[nodiscard]] std::vector<Scaling> scalings(const MultisymplecticSystem& system);

/// Galilei's transformation along a direction, to first order in its velocity v: x → x - vt, and
///
///     δz = v (x B z + x b + C z + c),   B a linear and b an affine symmetry (b·∇S = 0).
struct GalileiTransformation {
  int direction = 0;
  Eigen::MatrixXd B, C;
  Eigen::VectorXd b, c;
};

/// The transformation for which δz - v t z_x takes solutions to solutions; nothing where none of this form does. With
/// δz put into the equation, what is left has to be a combination R of its rows for all z, z_t and z_x:
///
///     MC = RM,   K_e C - δ_{ea} M = RK_e,   K_a(Bz + b) - S''(z)(Cz + c) = -R∇S(z),
///
/// linear equations for B, b, C, c and R.
[[nodiscard]] std::optional<GalileiTransformation> galilei_transformation(const MultisymplecticSystem& system,
                                                                          int direction);

}  // namespace rubato
