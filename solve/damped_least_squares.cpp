#include <rubato/solve/damped_least_squares.hpp>

#include <algorithm>
#include <vector>

#include <Eigen/SparseCholesky>

namespace rubato::solve {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::SparseMatrix;
using Eigen::VectorXd;

Status DampedLeastSquares::factor(const SparseMatrix<double>& J, double damping) {
  const Index rows = J.rows(), columns = J.cols();
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(static_cast<std::size_t>(2 * J.nonZeros() + rows + columns));
  for (Index column = 0; column < columns; ++column) {
    for (SparseMatrix<double>::InnerIterator entry(J, column); entry; ++entry) {
      entries.emplace_back(entry.row(), rows + column, entry.value());
      entries.emplace_back(rows + column, entry.row(), entry.value());
    }
  }
  for (Index i = 0; i < rows + columns; ++i) {
    entries.emplace_back(i, i, i < rows ? damping : -damping);
  }
  SparseMatrix<double> matrix(rows + columns, rows + columns);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const Status status = factors_.factor(matrix);
  return status == Status::singular ? Status::ill_conditioned : status;
}

Status DampedLeastSquares::solve(const VectorXd& r, VectorXd& x) {
  VectorXd right = VectorXd::Zero(factors_.size());
  right.head(r.size()) = -r;
  const VectorXd both = factors_.solve(right);
  x = both.tail(right.size() - r.size());
  return x.allFinite() ? Status::success : Status::ill_conditioned;
}

Status DampedLeastSquares::solve_normal(const MatrixXd& B, MatrixXd& X) {
  MatrixXd right = MatrixXd::Zero(factors_.size(), B.cols());
  right.bottomRows(B.rows()) = -B;
  X = factors_.solve(right).bottomRows(B.rows());
  return X.allFinite() ? Status::success : Status::ill_conditioned;
}

std::optional<std::size_t> eigenvalues_below(const SparseMatrix<double>& matrix, double shift) {
  Eigen::SimplicialLDLT<SparseMatrix<double>> factors;
  factors.setShift(-shift);
  factors.compute(matrix);
  if (factors.info() != Eigen::Success) {
    return std::nullopt;
  }
  const VectorXd pivots = factors.vectorD();
  if (!pivots.allFinite()) {
    return std::nullopt;
  }
  return static_cast<std::size_t>(std::ranges::count_if(pivots, [](double pivot) { return pivot < 0.0; }));
}

}  // namespace rubato::solve
