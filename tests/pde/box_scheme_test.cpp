#include <algorithm>
#include <cmath>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr double omega = 0.5;
const double width = std::sqrt(1 - omega * omega);

double breather(double x, double t) {
  return 4 * std::atan(width / omega * std::sin(omega * t) * sech(width * x));
}

struct Row {
  std::size_t steps = 0;
  double shortest = 1e300, longest = 0.0, spread = 0.0, residual = 0.0, error = 0.0;
};

Row run_breather(std::size_t cells, double step, Levels levels, const MultisymplecticSystem& system = sine_gordon()) {
  const grids::Grid grid({{"x", -20, 20, cells}});
  LatticeIntegrator lattice(system, grid,
                            {sampled(grid, [](double) { return 0.0; }),
                             sampled(grid, [](double x) { return 4 * width * sech(width * x); }), std::nullopt},
                            {.step = step, .until = 20, .levels = levels, .on_singular = OnSingular::stop});
  Row row;
  double lowest = 1e300;
  double highest = -1e300;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    row.shortest = std::min(row.shortest, report.h);
    row.longest = std::max(row.longest, report.h);
    lowest = std::min(lowest, report.energy);
    highest = std::max(highest, report.energy);
    row.residual = std::max(row.residual, lattice.residuals()[0].largest());
  }
  row.steps = lattice.levels().steps();
  row.spread = (highest - lowest) / std::abs(highest);
  row.error = largest_difference(lattice.field(0), sampled(grid, [&](double x) { return breather(x, lattice.t()); }));
  return row;
}

bool within(double value, double expected, double relative) {
  return std::abs(value - expected) <= relative * std::abs(expected);
}

/// A lattice saved after `before` steps and restored in another goes on, for `after` steps, as if never stopped.
template <typename Make>
void check_continuation(const Make& make, int before, int after) {
  LatticeIntegrator straight = make();
  LatticeIntegrator first = make();
  REQUIRE(std::isfinite(first.node().gamma));  // for which the velocity at the start is found
  for (int k = 0; k < before; ++k) {
    REQUIRE(straight.step().status == Status::success);
    REQUIRE(first.step().status == Status::success);
  }
  StateWriter writer;
  first.save(writer);
  LatticeIntegrator second = make();
  StateReader reader(writer.values());
  second.restore(reader);
  CHECK(reader.done());
  for (int k = 0; k < after; ++k) {
    const StepReport a = straight.step();
    const StepReport b = second.step();
    REQUIRE(a.status == Status::success);
    CHECK(a.h == b.h);
    CHECK(a.energy == b.energy);
    CHECK(a.iterations == b.iterations);
  }
  const auto a = straight.level().fields.all();
  const auto b = second.level().fields.all();
  CHECK(std::equal(a.begin(), a.end(), b.begin()));
  CHECK(straight.t() == second.t());
  // The twin: one more step makes a difference.
  REQUIRE(second.step().status == Status::success);
  CHECK_FALSE(std::equal(a.begin(), a.end(), second.level().fields.all().begin()));
}

}  // namespace

TEST_CASE("the sine-Gordon breather by box: the table of theory, section 5") {
  struct Expected {
    std::size_t cells;
    double step;
    Levels levels;
    std::size_t steps;
    double shortest, longest, residual, error;
  };
  const Expected table[] = {{201, 0.1, Levels::fixed, 200, 0.1, 0.1, 1.15e-2, 0.392},
                            {201, 0.1, Levels::variable, 101, 0.0998, 0.297, 1.51e-2, 0.462},
                            {401, 0.05, Levels::fixed, 400, 0.05, 0.05, 2.93e-3, 0.113},
                            {401, 0.05, Levels::variable, 199, 0.05, 0.152, 3.89e-3, 0.147}};
  for (const Expected& expected : table) {
    const Row row = run_breather(expected.cells, expected.step, expected.levels);
    INFO(expected.cells << " cells: " << row.steps << " steps, h " << row.shortest << " to " << row.longest
                        << ", spread " << row.spread << ", residual " << row.residual << ", error " << row.error);
    CHECK(std::abs(static_cast<double>(row.steps) - static_cast<double>(expected.steps)) <= 2);
    CHECK(within(row.shortest, expected.shortest, 0.02));
    CHECK(within(row.longest, expected.longest, 0.02));
    CHECK(within(row.residual, expected.residual, 0.02));
    CHECK(within(row.error, expected.error, 0.02));
    if (expected.levels == Levels::variable) {
      CHECK(row.spread <= 1e-12);
    } else {
      // The second-order oscillation of the discrete energy at fixed levels: what the variable ones remove.
      CHECK(within(row.spread, expected.cells == 201 ? 2.0e-3 : 5.0e-4, 0.02));
    }
  }
}

TEST_CASE("the table's error tells a wrong equation") {
  const Row row = run_breather(201, 0.1, Levels::fixed, wave_equation("1.02*(1 - cos(u))"));
  CHECK_FALSE(within(row.error, 0.392, 0.02));
}

TEST_CASE("box refuses even cell counts and names the next odd one") {
  const grids::Grid grid({{"x", -20, 20, 200}});
  const auto zero = sampled(grid, [](double) { return 0.0; });
  CHECK_THROWS_WITH(LatticeIntegrator(sine_gordon(), grid, {zero, zero, zero}, {.step = 0.1, .until = 1}),
                    Catch::Matchers::Contains("201"));
}

TEST_CASE("a restored lattice goes on bit for bit") {
  const grids::Grid grid({{"x", 0, 20, 101}});
  const InitialFields initial = {std::nullopt, sampled(grid, [](double x) { return 2 * std::pow(sech(x - 8), 2); }),
                                 std::nullopt, std::nullopt};
  const auto make = [&] {
    return LatticeIntegrator(korteweg_de_vries(6, 1), grid, initial,
                             {.step = 0.01, .until = 1, .levels = Levels::fixed});
  };
  check_continuation(make, 5, 5);
}

TEST_CASE("a restored lattice in the plane goes on bit for bit with variable levels, from its start too") {
  const grids::Grid grid({{"x", -7, 7, 31}, {"y", -7, 7, 27}});
  std::vector<double> bump(grid.size());
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const auto place = grid.place(i);
    bump[i] = 3 * sech(std::hypot(grid.axis(0).node(place[0]), grid.axis(1).node(place[1])));
  }
  const std::vector<double> zero(grid.size(), 0.0);
  const auto make = [&] {
    return LatticeIntegrator(wave_equation_2d("1 - cos(u)"), grid, {zero, bump, std::nullopt, std::nullopt},
                             {.step = 0.1, .until = 10, .on_singular = OnSingular::stop, .tolerance = 1e-12});
  };
  for (const int before : {0, 3}) {
    INFO("saved after " << before << " steps");
    check_continuation(make, before, 4);
  }
}

TEST_CASE("the discrete energy of a step is that of its middle, though no sweep over the cells ends it") {
  const auto system = sine_gordon();
  const grids::Grid grid({{"x", -10, 10, 101}});
  const auto u = sampled(grid, [](double x) { return 2 * std::exp(-x * x); });
  const LatticeLevel first = initial_level(system, grid, {u, u, std::nullopt});
  const auto scheme = make_box_scheme(system, grid, first, 0.1);
  REQUIRE(scheme->advance(0.1, 0.0) == Status::success);
  const double energy = scheme->discrete_energy();
  scheme->accept();
  grids::FieldSet middle(first.fields);
  for (std::size_t i = 0; i < middle.all().size(); ++i) {
    middle.all()[i] = 0.5 * (middle.all()[i] + std::as_const(scheme->level().fields).all()[i]);
  }
  CellSweep sweep(system, grid);
  const auto of = [&](const grids::FieldSet& fields) { return sweep(fields.pointers(), {}, {}, 0.0, {}, {}).energy; };
  CHECK(std::abs(of(middle) - energy) < 1e-14 * energy);  // the last correction's cube, and rounding
  CHECK(std::abs(of(first.fields) - energy) > 1e-6 * energy);
}

TEST_CASE("a step is forecast by the four before it, or by three and a trial of another length") {
  // Rates are polynomials of the third degree in time, which four values determine; of the fourth in the twin.
  const double quartic = GENERATE(0.0, 1.0);
  const auto rate = [&](double t) { return 1.0 + t * (1.0 + t * (-2.0 + t * (1.0 + quartic * t))); };
  LevelHistory history({false, true}, 3);  // one field that evolves, one at midpoints
  double t = 0.0;
  const auto put = [&](double h) {
    std::ranges::fill(history.increment().field(0), h * rate(t + 0.5 * h));
    std::ranges::fill(history.increment().field(1), 2.0 * rate(t + 0.5 * h));
  };
  const auto error = [&](double h) {
    const double of_evolving = std::abs(history.increment().field(0)[1] / h - rate(t + 0.5 * h));
    return std::max(of_evolving, std::abs(history.increment().field(1)[1] / 2.0 - rate(t + 0.5 * h)));
  };
  for (const double h : {0.2, 0.3, 0.2, 0.25, 0.3}) {
    put(h);
    history.record(0.5 * h, h);
    history.advance(h);
    t += h;
  }
  history.predict(0.2);
  CHECK((error(0.2) < 1e-12) == (quartic == 0.0));
  put(0.2);
  history.shift(0.2, 0.35);
  CHECK((error(0.35) < 1e-12) == (quartic == 0.0));
  // Twin: without the trial there are three left.
  history.predict(0.35);
  CHECK(error(0.35) > 1e-3);
}
