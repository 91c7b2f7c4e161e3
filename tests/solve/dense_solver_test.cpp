#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include <Eigen/Dense>
#include <catch2/catch.hpp>
#include <rubato/solve/dense_solver.hpp>

using namespace rubato;
using solve::DenseSolver;

namespace {

Eigen::MatrixXd random_matrix(int rows, int columns, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return uniform(engine); });
}

/// ‖A x - b‖ / (‖A‖ ‖x‖), the quantity that backward stability bounds by a small multiple of n ε.
double backward_error(const Eigen::MatrixXd& a, const Eigen::MatrixXd& x, const Eigen::MatrixXd& b) {
  return (a * x - b).norm() / (a.norm() * x.norm());
}

// The growth factor of partial pivoting on random matrices is below n^(2/3); the rest is the usual n ε.
double tolerance(int n) {
  return 10.0 * std::pow(n, 5.0 / 3.0) * std::numeric_limits<double>::epsilon();
}

}  // namespace

TEST_CASE("dense systems of every size and several right-hand sides are solved backward stably") {
  const int n = GENERATE(1, 2, 3, 4, 5, 6, 7, 8, 9, 13, 16, 17, 40, 150);
  const Eigen::MatrixXd a = random_matrix(n, n, 7u + n);
  const Eigen::MatrixXd b = random_matrix(n, 3, 1000u + n);
  DenseSolver solver(n);
  REQUIRE(solver.factor(a.data()) == Status::success);
  Eigen::MatrixXd x = b;
  solver.solve(x.data(), 3);
  CHECK(backward_error(a, x, b) < tolerance(n));
  Eigen::VectorXd single = b.col(1);
  solver.solve(single.data());
  CHECK(backward_error(a, single, b.col(1)) < tolerance(n));
  // Twin: the solution of a matrix with one entry off by 1e-6 is distinguished.
  Eigen::MatrixXd wrong = a;
  wrong(n - 1, 0) += 1e-6;
  CHECK(backward_error(wrong, x, b) > tolerance(n));
}

TEST_CASE("rows are exchanged where the diagonal is small or zero") {
  const int n = GENERATE(2, 4, 6, 10, 30);
  // A cyclic shift plus a tiny diagonal: without exchanges the growth is 1e17 and every digit is lost.
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  for (int i = 0; i < n; ++i) {
    a(i, (i + 1) % n) = 1.0 + 0.1 * i;
    a(i, i) += 1e-17;
  }
  const Eigen::VectorXd b = random_matrix(n, 1, 3);
  DenseSolver solver(n);
  REQUIRE(solver.factor(a.data()) == Status::success);
  Eigen::VectorXd x = b;
  solver.solve(x.data());
  CHECK(backward_error(a, x, b) < tolerance(n));
  // Twin: elimination in the given order.
  Eigen::MatrixXd lu = a;
  for (int k = 0; k < n; ++k) {
    for (int i = k + 1; i < n; ++i) {
      lu(i, k) /= lu(k, k);
      lu.row(i).tail(n - k - 1) -= lu(i, k) * lu.row(k).tail(n - k - 1);
    }
  }
  Eigen::VectorXd y = b;
  lu.triangularView<Eigen::UnitLower>().solveInPlace(y);
  lu.triangularView<Eigen::Upper>().solveInPlace(y);
  CHECK_FALSE(backward_error(a, y, b) < tolerance(n));
}

TEST_CASE("singular and undefined matrices are reported, and the solver recovers") {
  const int n = GENERATE(1, 2, 3, 4, 8, 12, 24);
  DenseSolver solver(n);
  const Eigen::MatrixXd good = random_matrix(n, n, 5);
  Eigen::MatrixXd a = good;
  a.row(n - 1).setZero();
  CHECK(solver.factor(a.data()) == Status::singular);
  CHECK(solver.rcond_estimate() == 0.0);
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (int place = 0; place < n * n; place += std::max(1, n * n / 17)) {
      a = good;
      a.data()[place] = bad;
      CHECK(solver.factor(a.data()) == Status::undefined);
    }
  }
  CHECK(solver.factor(good.data()) == Status::success);
}

TEST_CASE("a size outside 1 to 4096 is refused with its value") {
  CHECK_THROWS_WITH(DenseSolver(0), Catch::Contains("not 0"));
  CHECK_THROWS_AS(DenseSolver(5000), std::invalid_argument);
}

TEST_CASE("the conditioning estimate follows the conditioning") {
  const int n = GENERATE(2, 3, 4, 8, 12, 30);
  for (const double smallest : {1.0, 1e-4, 1e-8, 1e-12}) {
    // Orthogonal · diag(1, …, 1, smallest) · orthogonal: 1/cond is `smallest`. The pivots of such a matrix follow it
    // within a factor of the size of its entries; 300 is ample for n ≤ 30, and far from the next value tried.
    const Eigen::MatrixXd left = random_matrix(n, n, 1).householderQr().householderQ();
    const Eigen::MatrixXd right = random_matrix(n, n, 2).householderQr().householderQ();
    Eigen::VectorXd values = Eigen::VectorXd::Ones(n);
    values(n - 1) = smallest;
    const Eigen::MatrixXd a = left * values.asDiagonal() * right;
    DenseSolver solver(n);
    REQUIRE(solver.factor(a.data()) == Status::success);
    CHECK(solver.rcond_estimate() < 300.0 * smallest);
    CHECK(solver.rcond_estimate() > smallest / 300.0);
  }
}
