#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/outcome.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// Simplified Newton corrections of the stages of Gauss collocation: the equations
///
///     (I - h A⊗B) δ = r,      B = J H_zz at one point,
///
/// of all m stages, taken apart by A⁻¹ = V Λ V⁻¹ into (λ I - h B) w = λ (V⁻¹ r)_λ for each eigenvalue, of which pairs
/// of conjugates count once, in real arithmetic (Hairer and Wanner, Solving Ordinary Differential Equations II, section
/// IV.8): m/2 matrices of twice the order of B in place of one of m times. No memory is taken after construction.
class StageNewton {
public:
  /// One row for each component of the state, the stages side by side.
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  /// Components of the state up to which dense matrices are factored.
  static constexpr Eigen::Index most_components = 256;

  /// \throws std::invalid_argument if size is not 1 … most_components
  StageNewton(const GaussTableau& tableau, Eigen::Index size);

  /// Factors for a step of length h; hessian = H_zz, size × size, the state (q, p). Not success where a matrix is
  /// singular or not finite.
  [[nodiscard]] Status factor(double h, const Eigen::MatrixXd& hessian);
  /// r ↦ δ, in the first m columns. Hypothesis: the last factor() succeeded.
  void solve(Rows& right);

  /// Operations of factor() and of solve(), about: what a choice between iterations is made by, the same everywhere.
  ///@{
  [[nodiscard]] double factor_operations() const;
  [[nodiscard]] double solve_operations() const;
  ///@}

private:
  struct Part {
    std::complex<double> value;
    Eigen::VectorXcd from_stages, to_stages;  ///< the row of λ V⁻¹ and the column of V, twice for a pair
    solve::DenseSolver factors;
    [[nodiscard]] bool is_pair() const { return value.imag() != 0.0; }
  };

  Eigen::Index size_;
  std::vector<Part> parts_;
  Eigen::MatrixXd matrix_, single_;  ///< of a pair, and of a real eigenvalue
  Eigen::VectorXd rhs_;
  Rows result_;
};

}  // namespace rubato
