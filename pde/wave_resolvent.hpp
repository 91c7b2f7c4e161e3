#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/wave_rows.hpp>

namespace rubato {

/// What inverts the linear part of a spectral scheme: on the wave with the symbols ik_a of ∂_a
///
///     P(μ) = μ M + Σ_a ik_a K_a - L
///
/// is a d × d matrix, and by Cramer's rule P(μ)⁻¹ = A(μ)/D(μ), D and the entries of A polynomials in μ of degree
/// rank M. Their coefficients are found once for each wave, from rank M + 1 values of μ; then P⁻¹ at any other μ, that
/// is for any step, costs a few products.
///
/// M and K_a are skew and L is symmetric, so that P(μ)ᴴ = P(-μ̄): entries below the diagonal follow from those above,
/// A_rc(μ) = conj A_cr(-μ̄), where no condition borders P.
///
/// Where P is singular for every μ (on the constant, and where else no derivative sees it: KdV, BBM, … in potential
/// form), the solution meant is that in which the mean of each potential involved is 0 (wave_conditions), and a right
/// side off the range of P counts as its projection.
class WaveResolvent {
public:
  /// \param derivatives k_a of each wave, an array for each axis
  /// \param L symmetric, the part of S'' that is the same everywhere
  /// \param radius about |μ|, where the polynomials are to be good: within a factor of `reach`
  WaveResolvent(const MultisymplecticSystem& system, std::span<const std::vector<double>> derivatives,
                const Eigen::MatrixXd& L, double radius);
  static constexpr double reach = 8.0;
  [[nodiscard]] double radius() const { return radius_; }

  [[nodiscard]] std::size_t waves() const { return waves_; }
  /// Success, or `undefined` where P is singular on some wave in spite of the conditions.
  [[nodiscard]] Status status() const { return status_; }

  /// 1/D(μ) on every wave.
  void start(std::complex<double> mu, WaveRows& inverse) const;
  /// True if the entry is 0 on all waves.
  [[nodiscard]] bool is_zero(int row, int column) const { return zero_[place(row, column)]; }
  /// The entry of P(μ)⁻¹ on the waves [begin, begin + count); `inverse` from start().
  void entry(int row, int column, std::complex<double> mu, const WaveRows& inverse, std::size_t begin,
             std::size_t count, double* re, double* im) const;

private:
  [[nodiscard]] std::size_t place(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(fields_) + static_cast<std::size_t>(column);
  }

  void polynomial(const WaveRows& coefficients, std::complex<double> mu, std::size_t begin, std::size_t count,
                  double* re, double* im) const;

  int fields_, degree_;
  double radius_;
  std::size_t waves_;
  Status status_ = Status::success;
  bool has_mirror_;                ///< whether entries below the diagonal follow from those above
  std::vector<WaveRows> adjoint_;  ///< [row·d + column]: coefficients of (μ/radius)^k; without rows where it is zero,
                                   ///< or follows
  WaveRows determinant_;
  std::vector<bool> zero_;
};

}  // namespace rubato
