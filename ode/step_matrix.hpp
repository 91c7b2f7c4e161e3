#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
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
      : factors_(static_cast<int>(2 * hamiltonian.degrees_of_freedom())) {
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
    matrix_.diagonal().array() += 1.0;
    return factors_.factor(matrix_.data());
  }
  void solve(double* rhs) const { factors_.solve(rhs); }
  [[nodiscard]] double stiffness() const { return stiffness_; }

private:
  using Matrix = Eigen::Matrix<double, Size, Size>;
  std::conditional_t<Size == Eigen::Dynamic, solve::DenseSolver, solve::FixedSolver<std::max(Size, 1)>> factors_;
  Eigen::Matrix<double, Size, 1> gradient_;
  Matrix hessian_, matrix_;
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
  double stiffness_ = 0.0;
};

}  // namespace rubato
