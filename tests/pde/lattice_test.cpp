#include <limits>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/node_formula.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;
using Catch::Matchers::Contains;

TEST_CASE("algebraic fields are started on the discrete constraint, and contradictions are refused") {
  const auto system = sine_gordon();
  const grids::Grid grid({{"x", -10, 10, 101}});
  const auto u = sampled(grid, [](double x) { return std::exp(-x * x); });
  const auto v = sampled(grid, [](double) { return 0.0; });
  const auto w = sampled(grid, [](double x) { return -2 * x * std::exp(-x * x); });
  const LatticeLevel left_out = initial_level(system, grid, {u, v, std::nullopt});
  const LatticeLevel given = initial_level(system, grid, {u, v, w});
  double residual = 0.0;
  for (std::size_t i = 0; i + 1 < grid.size(); ++i) {
    const auto computed = given.fields.field(2);
    residual = std::max(residual, std::abs((computed[i] + computed[i + 1]) / 2 - (u[i + 1] - u[i]) / grid.spacing(0)));
  }
  CHECK(residual < 1e-13);
  CHECK(largest_difference(given.fields.field(2), left_out.fields.field(2)) < 1e-11);
  CHECK(largest_difference(given.fields.field(2), w) > 1e-4);  // it is not the pointwise derivative

  auto wrong = w;
  for (double& value : wrong) {
    value *= 1.2;
  }
  CHECK_THROWS_WITH(initial_level(system, grid, {u, v, wrong}),
                    Contains("the initial w contradicts its constraint (the row of w"));
  CHECK_THROWS_WITH(initial_level(system, grid, {u, std::nullopt, std::nullopt}), Contains("no initial data for v"));
  auto poisoned = u;
  poisoned[7] = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_WITH(initial_level(system, grid, {poisoned, v, std::nullopt}), Contains("node 7"));
  CHECK_THROWS_WITH(initial_level(system, grid, {u, std::vector<double>(3), std::nullopt}), Contains("101 nodes"));
}

TEST_CASE("a potential is split into a slope and a periodic part") {
  const grids::Grid grid({{"x", 0, 20, 101}});
  const auto u = sampled(grid, [](double x) { return 3 + std::cos(M_PI * x / 10); });
  const LatticeLevel level =
      initial_level(korteweg_de_vries(6, 1), grid, {std::nullopt, u, std::nullopt, std::nullopt});
  CHECK(level.slopes.at(0, 0) == Approx(3.0).epsilon(1e-14));
  CHECK(largest_difference(level.fields.field(1), u) == 0.0);
  double mean = 0.0;
  for (const double value : level.fields.field(0)) {
    mean += value;
  }
  CHECK(std::abs(mean) < 1e-11);
  CHECK_THROWS_WITH(
      initial_level(korteweg_de_vries(6, 1), grid, {std::nullopt, std::nullopt, std::nullopt, std::nullopt}),
      Contains("no initial data"));
}

TEST_CASE("a kink and an antikink stop at their first overlap, and obey the law of Γ until then") {
  const double c = 0.5;
  const double g = 1 / std::sqrt(1 - c * c);
  const grids::Grid grid({{"x", -20, 20, 201}});
  const auto kink = [=](double y) { return 4 * std::atan(std::exp(g * y)); };
  LatticeIntegrator lattice(
      sine_gordon(), grid,
      {sampled(grid, [=](double x) { return kink(x + 10) - kink(x - 10); }),
       sampled(grid, [=](double x) { return -2 * c * g * (sech(g * (x + 10)) + sech(g * (x - 10))); }), std::nullopt},
      {.step = 0.1, .until = 100, .on_singular = OnSingular::stop});
  StepReport report;
  double gamma = 0.0;
  double law = 0.0;
  double energy = 0.0;
  while (!lattice.finished()) {
    const NodeEnergy node = lattice.node();
    report = lattice.step();
    if (report.status != Status::success) {
      break;
    }
    if (lattice.t() > 4 && lattice.t() < 5) {
      gamma = node.gamma;
      energy = node.energy - report.energy;
      law = report.h * report.h * node.gamma / 8;
    }
  }
  INFO("stopped at t = " << lattice.t() << " with Γ = " << lattice.node().gamma << "; Γ between collisions " << gamma
                         << ", 𝓔 - E = " << energy << ", h²Γ/8 = " << law);
  CHECK(report.status == Status::singular);
  CHECK(lattice.t() == Approx(17).margin(1.5));
  // Theory, section 5: Γ = 1.03, 𝓔 - E = 1.289e-3 against h²Γ/8 = 1.293e-3, at some time between the collisions.
  CHECK(gamma == Approx(1.03).epsilon(0.03));
  CHECK(energy == Approx(1.289e-3).epsilon(0.01));
  CHECK(law == Approx(energy).epsilon(0.005));
}

TEST_CASE("a lattice in two dimensions with variable levels keeps its discrete energy") {
  const grids::Grid grid({{"x", -7, 7, 63}, {"y", -7, 7, 61}});
  std::vector<double> u;
  for (std::size_t j = 0; j < grid.cells(1); ++j) {
    for (std::size_t i = 0; i < grid.cells(0); ++i) {
      u.push_back(4 * std::atan(std::exp(3 - std::hypot(grid.axis(0).node(i), grid.axis(1).node(j)))));
    }
  }
  LatticeIntegrator lattice(wave_equation_2d("1 - cos(u)"), grid,
                            {u, std::vector<double>(grid.size(), 0.0), std::nullopt, std::nullopt},
                            {.step = 0.1, .until = 1});
  double first = 0.0;
  double spread = 0.0;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    first = first == 0.0 ? report.energy : first;
    spread = std::max(spread, std::abs(report.energy - first) / first);
  }
  CHECK(spread < 1e-12);
  CHECK(std::abs(lattice.node().energy - first) > 1e-7 * first);  // the node energy is another
}

TEST_CASE("the plane waves of Zakharov-Kuznetsov are those of KdV, and oblique ones converge") {
  const auto error = [](std::size_t cells, double step) {
    const double L = 24;
    const double P = L / std::sqrt(2);
    const double c = 1;
    const grids::Grid grid({{"x", 0, L, cells}, {"y", 0, L, cells}});
    const auto exact = [&](double t) {
      std::vector<double> values;
      for (std::size_t j = 0; j < cells; ++j) {
        for (std::size_t i = 0; i < cells; ++i) {
          const double y = (grid.axis(0).node(i) + grid.axis(1).node(j)) / std::sqrt(2) - P / 2 - c * t / std::sqrt(2);
          values.push_back(3 * c * std::pow(sech(std::sqrt(c) / 2 * (y - P * std::round(y / P))), 2));
        }
      }
      return values;
    };
    LatticeIntegrator lattice(zakharov_kuznetsov(), grid,
                              {std::nullopt, exact(0), std::nullopt, std::nullopt, std::nullopt},
                              {.step = step, .until = 0.4, .levels = Levels::fixed});
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
    }
    return largest_difference(lattice.field(1), exact(lattice.t()));
  };
  const double coarse = error(31, 0.08);
  const double fine = error(61, 0.04);
  INFO("errors " << coarse << ", " << fine);
  CHECK(std::log2(coarse / fine) == Approx(2.0).margin(0.4));
}

TEST_CASE("formulas at nodes read coordinates, time, fields and their spectral derivatives") {
  const grids::Grid grid({{"x", 0, 2 * M_PI, 31}});
  auto graph = std::make_shared<formula::Graph>();
  const auto x = graph->variable("x");
  const auto t = graph->variable("t");
  const auto u = graph->variable("u");
  const auto u_xx = graph->variable("dx(dx(u))");
  NodeFormula formula(graph, {x + t, u * u + u_xx}, {"u"}, grid);
  const auto values = sampled(grid, [](double y) { return std::sin(y); });
  const double* fields[] = {values.data()};
  const auto results = formula(fields, 0.5);
  for (std::size_t i = 0; i < grid.size(); ++i) {
    CHECK(results[0][i] == grid.axis(0).node(i) + 0.5);
    CHECK(std::abs(results[1][i] - (values[i] * values[i] - values[i])) < 1e-13);
  }
  const auto bad = graph->variable("q");
  CHECK_THROWS_WITH(NodeFormula(graph, {bad}, {"u"}, grid), Contains("names q"));
}
