#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <utility>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/tangent.hpp>
#include <rubato/pde/variational_laws.hpp>
#include <rubato/variation/total_variation.hpp>

#include "equations.hpp"

// The laws of euler-box have their own form (theory, section 5, last lines), with values at the base corner of a cell.

using namespace rubato;
using namespace rubato::tests;

namespace {

LatticeOptions euler_box(double step, double until) {
  return {.lagrangian = "euler-box", .step = step, .until = until, .levels = Levels::fixed};
}

/// exp(-|x - shift|²) in as many directions as the grid has.
std::vector<double> bump(const grids::Grid& grid, double shift) {
  std::vector<double> values(grid.size());
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const auto place = grid.place(i);
    double square = 0.0;
    for (int a = 0; a < grid.dimensions(); ++a) {
      square += std::pow(grid.axis(a).node(place[static_cast<std::size_t>(a)]) - shift, 2);
    }
    values[i] = std::exp(-square);
  }
  return values;
}

InitialFields bumps(const MultisymplecticSystem& system, const grids::Grid& grid) {
  InitialFields fields;
  for (int f = 0; f < system.field_count(); ++f) {
    const bool computed = system.structure().algebraic[static_cast<std::size_t>(f)];
    fields.push_back(computed ? std::nullopt : std::optional(bump(grid, 0.3 * f)));
  }
  return fields;
}

/// The largest multisymplectic residual of two random tangents over 20 steps, in the form of `form`.
double worst_form(const MultisymplecticSystem& system, const MultisymplecticSystem& form, const grids::Grid& grid,
                  const LatticeOptions& options) {
  LatticeIntegrator lattice(system, grid, bumps(system, grid), options);
  LocalLaws laws = make_local_laws(lattice.method(), form, grid);
  TangentPair tangents(laws, lattice.method().tangents(system, grid), system, grid, 1);
  double worst = 0.0;
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    REQUIRE(tangents.take(lattice.previous(), lattice.level(), lattice.levels().last_step()) == Status::success);
    worst = std::max(worst, tangents.residual() ? tangents.residual()->largest() : 0.0);
  }
  REQUIRE(tangents.residual().has_value());
  return worst;
}

}  // namespace

TEST_CASE("euler-box and leapfrog conserve the multisymplectic form of two tangent solutions at every node") {
  // UᵀM₊V / h and UᵀK₊V / Δx are of order 100 (Schrödinger: 1e3), which rounds to 1e-14 (1e-13); 1e-11 of that is
  // asked.
  const grids::Grid line({{"x", -6, 6, 120}});
  const grids::Grid plane({{"x", -4, 4, 24}, {"y", -4, 4, 21}});
  const auto plane_wave = wave_equation_2d("1 - cos(u)");
  CHECK(worst_form(sine_gordon(), sine_gordon(), line, euler_box(0.05, 1)) < 1e-11);
  CHECK(worst_form(schroedinger(2), schroedinger(2), line, euler_box(0.002, 0.04)) < 1e-10);
  CHECK(worst_form(plane_wave, plane_wave, plane, euler_box(0.1, 2)) < 1e-11);
  const auto leapfrog = [](double step, double until) {
    return LatticeOptions{.lagrangian = "leapfrog", .step = step, .until = until};  // with variable levels
  };
  CHECK(worst_form(sine_gordon(), sine_gordon(), line, leapfrog(0.05, 1)) < 1e-11);
  CHECK(worst_form(plane_wave, plane_wave, plane, leapfrog(0.1, 2)) < 1e-11);
  // The twins: a wrong K, and the form of the box.
  const auto wrong_K =
      make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1.01}}}, "(v^2 - w^2)/2 + 1 - cos(u)");
  CHECK(worst_form(sine_gordon(), wrong_K, line, euler_box(0.05, 1)) > 1e-3);
  // Of leapfrog the variations of momenta are those that its own tangents show: another one is found out.
  const auto method = make_lattice_method({.name = "leapfrog"});
  const LatticeLevel level = initial_level(sine_gordon(), line, bumps(sine_gordon(), line), Collocation::corners);
  const auto step = method->tangents(sine_gordon(), line);
  LocalLaws laws = make_local_laws(*method, sine_gordon(), line);
  const grids::FieldSet u = random_tangent(sine_gordon(), line, 1), v = random_tangent(sine_gordon(), line, 2);
  grids::FieldSet u_next(u), v_next(v);
  REQUIRE((*step)(level, level, 0.05, u, u_next) == Status::success);
  const std::vector<grids::FieldSet> of_u(step->stages().begin(), step->stages().end());
  REQUIRE((*step)(level, level, 0.05, v, v_next) == Status::success);
  std::vector<grids::FieldSet> of_v(step->stages().begin(), step->stages().end());
  const auto residual = [&] {
    return laws.multisymplectic_residual({u, u_next, nullptr, of_u}, {v, v_next, nullptr, of_v}, 0.05).largest();
  };
  CHECK(residual() < 1e-11);
  of_v.front().field(0)[7] += 1e-3;
  CHECK(residual() > 1e-3);
}

TEST_CASE("the box's form is not that of euler-box") {
  const auto system = sine_gordon();
  const grids::Grid line({{"x", -6, 6, 120}});
  LatticeIntegrator lattice(system, line, bumps(system, line), euler_box(0.05, 1));
  const auto box = make_lattice_method({"box"});
  LocalLaws box_laws = make_local_laws(*box, system, line);
  const auto tangents = make_euler_box_tangents(system, line);
  TangentStep& step = *tangents;
  grids::FieldSet u = random_tangent(system, line, 1);
  grids::FieldSet v = random_tangent(system, line, 2);
  grids::FieldSet u_next = u;
  grids::FieldSet v_next = v;
  REQUIRE(lattice.step().status == Status::success);
  REQUIRE(step(lattice.previous(), lattice.level(), 0.05, u, u_next) == Status::success);
  REQUIRE(step(lattice.previous(), lattice.level(), 0.05, v, v_next) == Status::success);
  CHECK(box_laws.multisymplectic_residual({u, u_next}, {v, v_next}, 0.05).largest() > 1e-3);
  const auto corners = make_lattice_method({"euler-box"});
  LocalLaws laws = make_local_laws(*corners, system, line);
  CHECK_THROWS_WITH(laws.multisymplectic_residual({u, u_next}, {v, v_next}, 0.05),
                    Catch::Matchers::Contains("three levels"));
  CHECK(make_lattice_method({"fourier"})->tangents(system, line) == nullptr);
}

TEST_CASE("what the laws of euler-box know of a level is what is computed of it anew") {
  const auto system = sine_gordon();
  const grids::Grid line({{"x", -6, 6, 120}});
  LatticeIntegrator lattice(system, line, bumps(system, line), euler_box(0.05, 1));
  const LatticeMethod& method = lattice.method();
  LocalLaws laws = make_local_laws(method, system, line), fresh = make_local_laws(method, system, line);
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    const double h = lattice.levels().last_step();
    const auto sizes = laws.residuals(lattice.previous(), lattice.level(), h);
    CHECK(laws.totals(lattice.level()) == fresh.totals(lattice.level()));
    const auto again = make_local_laws(method, system, line).residuals(lattice.previous(), lattice.level(), h);
    for (std::size_t law = 0; law < sizes.size(); ++law) {
      CHECK(sizes[law].largest() == again[law].largest());
    }
  }
  // Of another level the totals are others.
  CHECK(laws.totals(lattice.previous()) == make_local_laws(method, system, line).totals(lattice.previous()));
  CHECK(laws.totals(lattice.previous()) != laws.totals(lattice.level()));
}

TEST_CASE("the tangents of euler-box and leapfrog are the derivatives of their maps") {
  for (const auto& [name, system, h] :
       {std::tuple("euler-box", schroedinger(2), 0.002), std::tuple("leapfrog", sine_gordon(), 0.05)}) {
    INFO(name);
    const grids::Grid line({{"x", -6, 6, 60}});
    const auto method = make_lattice_method({.name = name});
    const LatticeLevel first = initial_level(system, line, bumps(system, line), Collocation::corners);
    const grids::FieldSet u = random_tangent(system, line, 3);
    const auto after = [&, &system = system, h = h](double s) {
      LatticeLevel moved = first;
      for (std::size_t i = 0; i < moved.fields.all().size(); ++i) {
        moved.fields.all()[i] += s * u.all()[i];
      }
      const auto scheme = method->scheme(system, line, moved, h);
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      scheme->accept();
      return scheme->level();
    };
    grids::FieldSet tangent = u;
    const auto step = method->tangents(system, line);
    REQUIRE((*step)(first, after(0), h, u, tangent) == Status::success);
    // The map's third derivative is of order 1: the central difference is right to ε²/6 and rounds to 1e-16/ε.
    constexpr double epsilon = 1e-5;
    const LatticeLevel up = after(epsilon);
    const LatticeLevel down = after(-epsilon);
    double worst = 0.0;
    double change = 0.0;
    for (std::size_t i = 0; i < tangent.all().size(); ++i) {
      const double difference = (up.fields.all()[i] - down.fields.all()[i]) / (2 * epsilon);
      worst = std::max(worst, std::abs(difference - tangent.all()[i]));
      change = std::max(change, std::abs(difference - u.all()[i]));
    }
    CHECK(worst < 1e-8);
    CHECK(change > 1e-3);
  }
}

TEST_CASE("the variational residuals of euler-box are the variations of its action in the place of a node") {
  const auto system = sine_gordon();
  const grids::Grid grid({{"x", -6, 6, 60}});
  const double h = 0.1;
  LatticeIntegrator lattice(system, grid, bumps(system, grid), euler_box(h, 1));
  VariationalLaws variational(euler_box_action(system), system, grid);
  REQUIRE(lattice.step().status == Status::success);
  const LatticeLevel first = lattice.previous();
  const LatticeLevel second = lattice.level();
  CHECK_FALSE(variational.take(first, second, h).has_value());
  REQUIRE(lattice.step().status == Status::success);
  const LatticeLevel& third = lattice.level();
  REQUIRE(variational.take(second, third, h).has_value());

  // A cell with corners b (base), n (in time), r (in space), δ₁ = n - b, δ₂ = r - b: with M₊[u,v] = -1, K₊[u,w] = 1
  //   A = u_b [-(δ₁v δ₂x - δ₂v δ₁x) + (δ₂w δ₁t - δ₁w δ₂t)] - (δ₁t δ₂x - δ₁x δ₂t) S(z_b).
  struct Corner {
    double t, x, u, v, w;
  };
  const auto cell = [](const Corner& b, const Corner& n, const Corner& r) {
    const double S = (b.v * b.v - b.w * b.w) / 2 + 1 - std::cos(b.u);
    const double form = -((n.v - b.v) * (r.x - b.x) - (r.v - b.v) * (n.x - b.x)) + (r.w - b.w) * (n.t - b.t) -
                        (n.w - b.w) * (r.t - b.t);
    return b.u * form - ((n.t - b.t) * (r.x - b.x) - (n.x - b.x) * (r.t - b.t)) * S;
  };
  const std::array<const LatticeLevel*, 3> levels{&first, &second, &third};
  for (const std::size_t node : {20UL, 30UL, 41UL}) {
    // The three cells that read the node, as a function of where it lies.
    const auto action = [&](double dt, double dx) {
      const auto corner = [&](std::size_t k, std::size_t i) {
        const bool moved = k == 1 && i == node;
        const auto& z = levels[k]->fields;
        return Corner{static_cast<double>(k) * h + (moved ? dt : 0.0), grid.axis(0).node(i) + (moved ? dx : 0.0),
                      z.field(0)[i], z.field(1)[i], z.field(2)[i]};
      };
      const auto at = [&](std::size_t k, std::size_t i) {
        return cell(corner(k, i), corner(k + 1, i), corner(k, i + 1));
      };
      return at(1, node) + at(0, node) + at(1, node - 1);
    };
    // The action is bilinear in dt and dx, so that central differences are exact but for rounding (1e-16 over 1e-2).
    constexpr double step = 1e-2;
    const double energy = (action(step, 0) - action(-step, 0)) / (2 * step);
    const double momentum = (action(0, step) - action(0, -step)) / (2 * step);
    CHECK(std::abs(energy - variational.residual(0)[node]) < 1e-13);
    CHECK(std::abs(momentum - variational.residual(1)[node]) < 1e-13);
    CHECK(std::abs(energy - variational.residual(0)[node + 1]) > 1e-10);
  }
}

TEST_CASE("the laws of euler-box are of first order, its totals those of the discrete action") {
  const auto sizes = [](std::size_t cells, double step) {
    const auto system = sine_gordon();
    const grids::Grid grid({{"x", -10, 10, cells}});
    LatticeIntegrator lattice(system, grid, bumps(system, grid), euler_box(step, 1));
    std::array<Spread, 2> worst;
    double first = 0.0;
    double sum = 0.0;
    while (!lattice.finished()) {
      const double before = lattice.totals()[0];
      const StepReport report = lattice.step();
      REQUIRE(report.status == Status::success);
      CHECK(std::abs(report.energy - before) < 1e-13);  // E_k reads the level before
      first = first == 0.0 ? before : first;
      grids::FieldSet cell(2, grid.size());
      const auto residuals = lattice.residuals(cell.pointers());
      for (const double value : std::as_const(cell).field(0)) {
        sum += step * grid.spacing(0) * value;
      }
      worst[0].add(residuals[0]);
      worst[1].add(residuals[1]);
    }
    CHECK(std::abs(sum - (lattice.totals()[0] - first)) < 1e-12);  // fluxes telescope
    return std::array{worst[0].largest(), worst[1].largest()};
  };
  const auto coarse = sizes(400, 0.025);
  const auto fine = sizes(800, 0.0125);
  INFO("energy " << coarse[0] << ", " << fine[0] << ", momentum " << coarse[1] << ", " << fine[1]);
  CHECK(std::log2(coarse[0] / fine[0]) == Approx(1.0).margin(0.15));
  CHECK(std::log2(coarse[1] / fine[1]) == Approx(1.0).margin(0.15));
}

TEST_CASE("the mass of a potential is conserved by euler-box to rounding") {
  const auto system = make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "(v^2 - w^2)/2 + v^4/8");
  const grids::Grid grid({{"x", -6, 6, 60}});
  LatticeIntegrator lattice(system, grid, bumps(system, grid), euler_box(0.1, 1));
  REQUIRE(lattice.laws().names().back() == "mass");
  double mass = 0.0;
  double energy = 0.0;
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    const auto sizes = lattice.residuals();
    mass = std::max(mass, sizes.back().largest());
    energy = std::max(energy, sizes.front().largest());
  }
  CHECK(mass < 1e-12);  // v_t and w_x are of order 1, and round to 1e-16 over h or Δx
  CHECK(energy > 1e-4);
}
