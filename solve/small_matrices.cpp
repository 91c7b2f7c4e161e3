#include <rubato/solve/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <unsupported/Eigen/MatrixFunctions>

#include <rubato/solve/tuning.hpp>

namespace rubato::solve {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

template <typename Matrix>
SingularValues<Matrix> singular_values_of(const Matrix& A) {
  const Index rows = A.rows(), columns = A.cols();
  if (rows == 0 || columns == 0) {
    return {Eigen::VectorXd::Zero(columns), Matrix::Identity(columns, columns)};
  }
  // Of a square matrix with the same AᴴA: RPᵀ of AP = QR, or A with rows of zeros. For other shapes Eigen would
  // instantiate three more decompositions.
  Matrix square = Matrix::Zero(columns, columns);
  if (rows > columns) {
    const Eigen::ColPivHouseholderQR<Matrix> qr(A);
    square = qr.matrixQR().topRows(columns).template triangularView<Eigen::Upper>();
    square = (square * qr.colsPermutation().inverse()).eval();
  } else {
    square.topRows(rows) = A;
  }
  const Eigen::JacobiSVD<Matrix, Eigen::NoQRPreconditioner> svd(square, Eigen::ComputeFullV);
  return {svd.singularValues(), svd.matrixV()};
}

}  // namespace

MatrixXd product_of(const MatrixXd& A, const MatrixXd& B) {
  return A * B;
}
MatrixXcd product_of(const MatrixXcd& A, const MatrixXcd& B) {
  return A * B;
}

std::optional<MatrixXd> quotient(const MatrixXd& A, const MatrixXd& B, double threshold) {
  if (A.rows() == 0) {
    return B;
  }
  if (!A.allFinite()) {
    return std::nullopt;
  }
  Eigen::FullPivLU<MatrixXd> lu(A);
  lu.setThreshold(threshold);
  if (!lu.isInvertible()) {
    return std::nullopt;
  }
  return lu.solve(B);
}

MatrixXd least_squares(const MatrixXd& A, const MatrixXd& B) {
  return A.completeOrthogonalDecomposition().solve(B);
}

Inverse inverse_of(const MatrixXcd& A) {
  if (A.rows() == 0) {
    return {A, 1.0, std::numeric_limits<double>::infinity(), 0.0};
  }
  const Eigen::PartialPivLU<MatrixXcd> lu(A);
  const Eigen::VectorXd pivots = lu.matrixLU().diagonal().cwiseAbs();
  return {lu.inverse(), lu.determinant(), pivots.minCoeff(), pivots.maxCoeff()};
}

Inverse equilibrated_inverse_of(const MatrixXcd& A) {
  const Equilibration scale = equilibrate(A.cwiseAbs());
  Inverse result = inverse_of(scale.rows.asDiagonal() * A * scale.columns.asDiagonal());
  result.matrix = (scale.columns.asDiagonal() * result.matrix * scale.rows.asDiagonal()).eval();
  return result;
}

bool annihilates(const MatrixXcd& A, const MatrixXcd& B) {
  const MatrixXcd product = A * B;
  const MatrixXd terms = A.cwiseAbs() * B.cwiseAbs();
  return (product.cwiseAbs().array() <= tuning::small_matrices::cancelled_product * terms.array()).all();
}

Equilibration equilibrate(MatrixXd sizes) {
  Equilibration scale{Eigen::VectorXd::Ones(sizes.rows()), Eigen::VectorXd::Ones(sizes.cols())};
  const auto inverse_root = [](double x) { return x > 0.0 ? std::ldexp(1.0, -std::ilogb(x) / 2) : 1.0; };
  for (int sweep = 0; sweep < tuning::small_matrices::equilibration_sweeps && sizes.size() > 0; ++sweep) {
    const Eigen::VectorXd rows = sizes.rowwise().maxCoeff().unaryExpr(inverse_root);
    const Eigen::VectorXd columns = sizes.colwise().maxCoeff().transpose().unaryExpr(inverse_root);
    if ((rows.array() == 1.0).all() && (columns.array() == 1.0).all()) {
      break;
    }
    scale.rows.array() *= rows.array();
    scale.columns.array() *= columns.array();
    sizes = (rows.asDiagonal() * sizes * columns.asDiagonal()).eval();
  }
  return scale;
}

MatrixXcd exponential_of(const MatrixXcd& A) {
  if (!A.allFinite()) {
    return MatrixXcd::Constant(A.rows(), A.cols(), std::numeric_limits<double>::quiet_NaN());
  }
  return A.exp();
}

SingularValues<MatrixXd> singular_values(const MatrixXd& A) {
  return singular_values_of(A);
}
SingularValues<MatrixXcd> singular_values(const MatrixXcd& A) {
  return singular_values_of(A);
}

}  // namespace rubato::solve
