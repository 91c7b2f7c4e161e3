#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/grids/buffer.hpp>
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
  /// \param fields whose entries are wanted, in rising order
  WaveResolvent(const MultisymplecticSystem& system, std::span<const std::vector<double>> derivatives,
                const Eigen::MatrixXd& L, double radius, const std::vector<int>& fields);
  static constexpr double reach = 8.0;
  [[nodiscard]] double radius() const { return radius_; }

  [[nodiscard]] std::size_t waves() const { return waves_; }
  /// Success, or `undefined` where P is singular on some wave in spite of the conditions.
  [[nodiscard]] Status status() const { return status_; }

  /// True if the entry is 0 on all waves.
  [[nodiscard]] bool is_zero(int row, int column) const {
    return adjoint_[follows(row, column) ? place(column, row) : place(row, column)].is_zero();
  }
  /// 1/D(μ), and the entry of A(μ), on the waves [begin, begin + count), a block of them at most.
  ///@{
  void inverse(std::complex<double> mu, std::size_t begin, std::size_t count, WaveBlock& inverse) const;
  void entry(int row, int column, std::complex<double> mu, std::size_t begin, std::size_t count,
             WaveBlock& entry) const;
  ///@}

private:
  [[nodiscard]] std::size_t place(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(fields_) + static_cast<std::size_t>(column);
  }

  /// True if the entry is that of the other side of the diagonal.
  [[nodiscard]] bool follows(int row, int column) const { return has_mirror_ && row > column; }

  /// Coefficients of (μ/radius)^k, one for each wave. Most parts are zero on all waves: those have no array, and take
  /// no memory before that shows.
  struct Polynomial {
    std::vector<grids::Buffer> re, im;

    Polynomial() = default;
    Polynomial(int points, std::size_t waves);
    [[nodiscard]] bool is_zero() const;
    void drop_zeros();
  };
  class Coefficients;
  void evaluate(const Polynomial& polynomial, std::complex<double> mu, std::size_t begin, std::size_t count,
                WaveBlock& value) const;

  int fields_;
  double radius_;
  std::size_t waves_;
  Status status_ = Status::success;
  bool has_mirror_;                  ///< whether entries below the diagonal follow from those above
  std::vector<Polynomial> adjoint_;  ///< [row·d + column]
  Polynomial determinant_;
};

}  // namespace rubato
