#include <rubato/solve/spectrum.hpp>

#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues>

namespace rubato::solve {

namespace {

/// Makes of A the similar D⁻¹ A D whose rows and columns are about as large, D of powers of two (Parlett and Reinsch,
/// Numer. Math. 13, 1969). \return D
Eigen::VectorXd balance(Eigen::MatrixXd& A) {
  Eigen::VectorXd D = Eigen::VectorXd::Ones(A.rows());
  constexpr int most_sweeps = 100;
  bool is_balanced = false;
  for (int sweep = 0; sweep < most_sweeps && !is_balanced; ++sweep) {
    is_balanced = true;
    for (Eigen::Index i = 0; i < A.rows(); ++i) {
      const double own = std::abs(A(i, i)), column = A.col(i).cwiseAbs().sum() - own,
                   row = A.row(i).cwiseAbs().sum() - own;
      if (!(column > 0.0) || !(row > 0.0)) {
        continue;
      }
      constexpr double counts = 0.95;
      const double factor = std::exp2(std::round(0.5 * std::log2(row / column)));
      if (column * factor + row / factor < counts * (column + row)) {
        A.col(i) *= factor;
        A.row(i) /= factor;
        D(i) *= factor;
        is_balanced = false;
      }
    }
  }
  return D;
}

}  // namespace

Eigenvectors eigenvectors(const Eigen::MatrixXd& A) {
  if (!A.allFinite()) {
    constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
    return {Eigen::VectorXcd::Constant(A.rows(), undefined), Eigen::MatrixXcd::Constant(A.rows(), A.cols(), undefined)};
  }
  Eigen::MatrixXd balanced = A;
  const Eigen::VectorXd D = balance(balanced);
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(balanced);
  return {solver.eigenvalues(), (D.asDiagonal() * solver.eigenvectors()).colwise().normalized()};
}

double spectral_radius(const Eigen::MatrixXd& A) {
  return A.size() == 0 ? 0.0 : eigenvectors(A).values.cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
}

Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& A) {
  if (!A.allFinite()) {
    return Eigen::VectorXd::Constant(A.rows(), std::numeric_limits<double>::quiet_NaN());
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues();
}

}  // namespace rubato::solve
