#pragma once

#include <vector>

#include <Eigen/Core>

namespace rubato {

/// An entry of M, of a K_a or of another small matrix that is not 0: sweeps and laws go through these alone.
struct MatrixTerm {
  int row, column;
  double value;
};
using MatrixTerms = std::vector<MatrixTerm>;

/// The entries of `matrix` that are not 0, row by row.
[[nodiscard]] inline MatrixTerms terms_of(const Eigen::MatrixXd& matrix) {
  MatrixTerms terms;
  for (int i = 0; i < matrix.rows(); ++i) {
    for (int j = 0; j < matrix.cols(); ++j) {
      if (matrix(i, j) != 0.0) {
        terms.push_back({i, j, matrix(i, j)});
      }
    }
  }
  return terms;
}

}  // namespace rubato
