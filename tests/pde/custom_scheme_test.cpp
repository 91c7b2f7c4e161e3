// Schemes that are stated as densities of the corners of a cell (pde/action_scheme.hpp).

#include <catch2/catch.hpp>

#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/parse.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/action_consistency.hpp>
#include <rubato/pde/action_scheme.hpp>
#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;
using Catch::Contains;

namespace {

std::shared_ptr<const CornerDensity> density_of(const MultisymplecticSystem& system, const std::string& L) {
  CornerDensity density = corner_variables(system.fields(), system.directions());
  density.L = formula::parse(L, *density.graph, corner_names(system.fields(), system.directions()));
  return std::make_shared<CornerDensity>(std::move(density));
}

StatedAction stated(const MultisymplecticSystem& system, const std::string& L) {
  return state_action(system, *density_of(system, L));
}

std::string signed_sum(const std::string& field, int dimensions, int direction) {
  std::string sum;
  for (int c = 0; c < 2 << dimensions; ++c) {
    const int bit = direction == 0 ? dimensions : direction - 1;
    const bool minus = direction >= 0 && (c >> bit & 1) == 0;
    sum += fmt::format("{}{}_{}", minus ? "-" : c == 0 ? "" : "+", field, corner_suffix(c, dimensions));
  }
  return sum;
}
/// The mean of the corners of a cell, and their mean difference along a direction, 0 for time.
std::string mean(const std::string& field, int dimensions = 1) {
  return fmt::format("(({})/{})", signed_sum(field, dimensions, -1), 2 << dimensions);
}
std::string slope(const std::string& field, int direction, int dimensions = 1) {
  constexpr std::array widths = {"h", "dx", "dy", "dz"};
  return fmt::format("(({})/({}*{}))", signed_sum(field, dimensions, direction), 1 << dimensions,
                     widths[static_cast<std::size_t>(direction)]);
}

/// ½ zᵀ(M D_t z + K D_x z) - S(z̄) of the sine-Gordon equation; `kinetic` is 1 in the box.
std::string box_density(double kinetic = 1.0) {
  const auto pair = [](const char* a, const char* b, int rho, const char* sign) {
    return fmt::format("{}0.5*({}*{} - {}*{})", sign, mean(a), slope(b, rho), mean(b), slope(a, rho));
  };
  return pair("v", "u", 0, "") + pair("u", "w", 1, "+") +
         fmt::format("-({:.17g}*{}^2 - {}^2)/2 - 1 + cos({})", kinetic, mean("v"), mean("w"), mean("u"));
}
const std::string leapfrog_density =
    "((u_10 - u_00)^2 + (u_11 - u_01)^2)/(4*h^2) - ((u_01 - u_00)^2 + (u_11 - u_10)^2)/(4*dx^2)"
    " - 1 + (cos(u_00) + cos(u_01) + cos(u_10) + cos(u_11))/4";
const std::string euler_box_density =
    "-u_00*(v_10 - v_00)/h + u_00*(w_01 - w_00)/dx - (v_00^2 - w_00^2)/2 - 1 + cos(u_00)";
/// Means of a step at both nodes of a cell: the midpoint rule in time, the trapezoidal rule in space.
const std::string midpoint_trapezoid =
    "((v_00 + v_10)*(u_10 - u_00) + (v_01 + v_11)*(u_11 - u_01))/(4*h) - ((v_00 + v_10)^2 + (v_01 + v_11)^2)/16"
    " - ((u_01 + u_11 - u_00 - u_10)/(2*dx))^2/2 - 1 + (cos((u_00 + u_10)/2) + cos((u_01 + u_11)/2))/2";
const std::string nine_points =
    "((u_10 + u_11 - u_00 - u_01)/(2*h))^2/2 - ((u_01 + u_11 - u_00 - u_10)/(2*dx))^2/2 - 1"
    " + cos((u_00 + u_01 + u_10 + u_11)/4)";

/// The same of any system, with the mean S by its text. \param twin of the first term of K in x alone, 0 in the box
std::string box_density(const MultisymplecticSystem& system, std::string S, double twin = 0.0) {
  const int n = system.directions();
  std::string L = "0";
  for (int rho = 0; rho <= n; ++rho) {
    for (int a = 0; a < system.field_count(); ++a) {
      for (int b = 0; b < system.field_count(); ++b) {
        const double entry = rho == 0 ? system.M()(a, b) : system.K(rho - 1)(a, b);
        if (entry != 0.0) {
          const auto f = static_cast<std::size_t>(a), g = static_cast<std::size_t>(b);
          L += fmt::format("{:+.17g}*{}*{}", 0.5 * entry * (1.0 + (rho == 1 ? std::exchange(twin, 0.0) : 0.0)),
                           mean(system.fields()[f], n), slope(system.fields()[g], rho, n));
        }
      }
    }
  }
  for (std::size_t at = S.find('['); at != std::string::npos; at = S.find('[')) {
    const std::size_t end = S.find(']');
    S.replace(at, end - at + 1, mean(S.substr(at + 1, end - at - 1), n));
  }
  return L + " - (" + S + ")";
}

constexpr double omega = 0.6;
/// A breather with u_t ≠ 0 at the start.
double breather(double x, double t) {
  const double gamma = std::sqrt(1.0 - omega * omega);
  return 4.0 * std::atan(gamma / omega * std::sin(omega * t) * sech(gamma * x));
}
double breather_rate(double x, double t) {
  const double gamma = std::sqrt(1.0 - omega * omega), s = gamma / omega * std::sin(omega * t) * sech(gamma * x);
  return 4.0 * gamma * std::cos(omega * t) * sech(gamma * x) / (1.0 + s * s);
}
grids::Grid line(std::size_t cells) {
  return grids::Grid({{"x", -20.0, 20.0, cells}});
}
InitialFields breather_fields(const grids::Grid& grid, double t = 0.3) {
  return {sampled(grid, [t](double x) { return breather(x, t); }),
          sampled(grid, [t](double x) { return breather_rate(x, t); }), std::nullopt};
}

LatticeOptions options_of(const MultisymplecticSystem& system, const std::string& L, double step, double until,
                          Levels levels) {
  LatticeOptions options{.lagrangian = "custom", .step = step, .until = until, .levels = levels};
  options.density = density_of(system, L);
  return options;
}

/// The largest difference of a field between two runs of so many steps.
double distance(LatticeIntegrator& a, LatticeIntegrator& b, int field, int steps) {
  double largest = 0.0;
  for (int k = 0; k < steps; ++k) {
    REQUIRE(a.step().status == Status::success);
    REQUIRE(b.step().status == Status::success);
    largest = std::max(largest, largest_difference(a.field(field), b.field(field)));
  }
  return largest;
}

}  // namespace

TEST_CASE("box, euler-box and leapfrog as densities step as the built-in schemes", "[pde][custom]") {
  const MultisymplecticSystem system = sine_gordon();
  constexpr std::size_t cells = 101;
  constexpr double h = 0.05;
  const grids::Grid grid = line(cells);
  struct Case {
    const char* name;
    std::string L, twin;
    double condition;  ///< of what turns rounding errors of the rows into those of levels
  };
  // 4N/π is that of A⁻¹D; leapfrog has u_t from levels h apart, and the field is 4 there.
  const Case cases[] = {{"box", box_density(), box_density(1.0 + 1e-9), 4.0 * cells / std::numbers::pi},
                        {"euler-box", euler_box_density, euler_box_density + " + 1e-9*u_00^2", 4.0 / h},
                        {"leapfrog", leapfrog_density, leapfrog_density + " + 1e-9*u_00*u_01", 4.0 / h}};
  for (const Case& one : cases) {
    INFO(one.name);
    for (const bool is_twin : {false, true}) {
      LatticeIntegrator built_in(system, grid, breather_fields(grid),
                                 {.lagrangian = one.name, .step = h, .until = 100.0, .levels = Levels::fixed});
      LatticeIntegrator stated(system, grid, breather_fields(grid),
                               options_of(system, is_twin ? one.twin : one.L, h, 100.0, Levels::fixed));
      for (int k = 0; k < 200; ++k) {
        REQUIRE(built_in.step().status == Status::success);
        REQUIRE(stated.step().status == Status::success);
      }
      double largest = 0.0;
      for (int f = 0; f < 3; ++f) {
        largest = std::max(largest, largest_difference(built_in.field(f), stated.field(f)));
      }
      CHECK((largest <= 1e-13 * one.condition) == !is_twin);
    }
  }
}

TEST_CASE("two levels that are given begin a run of the two-step form", "[pde][custom]") {
  const MultisymplecticSystem system = sine_gordon();
  const grids::Grid grid = line(101);
  constexpr double h = 0.05;
  LatticeIntegrator built_in(system, grid, breather_fields(grid),
                             {.lagrangian = "leapfrog", .step = h, .until = 100.0, .levels = Levels::fixed});
  REQUIRE(built_in.step().status == Status::success);
  const std::vector<double> second(built_in.field(0).begin(), built_in.field(0).end());
  LatticeOptions options = options_of(system, leapfrog_density, h, 100.0, Levels::fixed);
  options.next = std::make_shared<SecondLevel>(SecondLevel{{second, std::nullopt, std::nullopt}, h});
  LatticeIntegrator stated(system, grid, breather_fields(grid), options);
  REQUIRE(stated.step().status == Status::success);
  CHECK(distance(built_in, stated, 0, 200) <= 1e-13 * 4.0 / h);

  options.density = density_of(system, box_density());
  CHECK_THROWS_WITH(LatticeIntegrator(system, grid, breather_fields(grid), options), Contains("gives no v"));
}

TEST_CASE("densities that are nowhere in the code keep their energy at variable levels", "[pde][custom]") {
  const MultisymplecticSystem system = sine_gordon();
  const grids::Grid grid = line(101);
  for (const std::string& L : {midpoint_trapezoid, nine_points}) {
    INFO(L);
    LatticeIntegrator lattice(system, grid, breather_fields(grid), options_of(system, L, 0.1, 8.0, Levels::variable));
    TangentPair tangents(lattice.laws(), lattice.method().tangents(lattice.system(), grid), lattice.system(), grid, 1);
    double first = 0.0, miss = 0.0, shortest = 1.0, longest = 0.0, residual = 0.0;
    while (!lattice.finished()) {
      const StepReport report = lattice.step();
      REQUIRE(report.status == Status::success);
      REQUIRE(!report.off_law);
      first = first == 0.0 ? report.energy : first;
      miss = std::max(miss, std::abs(report.energy - first));
      shortest = std::min(shortest, report.h);
      longest = std::max(longest, report.h);
      REQUIRE(tangents.take(lattice.previous(), lattice.level(), report.h) == Status::success);
      residual = std::max(residual, tangents.residual()->largest());
    }
    CHECK(miss <= 1e-13 * lattice.levels().energy_scale());
    CHECK(longest > 1.2 * shortest);
    // Products of tangents of about 1 that grow tenfold, over h and times 1/Δx of their momenta, at rounding.
    CHECK(residual < 1e-9);
    // A momentum that is none of the second solution's is found out.
    const auto step = lattice.method().tangents(lattice.system(), grid);
    const grids::FieldSet u = random_tangent(lattice.system(), grid, 1), v = random_tangent(lattice.system(), grid, 2);
    grids::FieldSet u_1(u), v_1(v);
    REQUIRE((*step)(lattice.previous(), lattice.level(), lattice.levels().last_step(), u, u_1) == Status::success);
    const std::vector<grids::FieldSet> of_u(step->stages().begin(), step->stages().end());
    REQUIRE((*step)(lattice.previous(), lattice.level(), lattice.levels().last_step(), v, v_1) == Status::success);
    std::vector<grids::FieldSet> of_v(step->stages().begin(), step->stages().end());
    const double h = lattice.levels().last_step();
    const auto law = [&] {
      return lattice.laws().multisymplectic_residual({u, u_1, nullptr, of_u}, {v, v_1, nullptr, of_v}, h).largest();
    };
    CHECK(law() < 1e-10);
    of_v.front().field(0)[7] += 1e-3;
    CHECK(law() > 1e-6);
  }
}

TEST_CASE("densities that are nowhere in the code are of order 2", "[pde][custom]") {
  const MultisymplecticSystem system = sine_gordon();
  const auto error = [&](const std::string& L, int times) {
    const grids::Grid grid = line(static_cast<std::size_t>(101 * times));
    LatticeIntegrator lattice(system, grid, breather_fields(grid),
                              options_of(system, L, 0.1 / times, 6.0, Levels::fixed));
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
    }
    const double end = 0.3 + lattice.t();
    return largest_difference(lattice.field(0), sampled(grid, [end](double x) { return breather(x, end); }));
  };
  // Odd numbers of cells: thrice as many. The term of order 4 makes a tenth here.
  for (const std::string& L : {midpoint_trapezoid, nine_points}) {
    CHECK(std::log(error(L, 1) / error(L, 3)) / std::log(3.0) == Approx(2.0).margin(0.2));
  }
  // Another equation: waves are faster by half a percent.
  const std::string wrong = nine_points + " - 0.01*((u_01 - u_00)/dx)^2/2";
  CHECK(std::log(error(wrong, 1) / error(wrong, 3)) / std::log(3.0) < 1.5);
}

TEST_CASE("a density of another equation is found out", "[pde][custom]") {
  const MultisymplecticSystem system = sine_gordon();
  for (const std::string& L : {box_density(), leapfrog_density, euler_box_density, midpoint_trapezoid, nine_points}) {
    CHECK(consistency_of(system, stated(system, L)).wrong.empty());
  }
  CHECK(consistency_of(system, stated(system, box_density(1.01))).wrong == std::vector<std::string>{"v"});
  CHECK(consistency_of(system, stated(system, nine_points + " - 0.01*((u_01 - u_00)/dx)^2/2")).wrong ==
        std::vector<std::string>{"u"});
  CHECK(consistency_of(system, stated(system, nine_points + " + 0.001*h*u_00/dx")).wrong ==
        std::vector<std::string>{"u"});
}

TEST_CASE("a density of another equation is found out where rows that are not linear give what it leaves out",
          "[pde][custom]") {
  const auto wrong = [](const MultisymplecticSystem& system, const std::string& L) {
    const ActionConsistency found = consistency_of(system, stated(system, L));
    CHECK(found.is_tested);
    CHECK((found.off > 0.0) == !found.wrong.empty());
    return found.wrong;
  };
  const std::vector<std::string> none, u = {"u"}, phi = {"phi"};
  // The momentum of a relativistic particle; momenta that follow from two rows together.
  const MultisymplecticSystem particles =
      make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "sqrt(1 + v^2) - w^2/2 + u^4/4");
  const std::string rest = " - ((u_01 - u_00)/dx)^2/2 - u_00^4/4";
  CHECK(wrong(particles, "-sqrt(1 - ((u_10 - u_00)/h)^2)" + rest) == none);
  CHECK(wrong(particles, "-1.5*sqrt(1 - ((u_10 - u_00)/h)^2)" + rest) == u);
  const MultisymplecticSystem pairs =
      make_system({"u", "q", "v", "p", "w", "s"}, {{"u", "v", -1}, {"q", "p", -1}}, {{{"u", "w", 1}, {"q", "s", 1}}},
                  "sqrt(1 + v^2 + p^2) - (w^2 + s^2)/2");
  const std::string strings = " - ((u_01 - u_00)/dx)^2/2 - ((q_01 - q_00)/dx)^2/2";
  CHECK(wrong(pairs, "-sqrt(1 - ((u_10 - u_00)/h)^2 - ((q_10 - q_00)/h)^2)" + strings) == none);
  CHECK(wrong(pairs, "-sqrt(1 - ((u_10 - u_00)/h)^2 - 0.9*((q_10 - q_00)/h)^2)" + strings) ==
        std::vector<std::string>{"u", "q"});
  // u_t + u u_x = 0 by its potential: the row of w gives u, and that of u gives w.
  const MultisymplecticSystem hopf =
      make_system({"phi", "u", "w"}, {{"phi", "u", 0.5}}, {{{"phi", "w", 1}}}, "u^3/6 - u*w");
  const std::string p_t = slope("phi", 0), p_x = slope("phi", 1);
  CHECK(wrong(hopf, fmt::format("-{}*{}/2 - {}^3/6", p_t, p_x, p_x)) == none);
  CHECK(wrong(hopf, fmt::format("-{}*{}/2 - {}^3/5", p_t, p_x, p_x)) == phi);
  // A field that no row gives.
  CHECK_FALSE(consistency_of(sine_gordon(), stated(sine_gordon(), "v_10*v_00")).is_tested);
}

TEST_CASE("modes that no row determines are found and held", "[pde][custom]") {
  const MultisymplecticSystem system = korteweg_de_vries(1.0, 0.022);
  const std::string L = fmt::format("-0.5*{}*{} - {}*{} - 0.5*0.022*({}*{} - {}*{}) - {}^2/2 + {}*{} - {}^3/6",
                                    slope("phi", 0), mean("u"), slope("phi", 1), mean("w"), mean("u"), slope("v", 1),
                                    mean("v"), slope("u", 1), mean("v"), mean("u"), mean("w"), mean("u"));
  for (const std::size_t cells : {61UL, 60UL}) {
    const grids::Grid grid({{"x", 0.0, 2.0, cells}});
    const InitialFields given = {std::nullopt,
                                 sampled(grid, [](double x) { return 1.0 + 0.5 * std::cos(std::numbers::pi * x); }),
                                 std::nullopt, std::nullopt};
    LatticeIntegrator lattice(system, grid, given, options_of(system, L, 1e-3, 0.05, Levels::fixed));
    REQUIRE(!lattice.cautions().empty());
    CHECK_THAT(lattice.cautions().back(), Contains("the mean of phi"));
    CHECK((lattice.cautions().back().find("(-1)^i") != std::string::npos) == (cells % 2 == 0));
    const auto mean_of_phi = [&] { return grids::sum(lattice.field(0)) / static_cast<double>(cells); };
    const double before = mean_of_phi();
    double mass = grids::sum(lattice.field(1));
    for (int k = 0; k < 30; ++k) {
      REQUIRE(lattice.step().status == Status::success);
    }
    CHECK(mean_of_phi() == Approx(before).margin(1e-12));
    CHECK(grids::sum(lattice.field(1)) == Approx(mass).epsilon(1e-12));
    if (cells % 2 != 0) {
      LatticeIntegrator box(system, grid, given,
                            {.lagrangian = "box", .step = 1e-3, .until = 0.05, .levels = Levels::fixed});
      LatticeIntegrator again(system, grid, given, options_of(system, L, 1e-3, 0.05, Levels::fixed));
      CHECK(distance(box, again, 1, 30) <= 1e-13 * 4.0 * 61.0 / std::numbers::pi);
    }
  }
}

TEST_CASE("the density of the box keeps the mean of a field that a potential has for its slope", "[pde][custom]") {
  struct Case {
    MultisymplecticSystem system;
    std::string S;
  };
  constexpr std::size_t cells = 31;
  constexpr double condition = 4.0 * cells / std::numbers::pi;
  const grids::Grid grid({{"x", 0.0, 2.0 * std::numbers::pi, cells}});
  for (const Case& one : {Case{korteweg_de_vries(1.0, 0.3), "[v]^2/2 - [u]*[w] + [u]^3/6"},
                          Case{benjamin_bona_mahony(1.0, 1.0, 1.0), "[u]^2/2 + [u]^3/6 - [p]*[u] - [v]*[w]/2"},
                          Case{good_boussinesq(), "[v]^2/2 - [w]^2/2 + [u]^2/2 + [u]^3/3 - [p]*[u]"}}) {
    INFO(one.S);
    InitialFields given(one.system.fields().size());
    given[1] = sampled(grid, [](double x) { return 0.4 + 0.2 * std::cos(x); });
    if (one.system.M()(0, 2) != 0.0) {  // v = phi_t
      given[2] = sampled(grid, [](double x) { return 0.1 * std::sin(x); });
    }
    for (const double twin : {0.0, 1e-9}) {
      LatticeIntegrator box(one.system, grid, given,
                            {.lagrangian = "box", .step = 0.02, .until = 100.0, .levels = Levels::fixed});
      LatticeIntegrator stated(
          one.system, grid, given,
          options_of(one.system, box_density(one.system, one.S, twin), 0.02, 100.0, Levels::fixed));
      double fields = 0.0, energies = 0.0;
      for (int k = 0; k < 200; ++k) {
        const StepReport of_box = box.step(), report = stated.step();
        REQUIRE(of_box.status == Status::success);
        REQUIRE(report.status == Status::success);
        fields = std::max(fields, largest_difference(box.field(1), stated.field(1)));
        energies = std::max(energies, std::abs(of_box.energy - report.energy));
      }
      CHECK((fields <= 1e-13 * condition) == (twin == 0.0));
      CHECK((energies <= 1e-13 * condition * grid.volume()) == (twin == 0.0));
    }
  }
}

TEST_CASE("a density that reads a potential with a mean slope is refused, and one with differences of it is not",
          "[pde][custom]") {
  const MultisymplecticSystem system = korteweg_de_vries(1.0, 0.3);
  const grids::Grid grid({{"x", 0.0, 2.0 * std::numbers::pi, 31}});
  const std::string L = box_density(system, "[v]^2/2 - [u]*[w] + [u]^3/6");
  const auto begin = [&](const std::string& of, double mean_of_u) {
    const InitialFields given = {std::nullopt, sampled(grid, [&](double x) { return mean_of_u + std::cos(x); }),
                                 std::nullopt, std::nullopt};
    static_cast<void>(LatticeIntegrator(system, grid, given, options_of(system, of, 0.02, 1.0, Levels::fixed)));
  };
  CHECK_NOTHROW(begin(L, 0.5));
  CHECK_NOTHROW(begin(L + " + 0.001*(phi_01 - phi_00)^2", 0.5));
  CHECK_NOTHROW(begin(L + " + 0.001*phi_00^2", 0.0));
  CHECK_THROWS_WITH(begin(L + " + 0.001*phi_00^2", 0.5),
                    Contains("L reads phi itself, whose mean slope is 0.5") && Contains("differences of phi"));
}

TEST_CASE("a density in the plane steps as leapfrog and as box do", "[pde][custom]") {
  const MultisymplecticSystem system = wave_equation_2d("u^4/4");
  const grids::Grid grid({{"x", -4.0, 4.0, 21}, {"y", -4.0, 4.0, 17}});
  std::vector<double> u, v(grid.size(), 0.0);
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const auto place = grid.place(i);
    u.push_back(std::exp(-std::pow(grid.axis(0).node(place[0]), 2) - std::pow(grid.axis(1).node(place[1]) - 0.3, 2)));
  }
  const InitialFields given = {u, v, std::nullopt, std::nullopt};
  std::string leapfrog, box;
  for (int c = 0; c < 8; ++c) {
    const auto corner = [](int number) { return "u_" + corner_suffix(number, 2); };
    if (c < 4) {
      leapfrog += fmt::format("{}(({} - {})/h)^2/8", c == 0 ? "" : " + ", corner(c + 4), corner(c));
    }
    leapfrog += fmt::format(" - {}^4/32", corner(c));
    for (const int bit : {1, 2}) {
      if ((c & bit) == 0) {
        leapfrog += fmt::format(" - (({} - {})/{})^2/8", corner(c + bit), corner(c), bit == 1 ? "dx" : "dy");
      }
    }
  }
  const auto pair = [](const char* a, const char* b, int rho) {
    return fmt::format("{}0.5*({}*{} - {}*{})", rho == 0 ? "" : " + ", mean(a, 2), slope(b, rho, 2), mean(b, 2),
                       slope(a, rho, 2));
  };
  box += pair("v", "u", 0) + pair("u", "a", 1) + pair("u", "b", 2) +
         fmt::format(" - ({}^2 - {}^2 - {}^2)/2 - {}^4/4", mean("v", 2), mean("a", 2), mean("b", 2), mean("u", 2));
  for (const auto& [name, L] : {std::pair("leapfrog", leapfrog), {"box", box}}) {
    INFO(name);
    LatticeIntegrator built_in(system, grid, given,
                               {.lagrangian = name, .step = 0.05, .until = 10.0, .levels = Levels::fixed});
    LatticeIntegrator stated(system, grid, given, options_of(system, L, 0.05, 10.0, Levels::fixed));
    // Averages in both directions: (4·21/π)(4·17/π).
    CHECK(distance(built_in, stated, 0, 50) <= 1e-13 * (84.0 / std::numbers::pi) * (68.0 / std::numbers::pi));
  }
}

TEST_CASE("a density that leaves a field free is refused by its name", "[pde][custom]") {
  const MultisymplecticSystem system = sine_gordon();
  const grids::Grid grid = line(21);
  const auto begin = [&](const std::string& L) {
    static_cast<void>(
        LatticeIntegrator(system, grid, breather_fields(grid), options_of(system, L, 0.05, 1.0, Levels::fixed)));
  };
  CHECK_NOTHROW(begin(nine_points));
  CHECK_THROWS_WITH(begin(nine_points + " + v_00/2"), Contains("L does not determine v"));
  CHECK_THROWS_WITH(begin("w_00*w_11 - w_00^2"), Contains("L does not name u"));
  // E reads one level.
  CHECK_THROWS_WITH(LatticeIntegrator(system, grid, breather_fields(grid),
                                      options_of(system, euler_box_density, 0.05, 1.0, Levels::variable)),
                    Contains("reads one level"));
}

TEST_CASE("a density with a domain is looked at where it is defined, and refused by what is not", "[pde][custom]") {
  const MultisymplecticSystem system =
      make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "sqrt(1 + v^2) - w^2/2 + u^4/4");
  const auto L = [](double strings) {
    return fmt::format(
        "-sqrt(1 - ((u_10 - u_00)/h)^2) - {}*(((u_01 - u_00)/dx)^2 + ((u_11 - u_10)/dx)^2)/4"
        " - (u_00^4 + u_10^4)/8",
        strings);
  };
  CHECK(stated(system, L(1.0)).is_symmetric);
  CHECK_FALSE(stated(system, L(1.0) + " + u_00^3").is_symmetric);
  // Against waves that are exact in space, with small steps.
  const auto error = [&](double strings, int times) {
    const grids::Grid grid({{"x", 0.0, 6.0, static_cast<std::size_t>(32 * times)}});
    const InitialFields given = {
        sampled(grid, [](double x) { return 0.3 * std::cos(2.0 * std::numbers::pi * x / 6.0); }),
        std::vector<double>(grid.size(), 0.0), std::nullopt};
    LatticeIntegrator lattice(system, grid, given, options_of(system, L(strings), 0.1 / times, 1.0, Levels::fixed));
    LatticeOptions exact{.lagrangian = "fourier", .step = 0.1, .until = 1.0, .levels = Levels::fixed};
    exact.stages = 3;
    LatticeIntegrator reference(system, grid, given, exact);
    CHECK(lattice.cautions().empty() == (strings == 1.0));
    for (LatticeIntegrator* one : {&lattice, &reference}) {
      while (!one->finished()) {
        REQUIRE(one->step().status == Status::success);
      }
    }
    return largest_difference(lattice.field(0), reference.field(0));
  };
  CHECK(error(1.0, 1) / error(1.0, 2) == Approx(4.0).margin(0.3));
  CHECK(error(1.05, 1) / error(1.05, 2) < 2.0);

  const grids::Grid grid = line(21);
  const auto begin = [&](const MultisymplecticSystem& of, const std::string& density, double u) {
    const InitialFields given = {std::vector<double>(grid.size(), u), std::vector<double>(grid.size(), 0.0),
                                 std::nullopt};
    LatticeIntegrator lattice(of, grid, given, options_of(of, density, 0.05, 1.0, Levels::fixed));
    REQUIRE(lattice.step().status == Status::success);
    return lattice.cautions().size();
  };
  CHECK_THROWS_WITH(begin(system, "sqrt(u_10 - u_00 - 5)", 0.1),
                    Contains("the variation of L by u is not defined") && Contains("near u = 0.1"));
  // Where the data are it is defined.
  const MultisymplecticSystem far = wave_equation("sqrt(u - 5)");
  const std::string of_far = "((u_10 - u_00)/h)^2/2 - ((u_01 - u_00)/dx)^2/2 - ";
  CHECK(begin(far, of_far + "sqrt(u_00 - 5)", 6.0) == 0);
  CHECK(begin(far, of_far + "2*sqrt(u_00 - 5)", 6.0) == 1);
}

TEST_CASE("fields that rows of other fields give follow one after the other", "[pde][custom]") {
  // u_tt = -u_xxxx in the form that [field] derives, of which L names u alone.
  const MultisymplecticSystem system = make_system({"u", "s", "m", "c", "v"}, {{"u", "v", -1}},
                                                   {{{"u", "m", -1}, {"s", "c", 1}}}, "s*m - c^2/2 + v^2/2");
  const grids::Grid grid({{"x", 0.0, 2.0 * std::numbers::pi, 21}});
  const InitialFields given = {sampled(grid, [](double x) { return std::cos(x); }), std::nullopt, std::nullopt,
                               std::nullopt, std::vector<double>(grid.size(), 0.5)};
  LatticeIntegrator lattice(system, grid, given, options_of(system, "((u_10 - u_00)/h)^2/2", 0.05, 1.0, Levels::fixed));
  REQUIRE(lattice.step().status == Status::success);
  const auto misses = [&](int field, int of, double sign, std::size_t shift) {
    double largest = 0.0;
    for (std::size_t i = 0; i < grid.size(); ++i) {
      const std::size_t lower = (i + grid.size() - shift) % grid.size(), upper = (lower + 1) % grid.size();
      const double slope = (lattice.field(of)[upper] - lattice.field(of)[lower]) / grid.spacing(0);
      largest = std::max(largest, std::abs(lattice.field(field)[i] - sign * slope));
    }
    return largest;
  };
  // s = u_x and c = s_x, forward or backward, at the rounding of a difference.
  CHECK(std::min(misses(1, 0, 1.0, 0), misses(1, 0, 1.0, 1)) < 1e-13);
  CHECK(std::min(misses(3, 1, 1.0, 0), misses(3, 1, 1.0, 1)) < 1e-13);
  CHECK(misses(3, 0, 1.0, 0) > 0.1);
}
