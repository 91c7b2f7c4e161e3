#include <rubato/solve/singular_vectors.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/solve/damped_least_squares.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

/// By Gram and Schmidt, twice. False where a column depends on those before.
bool orthonormalise(MatrixXd& columns) {
  for (Index j = 0; j < columns.cols(); ++j) {
    for (int time = 0; time < 2; ++time) {
      for (Index i = 0; i < j; ++i) {
        columns.col(j) -= columns.col(i).dot(columns.col(j)) * columns.col(i);
      }
      const double length = columns.col(j).norm();
      if (!(length > 0.0) || !std::isfinite(length)) {
        return false;
      }
      columns.col(j) /= length;
    }
  }
  return true;
}

}  // namespace

std::optional<SingularVectors> smallest_singular_vectors(const Eigen::SparseMatrix<double>& J, Index count) {
  DampedLeastSquares factors;
  if (factors.factor(J, tuning::singular_vectors::damping) != Status::success) {
    return std::nullopt;
  }
  MatrixXd V(J.cols(), std::min(count, J.cols()));
  for (Index j = 0; j < V.cols(); ++j) {
    for (Index i = 0; i < V.rows(); ++i) {  // of many waves
      V(i, j) = std::cos(1.7 * static_cast<double>(i * (j + 1) % 1009) + static_cast<double>(j));
    }
  }
  for (int iteration = 0; iteration < tuning::singular_vectors::iterations; ++iteration) {
    if (!orthonormalise(V) || factors.solve_normal(V, V) != Status::success) {
      return std::nullopt;
    }
  }
  if (!orthonormalise(V)) {
    return std::nullopt;
  }
  const SingularValues<MatrixXd> small = singular_values(MatrixXd(J * V));
  return SingularVectors{small.values.reverse(), product(V, small.vectors.rowwise().reverse())};
}

}  // namespace rubato::solve
