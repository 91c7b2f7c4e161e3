#pragma once

#include <complex>
#include <optional>

#include <Eigen/Core>

/// \file
/// Algorithms for matrices of a few rows and columns, compiled once. Eigen's own are templates made for large matrices:
/// each takes a second or more to compile wherever it is used, for every kind of argument. Not for the inside of loops.

namespace rubato::solve {

[[nodiscard]] Eigen::MatrixXd product_of(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
[[nodiscard]] Eigen::MatrixXcd product_of(const Eigen::MatrixXcd& A, const Eigen::MatrixXcd& B);
/// AB, of matrices or expressions, real or complex.
template <typename Left, typename Right>
[[nodiscard]] auto product(const Eigen::MatrixBase<Left>& A, const Eigen::MatrixBase<Right>& B) {
  using Matrix = Eigen::Matrix<typename Left::Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  return product_of(Matrix(A), Matrix(B));
}

/// A⁻¹B by elimination with complete pivoting. Nothing if a pivot is 0, below `threshold` times the largest one, or not
/// finite. Hypothesis: A is square and has as many rows as B.
[[nodiscard]] std::optional<Eigen::MatrixXd> quotient(Eigen::MatrixXd A, Eigen::MatrixXd B, double threshold = 0.0);

/// A⁻¹ and what elimination with partial pivoting says of A. Hypothesis: A is square.
struct Inverse {
  Eigen::MatrixXcd matrix;  ///< not finite where a pivot is 0
  std::complex<double> determinant = 1.0;
  double smallest_pivot = 0.0, largest_pivot = 0.0;
};
[[nodiscard]] Inverse inverse_of(Eigen::MatrixXcd A);

/// exp(A), by Taylor's series of A/2ᵏ and k squarings.
[[nodiscard]] Eigen::MatrixXcd exponential_of(Eigen::MatrixXcd A);

/// max |λ| over the eigenvalues λ of A, by Gelfand's formula lim |Aᵏ|^(1/k) over squarings of A; to about 1e-8 where
/// eigenvalues are multiple, as for any method. NaN if an entry is not finite.
[[nodiscard]] double spectral_radius(Eigen::MatrixXd A);

/// A = UΣVᴴ as AV = UΣ.
template <typename Matrix>
struct SingularValues {
  Eigen::VectorXd values;  ///< Σ, decreasing; as many as A has columns
  Matrix vectors;          ///< V, unitary
  Matrix images;           ///< AV, whose columns are orthogonal
};

/// By Hestenes' one-sided rotations: small values come with small relative errors as far as A has them. Hypothesis: all
/// entries are finite, none beyond 1e150.
[[nodiscard]] SingularValues<Eigen::MatrixXd> singular_values(Eigen::MatrixXd A);
[[nodiscard]] SingularValues<Eigen::MatrixXcd> singular_values(Eigen::MatrixXcd A);

}  // namespace rubato::solve
