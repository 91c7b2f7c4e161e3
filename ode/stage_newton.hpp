#pragma once

#include <complex>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/ode/component_units.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/hessian_band.hpp>
#include <rubato/solve/band_solver.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// Simplified Newton corrections of the stages of Gauss collocation: the equations
///
///     (I - h A⊗B) δ = r,      B = J H_zz at one point,
///
/// of all m stages, taken apart by A⁻¹ = V Λ V⁻¹ into (λ I - h B) w = λ (V⁻¹ r)_λ for each eigenvalue, of which pairs
/// of conjugates count once, in real arithmetic (Hairer and Wanner, Solving Ordinary Differential Equations II, section
/// IV.8): m/2 matrices of twice the order of B in place of one of m times, whole ones or, where B has one
/// (HessianBand), within its band. No memory is taken after construction.
class StageNewton {
public:
  /// One row for each component of the state, the stages side by side.
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  /// Components of the state up to which whole matrices are factored.
  static constexpr Eigen::Index most_components = 256;

  /// None where H_zz has no band, and more components than whole matrices are factored of.
  [[nodiscard]] static std::optional<StageNewton> of(const GaussTableau& tableau, const Hamiltonian& hamiltonian);

  /// Factors for a step of length h, with H_zz at `point`. Not success where a matrix is singular or not finite.
  [[nodiscard]] Status factor(HamiltonianEvaluator& hamiltonian, const double* point, double h);
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
    std::variant<solve::DenseSolver, solve::BandSolver> factors;
    [[nodiscard]] bool is_pair() const { return value.imag() != 0.0; }
  };

  StageNewton(const GaussTableau& tableau, Eigen::Index size, std::optional<HessianBand> band);

  /// Where component r of the state, or of the imaginary part, stands in a right-hand side.
  [[nodiscard]] Eigen::Index place(const Part& part, Eigen::Index r, bool imaginary) const;
  /// Where the unit of component r stands.
  [[nodiscard]] std::size_t unit_of(Eigen::Index r) const {
    return static_cast<std::size_t>(band_ ? band_->places[static_cast<std::size_t>(r)] : r);
  }
  void find_units(std::span<const double> entries);
  [[nodiscard]] Status factor_whole(Part& part, double h);
  [[nodiscard]] Status factor_band(Part& part, double h, std::span<const double> entries);

  Eigen::Index size_;
  std::optional<HessianBand> band_;
  std::vector<Part> parts_;
  ComponentUnits units_;                       ///< of the components, in the numbering of the band if there is one
  Eigen::MatrixXd hessian_, matrix_, single_;  ///< H_zz, and the matrices of a pair and of a real eigenvalue
  Eigen::VectorXd gradient_, rhs_;
  Rows result_;
};

}  // namespace rubato
