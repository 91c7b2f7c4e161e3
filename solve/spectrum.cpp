#include <rubato/solve/spectrum.hpp>

#include <limits>

#include <Eigen/Eigenvalues>

namespace rubato::solve {

Eigenvectors eigenvectors(const Eigen::MatrixXd& A) {
  if (!A.allFinite()) {
    constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
    return {Eigen::VectorXcd::Constant(A.rows(), undefined), Eigen::MatrixXcd::Constant(A.rows(), A.cols(), undefined)};
  }
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
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
