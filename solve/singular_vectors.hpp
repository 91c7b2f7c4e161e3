#pragma once

#include <optional>

#include <Eigen/SparseCore>

namespace rubato::solve {

/// The smallest singular values of a sparse matrix, increasing, and their right singular vectors.
struct SingularVectors {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;  ///< a column of length 1 for each
};

/// Returns `count` of them (fewer where J has not so many columns), by block inverse iteration with JᵀJ + s² in the
/// factors of DampedLeastSquares: values below s, among them the 0 of each column that J has beyond its rank, are found
/// at once, others the better the further the next one is above them. Nothing where the factorisation fails.
[[nodiscard]] std::optional<SingularVectors> smallest_singular_vectors(const Eigen::SparseMatrix<double>& J,
                                                                       Eigen::Index count);

}  // namespace rubato::solve
