#pragma once

#include <complex>
#include <optional>

#include <Eigen/Core>

/// \file
/// Eigen's decompositions of small dense matrices, instantiated in one source because each takes seconds to compile.
/// They allocate: not for the inside of loops.

namespace rubato::solve {

[[nodiscard]] Eigen::MatrixXd product_of(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
[[nodiscard]] Eigen::MatrixXcd product_of(const Eigen::MatrixXcd& A, const Eigen::MatrixXcd& B);
/// AB, of matrices or expressions, real or complex.
template <typename Left, typename Right>
[[nodiscard]] auto product(const Eigen::MatrixBase<Left>& A, const Eigen::MatrixBase<Right>& B) {
  using Matrix = Eigen::Matrix<typename Left::Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  return product_of(Matrix(A), Matrix(B));
}

/// True if all entries of AB are 0 but for rounding errors of their terms.
[[nodiscard]] bool annihilates(const Eigen::MatrixXcd& A, const Eigen::MatrixXcd& B);

/// Powers of 2 that make the largest entry of each row and column about 1 when rows and columns are multiplied by them
/// (Ruiz 2001): equations and unknowns have units of their own. Those of zeros keep 1.
struct Equilibration {
  Eigen::VectorXd rows, columns;
};
/// The equilibration of the matrix with these absolute values.
[[nodiscard]] Equilibration equilibrate(Eigen::MatrixXd sizes);

/// Returns A⁻¹B by LU factorisation with complete pivoting; nothing if an entry of A is not finite or a pivot is not
/// above `threshold` times the largest one. Precondition: A is square and has as many rows as B.
[[nodiscard]] std::optional<Eigen::MatrixXd> quotient(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                                      double threshold = 0.0);

/// Returns the X of least norm among those that make ‖AX - B‖ least, by complete orthogonal decomposition.
[[nodiscard]] Eigen::MatrixXd least_squares(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

/// The inverse, the determinant and the pivots of a square matrix, by LU factorisation with partial pivoting.
struct Inverse {
  Eigen::MatrixXcd matrix;  ///< not finite where a pivot is 0
  std::complex<double> determinant = 1.0;
  double smallest_pivot = 0.0, largest_pivot = 0.0;
};
[[nodiscard]] Inverse inverse_of(const Eigen::MatrixXcd& A);
/// The same by elimination in the equilibrated matrix, whose determinant and pivots are returned.
[[nodiscard]] Inverse equilibrated_inverse_of(const Eigen::MatrixXcd& A);

/// Returns exp(A), by Padé approximation with scaling and squaring; NaN in every entry if one of A is not finite.
[[nodiscard]] Eigen::MatrixXcd exponential_of(const Eigen::MatrixXcd& A);

/// Σ and V of A = UΣVᴴ: the columns of AV are orthogonal, and as long as Σ says.
template <typename Matrix>
struct SingularValues {
  Eigen::VectorXd values;  ///< Σ, decreasing; as many as A has columns
  Matrix vectors;          ///< V, unitary
};

/// Returns the singular values of A by two-sided Jacobi rotations. Precondition: all entries are finite.
[[nodiscard]] SingularValues<Eigen::MatrixXd> singular_values(const Eigen::MatrixXd& A);
[[nodiscard]] SingularValues<Eigen::MatrixXcd> singular_values(const Eigen::MatrixXcd& A);

}  // namespace rubato::solve
