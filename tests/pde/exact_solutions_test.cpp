#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

using Solution = std::function<double(double, double)>;  ///< of x and t

/// x taken into the period around 0 of length L.
double wrapped(double x, double L) {
  return x - L * std::round(x / L);
}

struct Problem {
  std::string name;
  MultisymplecticSystem system;
  double length;
  std::vector<Solution> given;  ///< one for each field; empty where there is no initial data
  int compared = 0;
  double step, until;
  std::size_t cells;
};

double error_of(const Problem& problem, std::size_t cells, double step, const char* lagrangian) {
  const grids::Grid grid({{"x", -problem.length / 2, problem.length / 2, cells}});
  InitialFields initial;
  for (const Solution& f : problem.given) {
    initial.push_back(f ? std::optional(sampled(grid, [&](double x) { return f(x, 0); })) : std::nullopt);
  }
  LatticeIntegrator lattice(problem.system, grid, initial,
                            {.lagrangian = lagrangian, .step = step, .until = problem.until, .levels = Levels::fixed});
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
  }
  const auto& exact = problem.given[static_cast<std::size_t>(problem.compared)];
  return largest_difference(lattice.field(problem.compared),
                            sampled(grid, [&](double x) { return exact(x, lattice.t()); }));
}

std::vector<Problem> problems() {
  std::vector<Problem> all;
  const double k = 4 * M_PI / 40;
  const auto soliton = [k](double x, double t) { return sech(wrapped(x - k * t, 40)); };
  const auto phase = [k](double x, double t) { return k * x / 2 + (1 - k * k / 4) * t; };
  all.push_back({"Schrödinger",
                 schroedinger(2),
                 40,
                 {[=](double x, double t) { return soliton(x, t) * std::cos(phase(x, t)); },
                  [=](double x, double t) { return soliton(x, t) * std::sin(phase(x, t)); }, nullptr, nullptr},
                 0,
                 0.04,
                 2,
                 201});
  all.push_back(
      {"Korteweg-de Vries",
       korteweg_de_vries(6, 1),
       20,
       {nullptr, [](double x, double t) { return 2 * std::pow(sech(wrapped(x - 4 * t, 20)), 2); }, nullptr, nullptr},
       1,
       0.01,
       1,
       201});
  all.push_back({"Korteweg-de Vries on a mean flow",
                 korteweg_de_vries(6, 1),
                 20,
                 {nullptr, [](double x, double t) { return 1 + 2 * std::pow(sech(wrapped(x - 10 * t, 20)), 2); },
                  nullptr, nullptr},
                 1,
                 0.005,
                 0.5,
                 201});
  return all;
}

}  // namespace

// tests/catalogue has those of every problem shipped; this one adds data of another mean, a Galilean boost.
TEST_CASE("box is of second order in h and Δx refined together, on a mean flow too") {
  for (const Problem& problem : problems()) {
    std::vector<double> errors;
    for (const std::size_t factor : {1, 2, 4}) {
      const std::size_t cells = factor * (problem.cells - 1) + 1;
      errors.push_back(error_of(problem, cells, problem.step / static_cast<double>(factor), "box"));
    }
    const double first = std::log2(errors[0] / errors[1]);
    const double second = std::log2(errors[1] / errors[2]);
    INFO(problem.name << ": errors " << errors[0] << ", " << errors[1] << ", " << errors[2] << ", orders " << first
                      << ", " << second);
    CHECK(second == Approx(2.0).margin(0.1));
    CHECK(first == Approx(2.0).margin(0.5));
  }
}

TEST_CASE("Fourier is spectral in space and of second order in time") {
  const Problem problem = problems()[0];
  // Time steps so short that space is what is left, then grids so fine that time is.
  const double coarse = error_of(problem, 33, 0.001, "fourier");
  const double fine = error_of(problem, 65, 0.001, "fourier");
  INFO("errors " << coarse << " and " << fine);
  CHECK(coarse / fine > 30);  // an algebraic order of 5 at least, and growing
  const double once = error_of(problem, 129, 0.04, "fourier");
  const double twice = error_of(problem, 129, 0.02, "fourier");
  CHECK(std::log2(once / twice) == Approx(2.0).margin(0.05));
}

TEST_CASE("the KdV soliton to t = 10 has the error of the literature's box scheme") {
  const Problem problem{"KdV", korteweg_de_vries(6, 1), 20, problems()[1].given, 1, 0.005, 10, 201};
  CHECK(error_of(problem, 201, 0.005, "box") == Approx(0.159).epsilon(0.05));
}

TEST_CASE("Fourier holds the charge of the Schrödinger equation to rounding") {
  const Problem problem = problems()[0];
  const grids::Grid grid({{"x", -20, 20, 65}});
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(4, 4);
  B(0, 1) = B(2, 3) = -1;
  B(1, 0) = B(3, 2) = 1;
  LatticeIntegrator lattice(
      problem.system, grid,
      {sampled(grid, [](double x) { return sech(x); }), sampled(grid, [](double x) { return 0.2 * sech(x - 1); }),
       std::nullopt, std::nullopt},
      {.lagrangian = "fourier", .step = 0.02, .until = 10, .levels = Levels::fixed, .symmetries = {{"charge", B}}});
  const auto before = lattice.totals();
  double deviation = 0.0;
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    deviation = std::max(deviation, std::abs(lattice.totals()[2] - before[2]));
  }
  CHECK(deviation < 1e-12 * before[2]);
  CHECK(std::abs(lattice.totals()[0] - before[0]) > 1e-10);  // the nodal energy is not conserved
}
