// Inverses, determinants and exponentials of small complex matrices.

#include <cmath>
#include <complex>
#include <random>

#include <Eigen/LU>
#include <catch2/catch.hpp>

#include <rubato/solve/small_matrices.hpp>
#include <rubato/solve/spectrum.hpp>

using namespace rubato;
using Complex = std::complex<double>;
using Eigen::MatrixXcd;

namespace {

MatrixXcd random_matrix(int size, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  MatrixXcd A(size, size);
  for (Complex& entry : A.reshaped()) {
    entry = {value(random), value(random)};
  }
  return A;
}

}  // namespace

TEST_CASE("inverses and determinants of small matrices are Eigen's") {
  for (const int size : {1, 2, 4, 9}) {
    const MatrixXcd A = random_matrix(size, 5);
    const solve::Inverse inverse = solve::inverse_of(A);
    // Random matrices of this size have a condition below 1e3.
    CHECK((inverse.matrix * A - MatrixXcd::Identity(size, size)).norm() < 1e-12);
    CHECK(std::abs(inverse.determinant - A.determinant()) < 1e-12 * std::abs(A.determinant()));
    CHECK(inverse.smallest_pivot > 0.0);
  }
  MatrixXcd singular = random_matrix(3, 7);
  singular.row(2) = singular.row(0) + Complex(0, 1) * singular.row(1);
  const solve::Inverse none = solve::inverse_of(singular);
  CHECK(none.smallest_pivot < 1e-14 * none.largest_pivot);
}

TEST_CASE("the exponential of a small matrix is that of its eigenvalues") {
  // A turn: exp([[0, w], [-w, 0]]) has cos w and sin w, for small and large w.
  for (const double w : {1e-3, 1.0, 40.0}) {
    MatrixXcd A = MatrixXcd::Zero(2, 2);
    A(0, 1) = w, A(1, 0) = -w;
    const MatrixXcd E = solve::exponential_of(A);
    // Squaring loses a factor 2 in each of log2(2w) < 7 turns.
    CHECK(std::abs(E(0, 0) - std::cos(w)) < 1e-13);
    CHECK(std::abs(E(0, 1) - std::sin(w)) < 1e-13);
  }
  // A Jordan block, and A with -A.
  MatrixXcd jordan = MatrixXcd::Zero(2, 2);
  jordan << 0.3, 1.0, 0.0, 0.3;
  CHECK(std::abs(solve::exponential_of(jordan)(0, 1) - std::exp(0.3)) < 1e-15);
  const MatrixXcd A = random_matrix(5, 9);
  CHECK((solve::exponential_of(A) * solve::exponential_of(-A) - MatrixXcd::Identity(5, 5)).norm() < 1e-12);
  CHECK((solve::exponential_of(A) * solve::exponential_of(A) - MatrixXcd::Identity(5, 5)).norm() > 0.1);
}

TEST_CASE("eigenvalues do not depend on the units of rows and columns") {
  // Of a turn by an angle, of a position and a momentum in units that are far apart.
  const double c = std::cos(0.3), s = std::sin(0.3);
  for (const double unit : {1.0, 1e-10, 1e20}) {
    INFO(unit);
    Eigen::MatrixXd A(4, 4);
    A << c, 0, s / unit, 0, 0, 2, 0, 1 / unit, -s * unit, 0, c, 0, 0, unit, 0, 1;
    const solve::Eigenvectors eigen = solve::eigenvectors(A);
    const auto nearest = [&](std::complex<double> to) { return (eigen.values.array() - to).abs().minCoeff(); };
    CHECK(nearest({c, s}) < 1e-14);
    CHECK(nearest({1.5 + std::sqrt(1.25), 0.0}) < 1e-14);
    const Eigen::MatrixXcd rest = A * eigen.vectors - eigen.vectors * eigen.values.asDiagonal();
    CHECK((rest.array().abs() <= 1e-14 * (A.cwiseAbs() * eigen.vectors.cwiseAbs()).array().abs()).all());
    CHECK(nearest({c, -2.0 * s}) > 0.1);  // the twin
  }
}
