#include <rubato/solve/singular_vectors.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <rubato/solve/damped_least_squares.hpp>
#include <rubato/solve/orthonormal.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {

using Eigen::Index;
using Eigen::MatrixXd;

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
  std::vector<double> logarithms(static_cast<std::size_t>(V.cols()));
  const auto orthonormalise_columns = [&] {
    return orthonormalise({V.data(), static_cast<std::size_t>(V.size())}, logarithms.size(), logarithms);
  };
  for (int iteration = 0; iteration < tuning::singular_vectors::iterations; ++iteration) {
    if (!orthonormalise_columns() || factors.solve_normal(V, V) != Status::success) {
      return std::nullopt;
    }
  }
  if (!orthonormalise_columns()) {
    return std::nullopt;
  }
  const SingularValues<MatrixXd> small = singular_values(MatrixXd(J * V));
  return SingularVectors{small.values.reverse(), product(V, small.vectors.rowwise().reverse())};
}

}  // namespace rubato::solve
