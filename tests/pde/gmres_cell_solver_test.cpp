#include <cmath>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include <Eigen/Dense>
#include <catch2/catch.hpp>

#include <rubato/grids/field_set.hpp>
#include <rubato/pde/cell_solver.hpp>

// The solver for planes, volumes and Fourier against a dense one.

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int size = 3;

/// The free fields u, a, b of a wave equation in the plane, with the entries of S'' at (u, u), and one at (a, b) and
/// (b, a), `strength` times a random function with mean 1.
struct Example {
  grids::Grid grid{{{"x", -1, 1, 7}, {"y", -1, 1, 5}}};
  grids::FieldSet values{2, 35};
  CellMatrix matrix;
  grids::FieldSet rhs{size, 35};

  explicit Example(double strength) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (double& value : values.all()) {
      value = strength * (1.0 + uniform(random));
    }
    for (double& value : rhs.all()) {
      value = uniform(random);
    }
    matrix.mean = MatrixXd::Zero(size, size);
    matrix.mean.diagonal() << -40.0, 1.0, 1.0;
    for (int a = 0; a < 2; ++a) {
      MatrixXd K = MatrixXd::Zero(size, size);
      K(0, 1 + a) = 1.0;
      K(1 + a, 0) = -1.0;
      matrix.difference.push_back(K);
    }
    matrix.entries = {
        {0, 0, -1.0, values.field(0).data()}, {1, 2, 0.1, values.field(1).data()}, {2, 1, 0.1, values.field(1).data()}};
  }

  /// One row for each equation in each cell, one column for each field at each node.
  [[nodiscard]] MatrixXd dense() const {
    const auto n = static_cast<Index>(grid.size());
    MatrixXd result = MatrixXd::Zero(size * n, size * n);
    for (std::size_t cell = 0; cell < grid.size(); ++cell) {
      const auto place = grid.place(cell);
      for (std::size_t corner = 0; corner < 4; ++corner) {
        const std::size_t right = corner % 2;
        const std::size_t up = corner / 2;
        const auto node =
            static_cast<Index>(grid.index((place[0] + right) % grid.cells(0), (place[1] + up) % grid.cells(1)));
        MatrixXd block = 0.25 * matrix.mean;
        block += (right == 1 ? 0.5 : -0.5) / grid.spacing(0) * matrix.difference[0];
        block += (up == 1 ? 0.5 : -0.5) / grid.spacing(1) * matrix.difference[1];
        for (const CellMatrix::Entry& entry : matrix.entries) {
          block(entry.row, entry.column) += 0.25 * entry.factor * entry.values[cell];
        }
        for (Index r = 0; r < size; ++r) {
          for (Index c = 0; c < size; ++c) {
            result(r * n + static_cast<Index>(cell), c * n + node) += block(r, c);
          }
        }
      }
    }
    return result;
  }

  [[nodiscard]] VectorXd solution() const {
    return dense().partialPivLu().solve(
        Eigen::Map<const VectorXd>(rhs.all().data(), static_cast<Index>(rhs.all().size())));
  }
};

/// ‖c - exact‖ / ‖exact‖ of the solver's c.
double error_of(CellSolver& solver, const Example& example, const VectorXd& exact) {
  grids::FieldSet c(size, example.grid.size());
  REQUIRE(solver.solve(example.matrix, {}, example.rhs.pointers(), c.pointers(), {}) == Status::success);
  const Eigen::Map<const VectorXd> found(std::as_const(c).all().data(), exact.size());
  return (found - exact).norm() / exact.norm();
}

}  // namespace

TEST_CASE("systems with varying coefficients are solved, checked ones to the tolerance of their residual") {
  // Weak: one inversion does; strong: entries that are 2.5 times as large as all constants beside them.
  for (const double strength : {1e-3, 1.0, 100.0}) {
    INFO("strength " << strength);
    const Example example(strength);
    const VectorXd exact = example.solution();
    const auto solver = make_gmres_cell_solver(example.grid, Collocation::cells, size, 1e-13);
    // The condition number of these matrices is below 1e3.
    CHECK(error_of(*solver, example, exact) < 1e-10);
    // Twin: the solution of a system with one entry changed by a part in 10^6 is another one.
    Example other(strength);
    other.values.field(0)[11] *= 1.0 + 1e-6;
    CHECK((other.solution() - exact).norm() > 1e-10 * strength / 40.0 * exact.norm());
    CHECK(error_of(*solver, other, exact) > 1e-2 * (other.solution() - exact).norm() / exact.norm());
  }
}

TEST_CASE("solutions that nobody checks are as good as asked, and their error is told") {
  for (const double strength : {1e-3, 1.0, 100.0}) {
    INFO("strength " << strength);
    const Example example(strength);
    const VectorXd exact = example.solution();
    double coarse = 0.0;
    for (const double tolerance : {1e-3, 1e-6, 1e-9}) {
      const auto solver = make_gmres_cell_solver(example.grid, Collocation::cells, size, tolerance);
      solver->check_residuals(false);
      const double error = error_of(*solver, example, exact);
      // What is reported is an estimate in the fields that vary, within a factor of the condition.
      CHECK(solver->error() <= tolerance);
      CHECK(error <= 30.0 * solver->error() + 1e-13);
      coarse = std::max(coarse, error);
    }
    // Twin: what was asked for makes a difference where the coefficients vary.
    CHECK((strength < 1.0 || coarse > 1e-9));
  }
}

TEST_CASE("a system whose constants change a little needs no new inversion and gets its own solution") {
  Example example(1.0);
  const auto solver = make_gmres_cell_solver(example.grid, Collocation::cells, size, 1e-12);
  const VectorXd before = example.solution();
  CHECK(error_of(*solver, example, before) < 1e-10);
  example.matrix.mean(0, 0) *= 1.0 + 1e-7;
  example.matrix.mean(2, 0) += 1e-6;
  const VectorXd after = example.solution();
  CHECK(error_of(*solver, example, after) < 1e-10);
  CHECK((after - before).norm() > 1e-8 * after.norm());  // twin
  example.matrix.mean(0, 0) *= 2.0;                      // and a large change gets one
  CHECK(error_of(*solver, example, example.solution()) < 1e-10);
}

TEST_CASE("a matrix that is not finite is undefined") {
  Example example(1.0);
  const auto solver = make_gmres_cell_solver(example.grid, Collocation::cells, size, 1e-12);
  example.values.field(0)[3] = std::nan("");
  grids::FieldSet c(size, example.grid.size());
  CHECK(solver->solve(example.matrix, {}, std::as_const(example.rhs).pointers(), c.pointers(), {}) ==
        Status::undefined);
  example.values.field(0)[3] = 1.0;
  solver->forget();
  CHECK(solver->solve(example.matrix, {}, std::as_const(example.rhs).pointers(), c.pointers(), {}) == Status::success);
}
