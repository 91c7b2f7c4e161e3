// The Fourier scheme on even numbers of cells: where ∂ of the Nyquist mode is 0, potential forms have a kernel there.

#include <cmath>
#include <complex>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/pde/lattice_method.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

struct Case {
  std::string name;
  MultisymplecticSystem system;
  std::string given;  ///< the field that is given, a hump; an evolving one beside it is 0
};

std::vector<Case> potential_forms() {
  return {{"KdV", korteweg_de_vries(6, 1), "u"},
          {"BBM", benjamin_bona_mahony(1, 1, 1), "u"},
          {"Camassa-Holm", camassa_holm(1), "u"},
          {"Boussinesq", good_boussinesq(), "u"}};
}

InitialFields humps(const MultisymplecticSystem& system, const grids::Grid& grid) {
  InitialFields initial(system.fields().size());
  std::vector<double> hump(grid.size(), 0.1);
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const auto place = grid.place(i);
    double square = 0.0;
    for (int a = 0; a < grid.dimensions(); ++a) {
      square += std::pow(grid.axis(a).node(place[static_cast<std::size_t>(a)]), 2);
    }
    hump[i] += 0.3 * std::exp(-square / 4.0);
  }
  initial[static_cast<std::size_t>(system.field("u"))] = hump;
  if (system.fields().front() == "phi" && system.M()(0, 1) == 0.0) {  // Boussinesq: φ_t = v
    initial[static_cast<std::size_t>(system.field("v"))] = std::vector<double>(grid.size(), 0.0);
  }
  return initial;
}

double sawtooth_of(std::span<const double> values) {
  double sum = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    sum += i % 2 == 0 ? values[i] : -values[i];
  }
  return std::abs(sum) / static_cast<double>(values.size());
}

/// max |u| of the difference at the end, and the run's own checks on the way.
std::vector<double> run(const Case& example, const grids::Grid& grid, double step, double until, Levels levels) {
  LatticeIntegrator lattice(example.system, grid, humps(example.system, grid),
                            {.lagrangian = "fourier", .step = step, .until = until, .levels = levels});
  CHECK(lattice.cautions().empty());
  double energy = 0.0;
  int steps = 0;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    if (levels == Levels::variable && !report.off_law) {
      energy = steps++ == 0 ? report.energy : energy;
      CHECK(std::abs(report.energy - energy) <= 1e-12 * std::abs(energy));
    }
  }
  const auto u = lattice.field(example.system.field("u"));
  return {u.begin(), u.end()};
}

}  // namespace

TEST_CASE("fourier runs potential forms on even numbers of cells, with both kinds of levels") {
  for (const Case& example : potential_forms()) {
    for (const std::size_t cells : {48U, 50U, 45U}) {
      for (const Levels levels : {Levels::fixed, Levels::variable}) {
        INFO(example.name << ", " << cells << " cells, " << (levels == Levels::fixed ? "fixed" : "variable"));
        const grids::Grid grid({{"x", -10, 10, cells}});
        const auto u = run(example, grid, 0.02, 0.1, levels);
        if (cells % 2 == 0) {
          // u = φ_x has no Nyquist mode, at the start and ever after: rounding of 0.4 in each of a few steps.
          CHECK(sawtooth_of(u) < 1e-14);
        }
      }
    }
  }
}

TEST_CASE("fourier is of second order in time on an even number of cells") {
  const Case example{"KdV", korteweg_de_vries(6, 1), "u"};
  const grids::Grid grid({{"x", -10, 10, 48}});
  const auto exact = run(example, grid, 0.0025, 0.2, Levels::fixed);
  std::vector<double> errors;
  for (const double step : {0.04, 0.02, 0.01}) {
    errors.push_back(largest_difference(run(example, grid, step, 0.2, Levels::fixed), exact));
  }
  // The reference has an error of its own, 1/256, 1/64 and 1/16 of the coarse ones: slopes of log2(255/63 = 4.05)
  // = 2.02 and log2(63/15 = 4.2) = 2.07. Order 1 would give 1.1, order 3 at least 3.
  CHECK(std::log2(errors[0] / errors[1]) == Approx(2.02).margin(0.1));
  CHECK(std::log2(errors[1] / errors[2]) == Approx(2.07).margin(0.1));
}

TEST_CASE("fourier runs potential forms in the plane, even and odd numbers mixed") {
  const Case example{"ZK", zakharov_kuznetsov(), "u"};
  for (const auto& [nx, ny] : {std::pair{24U, 15U}, {15U, 24U}, {16U, 20U}}) {
    for (const Levels levels : {Levels::fixed, Levels::variable}) {
      INFO(nx << " x " << ny << (levels == Levels::fixed ? ", fixed" : ", variable"));
      static_cast<void>(run(example, grids::Grid({{"x", -6, 6, nx}, {"y", -6, 6, ny}}), 0.02, 0.06, levels));
    }
  }
}

TEST_CASE("a potential with derivatives in both directions has three sawtooths in the plane") {
  // Kadomtsev–Petviashvili, (u_t + u u_x + u_xxx)_x + u_yy = 0, u = φ_x, q = φ_y; u has mean 0 along x.
  const auto system =
      make_system({"phi", "u", "v", "w", "q"}, {{"phi", "u", 0.5}},
                  {{{"phi", "w", 1}, {"u", "v", -1}}, {{"phi", "q", 0.5}}}, "v^2/2 - u*w + u^3/6 - q^2/4");
  for (const auto& [nx, ny] : {std::pair{24U, 20U}, {24U, 21U}, {25U, 21U}}) {
    INFO(nx << " x " << ny);
    const grids::Grid grid({{"x", -6, 6, nx}, {"y", -6, 6, ny}});
    InitialFields initial(5);
    initial[1] = std::vector<double>(grid.size());
    for (std::size_t i = 0; i < grid.size(); ++i) {
      const double x = grid.axis(0).node(grid.place(i)[0]);
      const double y = grid.axis(1).node(grid.place(i)[1]);
      (*initial[1])[i] = -0.2 * x * std::exp(-(x * x + y * y) / 3.0);
    }
    LatticeIntegrator lattice(system, grid, initial,
                              {.lagrangian = "fourier", .step = 0.02, .until = 0.1, .levels = Levels::fixed});
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
    }
  }
}

TEST_CASE("a sawtooth that a potential cannot have is taken out of the data, and said if it was large") {
  const auto system = korteweg_de_vries(6, 1);
  const grids::Grid grid({{"x", -10, 10, 48}});
  InitialFields initial = humps(system, grid);
  auto& u = *initial[static_cast<std::size_t>(system.field("u"))];
  const auto smooth = u;
  for (std::size_t i = 0; i < u.size(); ++i) {
    u[i] += i % 2 == 0 ? 0.05 : -0.05;
  }
  const InitialLevel first = prepare_initial_level(system, grid, initial, Collocation::nodes);
  // What the smooth data have of it themselves: their kink at the seam, exp(-25), and less.
  CHECK(largest_difference(first.level.fields.field(system.field("u")), smooth) < 1e-11);
  REQUIRE(first.cautions.size() == 1);
  CHECK_THAT(first.cautions.front(), Catch::Contains("the initial u holds the sawtooth") && Catch::Contains("0.05") &&
                                         Catch::Contains("x = 49"));
  // The twins: what smooth data lose is not worth a word, and an odd number of cells loses nothing.
  u = smooth;
  CHECK(prepare_initial_level(system, grid, initial, Collocation::nodes).cautions.empty());
  const grids::Grid odd({{"x", -10, 10, 49}});
  initial = humps(system, odd);
  (*initial[1])[7] += 0.05;
  const auto used = prepare_initial_level(system, odd, initial, Collocation::nodes);
  CHECK(largest_difference(used.level.fields.field(1), *initial[1]) == 0.0);
}

TEST_CASE("a count near another is one that the scheme takes and is quick with, and there is none nearer") {
  struct Counts {
    LatticeMethodChoice choice;
    int dimensions;
    std::vector<std::pair<std::size_t, std::size_t>> counts;  ///< wanted, found
  };
  const LatticeMethodChoice box{.name = "box"}, two{.name = "box", .stages = 2},
      in_threes{.name = "box", .space_stages = 3}, fourier{.name = "fourier"}, splitting{.name = "splitting"},
      leapfrog{.name = "leapfrog"};
  const Counts all[] = {
      {box, 1, {{3, 3}, {500, 501}, {511, 511}, {512, 513}}},  // no transforms: odd
      {box, 2, {{512, 525}, {500, 525}, {63, 63}, {4, 5}}},    // odd, 3ᵃ5ᵇ7ᶜ
      {two, 1, {{500, 525}, {130, 135}}},                      // with transforms on a line, too
      {in_threes, 1, {{500, 525}, {200, 189}, {3, 3}}},        // odd multiples of three, with transforms
      {fourier, 1, {{500, 500}, {128, 128}, {100, 100}, {55, 56}, {53, 54}, {1030, 1029}, {57, 56}}},
      {splitting, 2, {{500, 500}, {511, 512}, {97, 98}}},
      {leapfrog, 1, {{500, 500}, {511, 511}}},  // any
  };
  for (const auto& [choice, dimensions, counts] : all) {
    const auto method = make_lattice_method(choice);
    for (const auto& [wanted, found] : counts) {
      INFO(choice.name << ", " << choice.stages << " stages, " << dimensions << " dimensions, about " << wanted);
      CHECK(method->count_near(wanted, dimensions) == found);
      CHECK(method->count_near(found, dimensions) == found);
      CHECK_FALSE(method->other_count(found, dimensions).has_value());
    }
  }
}

TEST_CASE("good odd counts have no prime factor beyond 7") {
  CHECK(grids::good_odd_count(1) == 1);
  CHECK(grids::good_odd_count(128) == 135);
  CHECK(grids::good_odd_count(64) == 75);
  CHECK(grids::good_odd_count(125) == 125);
  CHECK(grids::good_odd_count(256) == 315);
}
