#pragma once

#include <Eigen/Core>

/// \file
/// Eigenvalues of small dense matrices, instantiated in one source (as small_matrices.hpp). They allocate.

namespace rubato::solve {

/// A v_i = λ_i v_i.
struct Eigenvectors {
  Eigen::VectorXcd values;
  Eigen::MatrixXcd vectors;  ///< of length 1, a column for each
};
/// The eigenvalues and eigenvectors of a real square matrix, of which rows and columns may have units of their own; NaN
/// if an entry is not finite.
[[nodiscard]] Eigenvectors eigenvectors(const Eigen::MatrixXd& A);

/// Returns max |λ| over the eigenvalues λ of A: to about 1e-8 where they are multiple. NaN if an entry is not finite.
[[nodiscard]] double spectral_radius(const Eigen::MatrixXd& A);

/// The eigenvalues of a symmetric matrix, increasing; its lower triangle is read. NaN if an entry is not finite.
[[nodiscard]] Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& A);

}  // namespace rubato::solve
