#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

namespace rubato {

/// The tableau of Gauss collocation with m stages, order 2m: nodes c_i, the roots of the shifted Legendre polynomial of
/// degree m; with the Lagrange polynomials ℓ_j of the nodes, b_j = ∫₀¹ ℓ_j and a_ij = ∫₀^{c_i} ℓ_j. It is symplectic:
/// b_i a_ij + b_j a_ji = b_i b_j.
///
/// A coefficient that is rounded makes the method miss its symplecticity by the same amount in every step, which shows
/// as a drift. So each is given in two parts, a = a_short + a_rest: the first has 12 bits, so that products with it err
/// at random only, and the rest is 4096 times smaller, and its rounding with it (after Hairer, McLachlan and
/// Razakarivony, "Achieving Brouwer's law with implicit Runge–Kutta methods", BIT 48, 2008).
struct GaussTableau {
  static constexpr int most_stages = 8;

  /// \throws std::invalid_argument unless 1 ≤ stages ≤ most_stages
  explicit GaussTableau(int stages);

  int stages;
  Eigen::VectorXd c, b;
  Eigen::MatrixXd a;
  Eigen::VectorXd b_short, b_rest;
  Eigen::MatrixXd a_short, a_rest;
  /// Coefficients of ∫_o^{o+σ} ℓ_j = Σ_k p_kj σ^{k+1} about the beginning o = 0 and the end o = 1 of a step; k < m.
  Eigen::MatrixXd from_start, from_end;

  /// The eigenvalues of A⁻¹: the zeros of the denominator Σ_j (2m-j)! m!/((2m)! j! (m-j)!) (-z)^j of the diagonal Padé
  /// approximation of e^z, the method's stability function (Hairer and Wanner, Solving Ordinary Differential Equations
  /// II, section IV.3).
  [[nodiscard]] std::vector<std::complex<double>> inverse_eigenvalues() const;
  /// A⁻¹ = V Λ V⁻¹, which takes the equations of all stages apart (Butcher, "On the implementation of implicit
  /// Runge–Kutta methods", BIT 16, 1976).
  struct Eigenbasis {
    Eigen::VectorXcd values;  ///< Λ, in the order of inverse_eigenvalues()
    Eigen::MatrixXcd V, V_inverse;
  };
  /// Found once for each number of stages, from then on at no cost.
  [[nodiscard]] const Eigenbasis& inverse_eigenbasis() const;

  /// A⁻¹, and w = A⁻ᵀb of z_{k+1} = z_k + Σ w_i Y_i with Y_i = h Σ a_ij f_j, in two parts: the nearest numbers of
  /// double precision, and what these leave.
  struct Inverse {
    Eigen::MatrixXd value, rest;
    Eigen::VectorXd end, end_rest;
  };
  [[nodiscard]] Inverse inverse() const;

  /// A² and c, in two parts as above: of q'' = f(q), Q_i = q + c_i h q' + h² Σ (A²)_ij f(Q_j).
  struct Square {
    Eigen::MatrixXd a_short, a_rest;
    Eigen::VectorXd c_short, c_rest;
  };
  [[nodiscard]] Square square() const;

  [[nodiscard]] double lagrange(int j, double x) const;  ///< ℓ_j(x)
};

}  // namespace rubato
