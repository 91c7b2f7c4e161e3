#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/ode/component_units.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/hessian_band.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/solve/band_solver.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/solve/elimination.hpp>

/// \file
/// Matrices of Newton's iteration for a step of the midpoint rule (2.14), I - A with A = ½h J H_zz at one point. All
/// have
///
///     Status factor(HamiltonianEvaluator&, const double* point, double h)
///     void solve(double* rhs)      in place; hypothesis: the last factor() succeeded
///     double stiffness()           sqrt(Σ|A_ij A_ji|): about A's largest eigenvalue, in any units
///     refactor_ratio               relative change of h that asks for a new matrix before corrections are seen to
///                                  contract poorly: where a matrix costs little more than the iterations it saves

namespace rubato {

/// For 2n = Size rows, or any number where that is Eigen::Dynamic: LU of the whole matrix.
template <int Size>
class DenseStepMatrix {
public:
  static constexpr double refactor_ratio = Size == Eigen::Dynamic ? 0.1 : 1e-3;

  explicit DenseStepMatrix(const Hamiltonian& hamiltonian)
      : factors_(static_cast<int>(2 * hamiltonian.degrees_of_freedom())), units_(2 * hamiltonian.degrees_of_freedom()) {
    const auto size = static_cast<Eigen::Index>(2 * hamiltonian.degrees_of_freedom());
    gradient_.setZero(size);
    hessian_.setZero(size, size);
    matrix_.setZero(size, size);
  }

  [[nodiscard]] Status factor(HamiltonianEvaluator& hamiltonian, const double* point, double h) {
    hamiltonian.hessian(point, gradient_.data(), hessian_.data());
    const auto n = half_rows(hessian_);
    matrix_.topRows(n) = -0.5 * h * hessian_.bottomRows(n);
    matrix_.bottomRows(n) = 0.5 * h * hessian_.topRows(n);
    stiffness_ = std::sqrt(matrix_.cwiseProduct(matrix_.transpose()).cwiseAbs().sum());
    const double by_p = matrix_.topRightCorner(n, n).cwiseAbs().maxCoeff();
    const double by_q = matrix_.bottomLeftCorner(n, n).cwiseAbs().maxCoeff();
    // Of momenta a power of two, so that units do not choose the pivots.
    const double momenta = by_p > 0.0 && by_q > 0.0 ? std::ldexp(1.0, (std::ilogb(by_q) - std::ilogb(by_p)) >> 1) : 1.0;
    units_.begin(momenta);
    // With one degree of freedom either pivot is right.
    if constexpr (Size != 2) {
      units_.find([&](const auto& use) {
        for (Eigen::Index j = 0; j < matrix_.cols(); ++j) {
          for (Eigen::Index i = 0; i < matrix_.rows(); ++i) {
            use(i, j, matrix_(i, j));
          }
        }
      });
    }
    if (units_.differ()) {
      const auto units = this->units();
      matrix_ = units.cwiseInverse().asDiagonal() * matrix_ * units.asDiagonal();
    }
    matrix_.diagonal().array() += 1.0;
    return factors_.factor(matrix_.data());
  }
  void solve(double* rhs) const {
    if (!units_.differ()) {
      factors_.solve(rhs);
      return;
    }
    Eigen::Map<Eigen::Array<double, Size, 1>> x(rhs, matrix_.rows());
    x /= units().array();
    factors_.solve(rhs);
    x *= units().array();
  }
  [[nodiscard]] double stiffness() const { return stiffness_; }

private:
  using Matrix = Eigen::Matrix<double, Size, Size>;

  [[nodiscard]] auto units() const {
    return Eigen::Map<const Eigen::Matrix<double, Size, 1>>(units_.data(), matrix_.rows());
  }

  std::conditional_t<Size == Eigen::Dynamic, solve::DenseSolver, solve::FixedSolver<std::max(Size, 1)>> factors_;
  Eigen::Matrix<double, Size, 1> gradient_;
  Matrix hessian_, matrix_;
  ComponentUnits units_;
  double stiffness_ = 0.0;
};

/// For a Hamiltonian with a band: elimination within it.
class BandStepMatrix {
public:
  static constexpr double refactor_ratio = 1e-2;

  explicit BandStepMatrix(HessianBand band);

  [[nodiscard]] Status factor(HamiltonianEvaluator& hamiltonian, const double* point, double h);
  void solve(double* rhs);
  [[nodiscard]] double stiffness() const { return stiffness_; }

private:
  HessianBand band_;
  solve::BandSolver factors_;
  std::vector<double> ordered_;  ///< a right-hand side, in the numbering of the band
  ComponentUnits units_;         ///< in that numbering, too
  double stiffness_ = 0.0;
};

}  // namespace rubato
