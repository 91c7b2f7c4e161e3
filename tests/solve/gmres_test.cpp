#include <omp.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include <Eigen/Dense>
#include <catch2/catch.hpp>
#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/solve/fourier_preconditioner.hpp>
#include <rubato/solve/gmres.hpp>

using namespace rubato;
using namespace rubato::solve;
using grids::Along;
using grids::FieldSet;
using grids::Grid;

namespace {

/// The box scheme's Newton matrix of the 2D wave equation u_tt = u_xx + u_yy - V'(u) in (u, v, a, b), with
/// V''(u) = 1 + strength · cos(3 u) of a given u at cell centres.
struct Wave2D {
  Grid grid;
  double h;
  std::vector<double> potential;  ///< V'' in each cell
  double mean = 0.0;

  Wave2D(std::size_t n, double step, double strength)
      : grid({{"x", -7.0, 7.0, n}, {"y", -7.0, 7.0, n + 2}}), h(step), potential(grid.size()) {
    for (std::size_t i = 0; i < grid.size(); ++i) {
      const auto place = grid.place(i);
      const double x = grid.axis(0).centre(place[0]);
      const double y = grid.axis(1).centre(place[1]);
      potential[i] = 1.0 + strength * std::cos(3.0 * std::exp(-0.1 * (x * x + y * y)));
    }
    mean = grids::sum(potential) / static_cast<double>(grid.size());
  }

  /// Rows: -v_t + a_x + b_y - V'' u; u_t - v; -u_x + a; -u_y + b, with t-differences 1/h and t-averages ½ of the new
  /// level.
  void operator()(const double* in, double* out) const {
    const std::size_t n = grid.size();
    const double* u = in;
    const double* v = in + n;
    const double* a = in + 2 * n;
    const double* b = in + 3 * n;
    std::vector<double> mu(n), mv(n), ma(n), mb(n), ux(n), uy(n), ax(n), by(n);
    const grids::BoxOperator mean_op{Along::average, Along::average, Along::identity};
    const grids::BoxOperator dx{Along::difference, Along::average, Along::identity};
    const grids::BoxOperator dy{Along::average, Along::difference, Along::identity};
    grids::apply(grid, mean_op, u, mu.data());
    grids::apply(grid, mean_op, v, mv.data());
    grids::apply(grid, mean_op, a, ma.data());
    grids::apply(grid, mean_op, b, mb.data());
    grids::apply(grid, dx, u, ux.data());
    grids::apply(grid, dy, u, uy.data());
    grids::apply(grid, dx, a, ax.data());
    grids::apply(grid, dy, b, by.data());
    for (std::size_t i = 0; i < n; ++i) {
      out[i] = -mv[i] / h + 0.5 * (ax[i] + by[i] - potential[i] * mu[i]);
      out[n + i] = mu[i] / h - 0.5 * mv[i];
      out[2 * n + i] = 0.5 * (ma[i] - ux[i]);
      out[3 * n + i] = 0.5 * (mb[i] - uy[i]);
    }
  }

  void symbol(const std::array<std::ptrdiff_t, 3>& k, std::complex<double>* m) const {
    const double tx = grids::wave_angle(k[0], grid.cells(0));
    const double ty = grids::wave_angle(k[1], grid.cells(1));
    const auto mx = grids::average_symbol(tx);
    const auto my = grids::average_symbol(ty);
    const auto mm = mx * my;
    const auto dx = grids::difference_symbol(tx, grid.spacing(0)) * my;
    const auto dy = mx * grids::difference_symbol(ty, grid.spacing(1));
    m[0] = -0.5 * mean * mm;
    m[1] = -mm / h;
    m[2] = 0.5 * dx;
    m[3] = 0.5 * dy;
    m[4] = mm / h;
    m[5] = -0.5 * mm;
    m[8] = -0.5 * dx;
    m[10] = 0.5 * mm;
    m[12] = -0.5 * dy;
    m[15] = 0.5 * mm;
  }
};

FieldSet random_fields(int fields, std::size_t size) {
  FieldSet f(fields, size);
  std::mt19937_64 engine(4);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (double& v : f.all()) {
    v = uniform(engine);
  }
  return f;
}

double relative_residual(const Wave2D& wave, const FieldSet& x, const FieldSet& b) {
  FieldSet r(4, wave.grid.size());
  wave(x.all().data(), r.all().data());
  const double difference =
      std::sqrt(grids::sum_of(r.all().size(), [&](std::size_t i) { return std::pow(r.all()[i] - b.all()[i], 2); }));
  return difference / std::sqrt(grids::dot(b.all(), b.all()));
}

/// From x = 0, preconditioned from the right.
GmresOutcome solve_from_zero(Gmres& gmres, const Wave2D& wave, FourierPreconditioner& inverse, const FieldSet& b,
                             FieldSet& x, const GmresOptions& options = {}) {
  FieldSet image(4, wave.grid.size());
  const auto apply = [&](const double* in, double* out) {
    inverse(in, image.all().data());
    wave(image.all().data(), out);
  };
  const GmresOutcome outcome = gmres.solve(apply, b.all(), x.all(), options);
  inverse(x.all().data(), x.all().data());
  return outcome;
}

}  // namespace

TEST_CASE("GMRES finds the solution of small dense systems in as many iterations as unknowns") {
  const int n = GENERATE(1, 5, 12);
  std::mt19937_64 engine(2);
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(n, n, [&] { return normal(engine); });
  const Eigen::VectorXd exact = Eigen::VectorXd::NullaryExpr(n, [&] { return normal(engine); });
  const Eigen::VectorXd b = a * exact;
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
  const auto apply = [&](const double* in, double* out) {
    Eigen::Map<Eigen::VectorXd>(out, n) = a * Eigen::Map<const Eigen::VectorXd>(in, n);
  };
  Gmres gmres(n, n);
  const GmresOutcome outcome =
      gmres.solve(apply, {b.data(), static_cast<std::size_t>(n)}, {x.data(), static_cast<std::size_t>(n)});
  CHECK(outcome.status == Status::success);
  CHECK(outcome.residual < 1e-12);
  CHECK((x - exact).norm() < 1e-9 * exact.norm());
  // A first cycle of n, and a second one to remove what rounding left.
  CHECK(outcome.iterations <= 2 * n);
  // Twin: with one iteration fewer than needed there is none.
  if (n == 12) {
    x.setZero();
    CHECK(gmres.solve(apply, {b.data(), 12}, {x.data(), 12}, {1e-13, 1e-10, 11}).status == Status::not_converged);
  }
}

TEST_CASE("the Fourier preconditioner inverts a system with constant coefficients") {
  Wave2D wave(15, 0.1, 0.0);
  FourierPreconditioner inverse(wave.grid, 4);
  const auto symbol = [&](const auto& k, auto* m) { wave.symbol(k, m); };
  REQUIRE(inverse.factor(symbol) == Status::success);
  CHECK(inverse.deficient_waves() == 0);
  const FieldSet exact = random_fields(4, wave.grid.size());
  FieldSet b(4, wave.grid.size());
  wave(exact.all().data(), b.all().data());
  FieldSet x = b;
  inverse(x.all().data(), x.all().data());
  // The averages' inverses cost a factor (4·15/π)² or so.
  CHECK(relative_residual(wave, x, b) < 1e-12);
  // The same with the averages apart: D/A is imaginary, and most parts of the inverse are 0.
  std::vector<std::vector<std::complex<double>>> averages(2);
  for (int a = 0; a < 2; ++a) {
    const auto n = static_cast<std::ptrdiff_t>(wave.grid.cells(a));
    for (std::ptrdiff_t k = 0; k < n; ++k) {
      averages[a].push_back(grids::average_symbol(grids::wave_angle(2 * k > n ? k - n : k, wave.grid.cells(a))));
    }
  }
  const auto slope = [&](int a, std::ptrdiff_t k) {
    return std::complex<double>(0.0,
                                2.0 * std::tan(0.5 * grids::wave_angle(k, wave.grid.cells(a))) / wave.grid.spacing(a));
  };
  const auto divided = [&](const auto& k, auto* m) {
    wave.symbol({0, 0, 0}, m);
    m[2] = 0.5 * slope(0, k[0]);
    m[3] = 0.5 * slope(1, k[1]);
    m[8] = -m[2];
    m[12] = -m[3];
  };
  REQUIRE(inverse.factor(divided, {}, averages) == Status::success);
  x = b;
  inverse(x.all().data(), x.all().data());
  CHECK(relative_residual(wave, x, b) < 1e-12);
  // Twins: those of one axis missing, and one entry of the symbol with the wrong sign.
  REQUIRE(inverse.factor(divided, {}, std::span(averages).first(1)) == Status::success);
  x = b;
  inverse(x.all().data(), x.all().data());
  CHECK(relative_residual(wave, x, b) > 1e-3);
  REQUIRE(inverse.factor([&](const auto& k, auto* m) {
    wave.symbol(k, m);
    m[8] = -m[8];
  }) == Status::success);
  x = b;
  inverse(x.all().data(), x.all().data());
  CHECK(relative_residual(wave, x, b) > 1e-3);
}

TEST_CASE("GMRES with it solves the box scheme in 2D with variable coefficients, whatever the grid") {
  int iterations[2] = {};
  int index = 0;
  for (const std::size_t n : {31, 63}) {
    const Wave2D wave(n, 0.1, 0.9);
    FourierPreconditioner inverse(wave.grid, 4);
    REQUIRE(inverse.factor([&](const auto& k, auto* m) { wave.symbol(k, m); }) == Status::success);
    const FieldSet exact = random_fields(4, wave.grid.size());
    FieldSet b(4, wave.grid.size());
    wave(exact.all().data(), b.all().data());
    FieldSet x(4, wave.grid.size());
    Gmres gmres(b.all().size(), 20);
    const GmresOutcome outcome = solve_from_zero(gmres, wave, inverse, b, x, {1e-12, 1e-10, 100});
    CHECK(outcome.status == Status::success);
    CHECK(relative_residual(wave, x, b) < 1.1e-12);
    iterations[index++] = outcome.iterations;
    // Twin: without the preconditioner the same effort gets nowhere.
    x.fill(0.0);
    const GmresOutcome plain = gmres.solve(wave, b.all(), x.all(), {1e-12, 1e-10, 100});
    CHECK(plain.status == Status::not_converged);
  }
  // The perturbation of the preconditioned identity is about h²/4 · 0.9 / (1 + h²/4): two digits an iteration and more.
  CHECK(iterations[0] <= 10);
  CHECK(iterations[1] <= iterations[0] + 2);
}

TEST_CASE("GMRES gives the same bits for every number of threads") {
  const Wave2D wave(63, 0.1, 0.9);
  const FieldSet exact = random_fields(4, wave.grid.size());
  FieldSet b(4, wave.grid.size());
  wave(exact.all().data(), b.all().data());
  const int threads = omp_get_max_threads();
  FieldSet first(4, wave.grid.size());
  for (const int count : {1, 2, 5}) {
    omp_set_num_threads(count);
    FourierPreconditioner inverse(wave.grid, 4);
    REQUIRE(inverse.factor([&](const auto& k, auto* m) { wave.symbol(k, m); }) == Status::success);
    FieldSet x(4, wave.grid.size());
    Gmres gmres(b.all().size(), 20);
    CHECK(solve_from_zero(gmres, wave, inverse, b, x).status == Status::success);
    if (count == 1) {
      first = x;
    }
    CHECK(std::memcmp(first.all().data(), x.all().data(), x.all().size_bytes()) == 0);
  }
  omp_set_num_threads(threads);
}

TEST_CASE("rows and fields of the preconditioner one at a time make up the whole") {
  const Wave2D wave(31, 0.1, 0.0);
  FourierPreconditioner inverse(wave.grid, 4);
  REQUIRE(inverse.factor([&](const auto& k, auto* m) { wave.symbol(k, m); }) == Status::success);
  const FieldSet b = random_fields(4, wave.grid.size());
  const FieldSet change = random_fields(2, wave.grid.size());
  // (matrix)⁻¹ (b - change in rows 2 and 0), whole
  FieldSet whole = b;
  const int rows[] = {2, 0};
  for (int i = 0; i < 2; ++i) {
    for (std::size_t n = 0; n < wave.grid.size(); ++n) {
      whole.field(rows[i])[n] -= change.field(i)[n];
    }
  }
  inverse(whole.all().data(), whole.all().data());
  // The same, fields 3 and 1 only; and as the sum of the responses to b and to the change. The whole is of size 30 or
  // less, transforms are exact to a few ε.
  FieldSet some(2, wave.grid.size());
  const int fields[] = {3, 1};
  inverse.take(b.pointers());
  inverse.solve(rows, change.pointers(), fields, some.pointers());
  FieldSet respond(2, wave.grid.size());
  inverse.respond(rows, change.pointers(), fields, respond.pointers());
  FieldSet plain = b;
  inverse(plain.all().data(), plain.all().data());
  double difference = 0.0;
  double sum_difference = 0.0;
  double twin = 0.0;  // the fields in the other order
  for (int j = 0; j < 2; ++j) {
    for (std::size_t n = 0; n < wave.grid.size(); ++n) {
      const double expected = whole.field(fields[j])[n];
      difference = std::max(difference, std::abs(some.field(j)[n] - expected));
      sum_difference = std::max(sum_difference, std::abs(plain.field(fields[j])[n] - respond.field(j)[n] - expected));
      twin = std::max(twin, std::abs(some.field(1 - j)[n] - expected));
    }
  }
  CHECK(difference < 1e-12);
  CHECK(sum_difference < 1e-12);
  CHECK(twin > 1e-2);
}

TEST_CASE("a wave without inverse gets its pseudo-inverse") {
  // u_x on an odd grid: the constant is the kernel, and is left at zero.
  const Grid grid({{"x", 0.0, 2.0, 21}});
  FourierPreconditioner inverse(grid, 1);
  REQUIRE(inverse.factor([&](const auto& k, auto* m) { m[0] = grids::derivative_symbol(k[0], grid.axis(0)); }) ==
          Status::success);
  CHECK(inverse.deficient_waves() == 1);
  std::vector<double> u(21);
  std::vector<double> exact(21);
  for (std::size_t i = 0; i < 21; ++i) {
    const double x = grid.axis(0).node(i) * std::numbers::pi;
    u[i] = 5.0 + std::cos(3 * x);
    exact[i] = std::sin(3 * x) / (3 * std::numbers::pi);
  }
  inverse(u.data(), u.data());
  for (std::size_t i = 0; i < 21; ++i) {
    CHECK(std::abs(u[i] - exact[i]) < 1e-14);
  }
}

TEST_CASE("undefined, singular and trivial systems are reported as such") {
  const std::size_t n = 9;
  Gmres gmres(n, 9);
  std::vector<double> b(n, 1.0);
  std::vector<double> x(n, 3.0);
  const auto nothing = [&](const double* in, double* out) { std::copy_n(in, n, out); };
  const auto zero = [&](const double*, double* out) { std::fill_n(out, n, 0.0); };
  CHECK(gmres.solve(zero, b, x).status == Status::singular);
  const auto poisoned = [&](const double* in, double* out) {
    std::copy_n(in, n, out);
    out[4] = std::nan("");
  };
  CHECK(gmres.solve(poisoned, b, x).status == Status::undefined);
  CHECK(x[0] == 3.0);
  b[2] = std::numeric_limits<double>::infinity();
  CHECK(gmres.solve(nothing, b, x).status == Status::undefined);
  b.assign(n, 0.0);
  CHECK(gmres.solve(nothing, b, x).status == Status::success);
  CHECK(x[0] == 0.0);
  CHECK_THROWS_AS(Gmres(0), std::invalid_argument);
  // A projection with b outside its range cannot be solved: not a success.
  b.assign(n, 1.0);
  x.assign(n, 0.0);
  const auto projection = [&](const double* in, double* out) {
    std::copy_n(in, n, out);
    out[0] = 0.0;
  };
  CHECK(gmres.solve(projection, b, x).status != Status::success);
  const Grid grid({{"x", 0.0, 2.0, 21}});
  FourierPreconditioner inverse(grid, 1);
  CHECK(inverse.factor([&](const auto&, auto* m) { m[0] = std::nan(""); }) == Status::undefined);
}

TEST_CASE("rank is judged of rows and columns that are scaled") {
  // The midpoint rule of u_tt = u_xx, 4/h² for a short step beside 1: (-4/h², ∂; ∂, 1).
  constexpr double inverse_square = 4e18;
  constexpr std::size_t n = 21, waves = n / 2 + 1;
  const Grid grid({{"x", 0.0, 2.0, n}});
  const double steepest = std::abs(grids::derivative_symbol(10, grid.axis(0)));
  const auto wave = [&](const auto& k, auto* m) {
    m[0] = -inverse_square;
    m[1] = m[2] = grids::derivative_symbol(k[0], grid.axis(0));
    m[3] = 1.0;
  };
  const std::vector<double> sizes = {inverse_square, steepest, steepest, 1.0};
  FourierPreconditioner inverse(grid, 2);
  REQUIRE(inverse.factor(wave, sizes) == Status::success);
  CHECK(inverse.deficient_waves() == 0);
  // w = 1 + cos(3πx) in the second row: the field there is w to 1e-16, as the first is ∂w/4·h².
  std::vector<double> values(2 * n, 0.0), exact(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    const double angle = 3.0 * std::numbers::pi * grid.axis(0).node(i);
    values[n + i] = exact[n + i] = 1.0 + std::cos(angle);
    exact[i] = -3.0 * std::numbers::pi * std::sin(angle) / inverse_square;
  }
  inverse(values.data(), values.data());
  for (std::size_t i = 0; i < n; ++i) {
    CHECK(std::abs(values[i] - exact[i]) < 1e-14 * 10.0 / inverse_square);
    CHECK(std::abs(values[n + i] - exact[n + i]) < 1e-14);
  }
  // Twins: as they are, all waves seem to lack rank; and what lacks it does when scaled: the constant of ∂ alone in a
  // row, and in all waves a row whose terms cancel to rounding.
  REQUIRE(inverse.factor(wave) == Status::success);
  CHECK(inverse.deficient_waves() == waves);
  const auto with_row = [&](auto entry) {
    return [&, entry](const auto& k, auto* m) {
      wave(k, m);
      m[2] = 0.0;
      m[3] = entry(k);
    };
  };
  REQUIRE(inverse.factor(with_row([&](const auto& k) { return grids::derivative_symbol(k[0], grid.axis(0)); }),
                         std::vector{inverse_square, steepest, 0.0, steepest}) == Status::success);
  CHECK(inverse.deficient_waves() == 1);
  REQUIRE(inverse.factor(with_row([](const auto&) { return std::complex<double>(1e-16); }),
                         std::vector{inverse_square, steepest, 0.0, 2.0}) == Status::success);
  CHECK(inverse.deficient_waves() == waves);
}
