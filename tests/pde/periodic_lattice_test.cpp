// Periodic orbits of lattices: Newton's matrix against differences, its elimination against it, breathers on rings.

#include <catch2/catch.hpp>

#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include <rubato/pde/periodic_lattice.hpp>

using namespace rubato;
using Eigen::Index;
using Eigen::VectorXd;

namespace {

/// u_tt = u_xx - V'(u) in the fields u, v = u_t, w = u_x.
MultisymplecticSystem wave_equation(const std::string& V) {
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(3, 3), K = M;
  M(0, 1) = -1.0;
  M(1, 0) = 1.0;
  K(0, 2) = 1.0;
  K(2, 0) = -1.0;
  return {{"u", "v", "w"}, M, {K}, "(v^2 - w^2)/2 + " + V};
}

grids::Grid ring(double length, std::size_t cells) {
  return grids::Grid({{.name = "x", .from = -0.5 * length, .to = 0.5 * length, .cells = cells}});
}

/// `method`: box, fourier, or the composition of a splitting.
std::unique_ptr<PeriodicStep> step_of(const MultisymplecticSystem& system, const grids::Grid& grid,
                                      const std::string& method) {
  if (method == "box" || method == "fourier") {
    return make_swept_step(system, grid, method == "box" ? Collocation::cells : Collocation::nodes);
  }
  return make_split_step(system, grid, composition(method), Collocation::nodes);
}

template <typename U, typename V>
PeriodOfLattice guess_of(const MultisymplecticSystem& system, const grids::Grid& grid, const std::string& method,
                         double period, std::size_t steps, const U& u, const V& v) {
  std::vector<double> first, second;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    first.push_back(u(grid.axis(0).node(i)));
    second.push_back(v(grid.axis(0).node(i)));
  }
  LatticeOptions options{.step = period / static_cast<double>(steps), .until = period, .levels = Levels::fixed};
  options.lagrangian = method == "box" || method == "fourier" ? method : "splitting";
  if (options.lagrangian == "splitting") {
    options.composition = method;
  }
  LatticeIntegrator lattice(system, grid, {first, second, std::nullopt}, options);
  PeriodOfLattice guess = period_by_integrating(lattice, steps);
  REQUIRE(guess.steps() == steps);
  return guess;
}

double sech(double x) {
  return 1.0 / std::cosh(x);
}

/// The largest |u - vacuum| at the seam, opposite of the breather in the middle.
double tail(const PeriodOfLattice& orbit, double vacuum) {
  double largest = 0.0;
  for (const grids::FieldSet& level : orbit.levels) {
    largest = std::max(largest, std::abs(level.field(0)[0] - vacuum));
  }
  return largest;
}

/// Orders of convergence between iterations: ln r_{k+1} / ln r_k where both are small and above rounding.
std::vector<double> rates(const std::vector<solve::NewtonIteration>& history) {
  std::vector<double> found;
  for (std::size_t i = 1; i < history.size(); ++i) {
    if (history[i - 1].residual < 0.1 && history[i].residual > 1e-14 && history[i].fraction == 1.0) {
      found.push_back(std::log(history[i].residual) / std::log(history[i - 1].residual));
    }
  }
  return found;
}

}  // namespace

TEST_CASE("periodic lattices: Newton's matrix is the derivative of the equations, and its elimination solves it") {
  const MultisymplecticSystem system = wave_equation("1 - cos(u) + 0.1*u*w");
  const grids::Grid grid = ring(6.0, 5);
  for (const std::string method : {"box", "fourier", "golden"}) {
    CAPTURE(method);
    const PeriodOfLattice guess = guess_of(
        system, grid, method, 5.0, 4, [](double x) { return 0.3 * std::sin(x); },
        [](double x) { return sech(x) + 0.1 * x; });
    PeriodicLattice equations(system, grid, step_of(system, grid, method), {.period = 5.0, .energy = 0.7}, guess);
    const VectorXd u = equations.pack(guess);
    VectorXd residual, above, below;
    REQUIRE(equations.evaluate(u, residual, true) == Status::success);
    const Eigen::MatrixXd matrix = equations.jacobian();
    const auto error_of = [&](const Eigen::MatrixXd& derivative) {
      double largest = 0.0;
      for (Index j = 0; j < u.size(); ++j) {
        constexpr double width = 1e-5;
        VectorXd moved = u;
        moved[j] += width;
        REQUIRE(equations.evaluate(moved, above, false) == Status::success);
        moved[j] -= 2.0 * width;
        REQUIRE(equations.evaluate(moved, below, false) == Status::success);
        largest = std::max(largest, ((above - below) / (2.0 * width) - derivative.col(j)).cwiseAbs().maxCoeff());
      }
      return largest;
    };
    // Differences: width²/6 times third derivatives of about 1, and rounding over the width.
    constexpr double allowed = 1e-9;
    CHECK(error_of(matrix) < allowed);
    Eigen::MatrixXd faulty = matrix;
    faulty(0, 0) += 1e-6;
    CHECK(error_of(faulty) > allowed);  // twin
    // A right-hand side that the matrix reaches. The damping moves it by its square over that of singular values.
    REQUIRE(equations.factor(1e-9) == Status::success);
    const VectorXd right = matrix * VectorXd::LinSpaced(u.size(), -1.0, 1.0);
    VectorXd x;
    REQUIRE(equations.solve(right, x) == Status::success);
    CHECK((matrix * x + right).cwiseAbs().maxCoeff() < 1e-8);
    CHECK((matrix * x - right).cwiseAbs().maxCoeff() > 1e-2);  // twin: the other sign
  }
}

namespace {

constexpr double width = 0.4;  // of a cell
constexpr std::size_t steps_in_period = 40;

/// Breathers on rings of 31, 61 and 121 cells.
template <typename U, typename V>
std::vector<double> tails_on_rings(const MultisymplecticSystem& system, double period, double vacuum, const U& u,
                                   const V& v) {
  std::vector<double> tails;
  for (const std::size_t cells : {31U, 61U, 121U}) {
    const double length = width * static_cast<double>(cells);
    const grids::Grid grid = ring(length, cells);
    const PeriodOfLattice guess = guess_of(system, grid, "box", period, steps_in_period, u, v);
    const PeriodicLatticeSolution found =
        solve_periodic_lattice(system, grid, step_of(system, grid, "box"), guess, {.period = period});
    CAPTURE(length, found.search.worst, found.search.residual);
    REQUIRE(found.found());
    CHECK(found.orbit.period == Approx(period).epsilon(1e-13));
    tails.push_back(tail(found.orbit, vacuum));
    // The residual squares from one iteration to the next.
    const std::vector<double> orders = rates(found.history);
    CAPTURE(orders);
    REQUIRE(!orders.empty());
    CHECK(*std::ranges::max_element(orders) > 1.7);
  }
  return tails;
}

/// What is left at the seam of 2a sech(κx) cos ωt around both neighbours, 4a exp(-κL/2), on the ring of 121 cells. On
/// the box scheme's lattice tan(ωh/2) takes the place of ωh/2, and tanh(κΔx/2) of κΔx/2 in κ² = mass² - ω².
double localised_tail(double a, double mass, double omega) {
  const double angle = std::numbers::pi / steps_in_period, rate = omega * std::tan(angle) / angle;
  const double kappa = 2.0 / width * std::atanh(0.5 * width * std::sqrt(mass * mass - rate * rate));
  return 4.0 * a * std::exp(-kappa * 0.5 * 121.0 * width);
}

}  // namespace

TEST_CASE("periodic lattices: the tail of a sine-Gordon breather falls on rings of doubled length") {
  const MultisymplecticSystem system = wave_equation("1 - cos(u)");
  const double omega = 0.9, gamma = std::sqrt(1.0 - omega * omega), period = 2.0 * std::numbers::pi / omega;
  const std::vector<double> tails = tails_on_rings(
      system, period, 0.0, [](double) { return 0.0; }, [&](double x) { return 4.0 * gamma * sech(gamma * x); });
  CAPTURE(tails);
  // u = 4 atan(γ/ω sech(γx)) at its largest. Steps change the amplitude by their square, about 0.02.
  CHECK(tails[2] == Approx(localised_tail(4.0 * gamma / omega, 1.0, omega)).epsilon(0.1));
  CHECK(tails[2] < 0.1 * tails[1]);
  CHECK(tails[1] < 0.1 * tails[0]);
}

TEST_CASE("periodic lattices: the tail of a phi^4 breather stays on rings of doubled length") {
  const MultisymplecticSystem system = wave_equation("(u^2 - 1)^2/4");
  const double omega = 1.25, epsilon = std::sqrt(2.0 - omega * omega), period = 2.0 * std::numbers::pi / omega;
  // To second order in the amplitude: u = 1 + A cos ωt - A²(3 - cos 2ωt)/4 ..., A = ε√(4/3) sech εx.
  const std::vector<double> tails = tails_on_rings(
      system, period, 1.0,
      [&](double x) {
        const double A = epsilon * std::sqrt(4.0 / 3.0) * sech(epsilon * x);
        return 1.0 + A - 0.5 * A * A;
      },
      [](double) { return 0.0; });
  CAPTURE(tails);
  CHECK(tails[2] > 100.0 * localised_tail(epsilon * std::sqrt(4.0 / 3.0), std::sqrt(2.0), omega));
  CHECK(tails[2] > 0.1 * tails[1]);
}

namespace {

/// The mean energy of the orbit of this period on a ring of 31 cells.
template <typename U, typename V>
double energy_of(const MultisymplecticSystem& system, const std::string& method, double period, std::size_t steps,
                 const U& u, const V& v) {
  const grids::Grid grid = ring(31 * width, 31);
  const PeriodicLatticeSolution found =
      solve_periodic_lattice(system, grid, step_of(system, grid, method),
                             guess_of(system, grid, method, period, steps, u, v), {.period = period});
  CAPTURE(method, steps, found.search.worst, found.search.residual);
  REQUIRE(found.found());
  return found.mean_energy;
}

/// Energies tend to one number with the order of each scheme.
template <typename U, typename V>
void check_orders(const MultisymplecticSystem& system, double period, const U& u, const V& v) {
  const double exact = energy_of(system, "kahan-li-6", period, 112, u, v);
  for (const auto& [method, order] : {std::pair("fourier", 2), {"golden", 2}, {"blanes-moan-4", 4}}) {
    const double coarse = energy_of(system, method, period, 56, u, v) - exact,
                 fine = energy_of(system, method, period, 112, u, v) - exact;
    CAPTURE(method, exact, coarse, fine);
    CHECK(std::log2(std::abs(coarse / fine)) == Approx(order).margin(0.3));
  }
}

}  // namespace

TEST_CASE("periodic lattices: breathers by splittings are those of the other schemes to their order") {
  const double omega = 0.9, gamma = std::sqrt(1.0 - omega * omega);
  check_orders(
      wave_equation("1 - cos(u)"), 2.0 * std::numbers::pi / omega, [](double) { return 0.0; },
      [&](double x) { return 4.0 * gamma * sech(gamma * x); });
  const double frequency = 1.25, epsilon = std::sqrt(2.0 - frequency * frequency);
  check_orders(
      wave_equation("(u^2 - 1)^2/4"), 2.0 * std::numbers::pi / frequency,
      [&](double x) {
        const double A = epsilon * std::sqrt(4.0 / 3.0) * sech(epsilon * x);
        return 1.0 + A - 0.5 * A * A;
      },
      [](double) { return 0.0; });
}

TEST_CASE("periodic lattices: what cannot be solved for is refused") {
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(2, 2), K = M;
  M(0, 1) = -1.0;
  M(1, 0) = 1.0;
  K(0, 1) = 0.5;
  K(1, 0) = -0.5;
  const MultisymplecticSystem potential({"phi", "p"}, M, {K}, "p^2/2");
  const grids::Grid grid = ring(6.0, 5);
  const PeriodOfLattice guess{.levels = std::vector(3, grids::FieldSet(2, 5)), .slopes = {}, .period = 1.0};
  CHECK_THROWS_WITH(PeriodicLattice(potential, grid, step_of(potential, grid, "box"), {}, guess),
                    Catch::Contains("does not name phi"));
  const MultisymplecticSystem system = wave_equation("1 - cos(u)");
  CHECK_THROWS_WITH(make_swept_step(system, grid, Collocation::corners), Catch::Contains("one stage"));
  CHECK_THROWS_WITH(
      PeriodicLattice(system, grid, step_of(system, grid, "box"), {}, PeriodOfLattice{.slopes = {}, .period = 1.0}),
      Catch::Contains("at least one level"));
}
