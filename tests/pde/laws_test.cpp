#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/tangent.hpp>
#include <rubato/pde/variational_laws.hpp>
#include <rubato/variation/total_variation.hpp>

#include "cell_action.hpp"
#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

/// Takes steps of given lengths, without any law for them.
class FreeRun {
public:
  FreeRun(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& initial, double step)
      : scheme(make_box_scheme(system, grid, initial_level(system, grid, initial), step)), previous(scheme->level()) {}

  void step(double h) {
    previous = scheme->level();
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    scheme->accept();
  }

  std::unique_ptr<LatticeScheme> scheme;
  LatticeLevel previous;
};

Eigen::MatrixXd phase_rotation() {
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(4, 4);
  B(0, 1) = B(2, 3) = -1;  // (p, q, v, w) → (-q, p, -w, v)
  B(1, 0) = B(3, 2) = 1;
  return B;
}

InitialFields gaussians(const MultisymplecticSystem& system, const grids::Grid& grid) {
  InitialFields fields;
  for (int f = 0; f < system.field_count(); ++f) {
    if (system.structure().algebraic[static_cast<std::size_t>(f)]) {
      fields.emplace_back();
      continue;
    }
    std::vector<double> values(grid.size());
    for (std::size_t i = 0; i < grid.size(); ++i) {
      double exponent = 0.0;
      std::size_t rest = i;
      for (int a = 0; a < grid.dimensions(); ++a) {
        const double x = grid.axis(a).node(rest % grid.cells(a));
        rest /= grid.cells(a);
        exponent -= std::pow(x - 0.2 * f + 0.3 * a, 2);
      }
      values[i] = (1 + 0.1 * f) * std::exp(exponent);
    }
    fields.emplace_back(std::move(values));
  }
  return fields;
}

/// The largest energy and momentum residuals over 30 random levels, relative to the largest densities per step.
std::array<double, 2> worst_with_random_levels(const MultisymplecticSystem& system, const grids::Grid& grid) {
  FreeRun run(system, grid, gaussians(system, grid), 0.1);
  const auto method = make_lattice_method({"box"});
  LocalLaws laws = make_local_laws(*method, system, grid);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> spread(-0.8, 0.8);
  std::array<double, 2> worst{};
  for (int k = 0; k < 30; ++k) {
    const double h = 0.1 * (1 + spread(random));
    run.step(h);
    const auto sizes = laws.residuals(run.previous, run.scheme->level(), h);
    worst[0] = std::max(worst[0], sizes[0].largest());
    for (int a = 1; a <= grid.dimensions(); ++a) {
      worst[1] = std::max(worst[1], sizes[static_cast<std::size_t>(a)].largest());
    }
  }
  return worst;
}

/// The curl in M z_t + Σ K_a z_a = 0 for z = (H, E): K_a = diag(R_a, R_a), (R_a)_jk = ε_jak.
MultisymplecticSystem maxwell() {
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(6, 6);
  std::vector<Eigen::MatrixXd> K(3, M);
  for (int i = 0; i < 3; ++i) {
    M(i, 3 + i) = -1;
    M(3 + i, i) = 1;
  }
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3;
    const int c = (a + 2) % 3;
    for (int block : {0, 3}) {
      K[static_cast<std::size_t>(a)](block + c, block + b) = 1;
      K[static_cast<std::size_t>(a)](block + b, block + c) = -1;
    }
  }
  return {{"H1", "H2", "H3", "E1", "E2", "E3"}, M, K, "0"};
}

}  // namespace

TEST_CASE("for quadratic S the edge laws hold to rounding with any levels") {
  // Densities and fluxes are of order 1; differences of them over h ≥ 0.02 and Δx ≥ 0.1 round to 1e-14 or so.
  constexpr double rounding = 1e-12;
  const grids::Grid line({{"x", -6, 6, 121}});
  for (const auto& system : {wave_equation("u^2/2"), dirac(1, 0)}) {
    const auto [energy, momentum] = worst_with_random_levels(system, line);
    CHECK(energy < rounding);
    CHECK(momentum < rounding);
  }
  const grids::Grid cube({{"x", -3, 3, 13}, {"y", -3, 3, 11}, {"z", -3, 3, 9}});
  const auto [energy, momentum] = worst_with_random_levels(maxwell(), cube);
  CHECK(energy < rounding);
  CHECK(momentum < rounding);
  // The twin: with a potential that is not quadratic they do not.
  const auto [wrong_energy, wrong_momentum] = worst_with_random_levels(wave_equation("u^2/2 + u^4/4"), line);
  CHECK(wrong_energy > 1e4 * rounding);
  CHECK(wrong_momentum > 1e4 * rounding);
}

TEST_CASE("for other S the energy residual is of order h² whatever Δx, the momentum residual Δx² whatever h") {
  const auto sizes = [](std::size_t cells, double h) {
    const grids::Grid grid({{"x", -20, 20, cells}});
    LatticeIntegrator lattice(
        sine_gordon(), grid,
        {sampled(grid, [](double) { return 0.0; }), sampled(grid, [](double x) { return 3 * sech(x); }), std::nullopt},
        {.step = h, .until = 2, .levels = Levels::fixed});
    std::array<Spread, 2> worst;
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
      const auto step = lattice.residuals();
      worst[0].add(step[0]);
      worst[1].add(step[1]);
    }
    return std::array{worst[0].largest(), worst[1].largest()};
  };
  const auto base = sizes(401, 0.05);
  const auto half_h = sizes(401, 0.025);
  const auto half_dx = sizes(801, 0.05);
  CHECK(base[0] / half_h[0] == Approx(4.0).epsilon(0.05));
  CHECK(base[1] / half_h[1] == Approx(1.0).epsilon(0.05));
  CHECK(base[0] / half_dx[0] == Approx(1.0).epsilon(0.05));
  CHECK(base[1] / half_dx[1] == Approx(4.0).epsilon(0.05));
}

TEST_CASE("the multisymplectic form of two tangent solutions is conserved in every cell") {
  const auto worst = [](const MultisymplecticSystem& system, const MultisymplecticSystem& form,
                        const grids::Grid& grid) {
    FreeRun run(system, grid, gaussians(system, grid), 0.05);
    const auto method = make_lattice_method({"box"});
    LocalLaws laws = make_local_laws(*method, form, grid);
    TangentPair tangents(laws, make_box_tangents(system, grid), system, grid, 1);
    double largest = 0.0;
    for (int k = 0; k < 8; ++k) {
      const double h = k % 2 == 0 ? 0.05 : 0.08;
      run.step(h);
      REQUIRE(tangents.take(run.previous, run.scheme->level(), h) == Status::success);
      largest = std::max(largest, tangents.residual()->largest());
    }
    return largest;
  };
  // UᵀMV / h and UᵀKV / Δx are of order 100, so that 1e-11 of the scale is 1e-9.
  const grids::Grid line({{"x", -6, 6, 121}});
  const grids::Grid plane({{"x", -4, 4, 25}, {"y", -4, 4, 21}});
  CHECK(worst(sine_gordon(), sine_gordon(), line) < 1e-11);
  CHECK(worst(schroedinger(2), schroedinger(2), line) < 1e-10);
  CHECK(worst(wave_equation_2d("1 - cos(u)"), wave_equation_2d("1 - cos(u)"), plane) < 1e-10);
  const auto wrong_K =
      make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1.01}}}, "(v^2 - w^2)/2 + 1 - cos(u)");
  CHECK(worst(sine_gordon(), wrong_K, line) > 1e-3);
}

TEST_CASE("the charge of the Schrödinger equation is conserved exactly, averaged in x") {
  const grids::Grid grid({{"x", -20, 20, 201}});
  const auto system = schroedinger(2);
  const auto initial = InitialFields{sampled(grid, [](double x) { return sech(x) + 0.3 * sech(x - 3); }),
                                     sampled(grid, [](double x) { return 0.4 * sech(x + 2) * std::sin(x); }),
                                     std::nullopt, std::nullopt};
  LatticeIntegrator lattice(system, grid, initial,
                            {.step = 0.02, .until = 1, .symmetries = {{"charge", phase_rotation()}}});
  REQUIRE(lattice.laws().names() == std::vector<std::string>{"energy", "momentum", "charge"});
  const double before = lattice.totals()[2];
  const auto nodal = [&] {
    double sum = 0.0;
    for (std::size_t i = 0; i < grid.size(); ++i) {
      sum += lattice.field(0)[i] * lattice.field(0)[i] + lattice.field(1)[i] * lattice.field(1)[i];
    }
    return 0.5 * grid.spacing(0) * sum;
  };
  const double nodal_before = nodal();
  double local = 0.0;
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    local = std::max(local, lattice.residuals()[2].largest());
  }
  CHECK(local < 1e-12);
  CHECK(std::abs(lattice.totals()[2] - before) < 1e-12 * before);
  CHECK(std::abs(nodal() - nodal_before) > 1e-6);  // the nodal sum is another quantity, and drifts

  Eigen::MatrixXd wrong = phase_rotation();
  wrong(2, 3) = 1;
  CHECK_THROWS_WITH(make_local_laws(*make_lattice_method({"box"}), system, grid, {{"charge", wrong}}),
                    Catch::Matchers::Contains("charge"));
}

TEST_CASE("the variational node residuals are the variations of the action in the place of a node") {
  const auto system = GENERATE(sine_gordon(), wave_equation("(1 + x/10)*(1 - cos(u)) + x^2*u^2/20"));
  const grids::Grid grid({{"x", -6, 6, 61}});
  FreeRun run(system, grid, gaussians(system, grid), 0.1);
  VariationalLaws variational(box_action(system), system, grid);
  run.step(0.1);
  const LatticeLevel first = run.previous;
  const LatticeLevel second = run.scheme->level();
  CHECK_FALSE(variational.take(first, second, 0.1).has_value());
  run.step(0.13);
  const LatticeLevel& third = run.scheme->level();
  REQUIRE(variational.take(second, third, 0.13).has_value());

  FormulaAction action = box_cell_action(system);
  const std::array<const LatticeLevel*, 3> levels{&first, &second, &third};
  const std::array times{0.0, 0.1, 0.23};
  for (const std::size_t node : {20UL, 31UL, 44UL}) {
    std::vector<std::vector<double>> corners;
    for (std::size_t k = 0; k < 2; ++k) {
      for (std::size_t i = 0; i < 2; ++i) {
        auto& cell = corners.emplace_back();
        for (std::size_t c = 0; c < 4; ++c) {
          const std::size_t level = k + c / 2;
          const std::size_t place = node - 1 + i + c % 2;
          cell.push_back(times[level]);
          cell.push_back(grid.axis(0).node(place));
          for (int f = 0; f < 3; ++f) {
            cell.push_back(levels[level]->fields.field(f)[place]);
          }
        }
      }
    }
    const std::array elements{Incidence{corners[0], 3}, Incidence{corners[1], 2}, Incidence{corners[2], 1},
                              Incidence{corners[3], 0}};
    // Terms of order 1 times Δx: rounding of 1e-15.
    CHECK(std::abs(coordinate_variation(action, elements, 0) - variational.residual(0)[node]) < 1e-14);
    CHECK(std::abs(coordinate_variation(action, elements, 1) - variational.residual(1)[node]) < 1e-14);
    CHECK(std::abs(coordinate_variation(action, elements, 0) - variational.residual(0)[node + 1]) > 1e-10);
    // Both steps solve the box scheme, so the values' variation vanishes as well.
    CHECK(value_variation(action, elements).norm() < 1e-15);
  }
}

TEST_CASE(
    "laws of momentum are of the scheme's order where the fields that move are not those differentiated in space") {
  // The flux of momentum has rates of the rows of M₊: v where it is named before u; p2 of Dirac's equation.
  struct Case {
    std::string name;
    MultisymplecticSystem system;
    LatticeOptions options;
  };
  const auto waves = make_system({"v", "u", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "(v^2 - w^2)/2 + 1 - cos(u)");
  const auto cases = std::vector<Case>{
      {"sine-Gordon, splitting", waves, {.lagrangian = "splitting", .composition = "blanes-moan-4"}},
      {"sine-Gordon, collocation", waves, {.lagrangian = "fourier", .stages = 2}},
      {"Dirac, collocation", dirac(1.0, 1.0), {.lagrangian = "fourier", .stages = 2}},
  };
  const grids::Grid grid({{"x", 0, 6, 64}});
  for (const auto& [name, system, run] : cases) {
    InitialFields initial(system.fields().size());
    for (std::size_t f = 0; f < initial.size(); ++f) {
      if (system.fields()[f] == "w") {
        continue;
      }
      auto& values = initial[f].emplace(grid.size());
      for (std::size_t i = 0; i < values.size(); ++i) {
        const double x = grid.axis(0).node(i) * std::numbers::pi / 3.0;
        values[i] = 0.5 * std::cos(x + static_cast<double>(f)) + 0.2 * std::sin(2.0 * x);
      }
    }
    std::vector<double> sizes;
    for (const double h : {0.1, 0.05, 0.025}) {
      LatticeOptions options = run;
      options.step = h;
      options.until = 0.4;
      options.levels = Levels::fixed;
      LatticeIntegrator lattice(system, grid, initial, options);
      double largest = 0.0;
      while (!lattice.finished()) {
        REQUIRE(lattice.step().status == Status::success);
        largest = std::max(largest, lattice.residuals().at(1).max);
      }
      sizes.push_back(largest);
    }
    INFO(name << ": " << sizes[0] << ", " << sizes[1] << ", " << sizes[2]);
    if (run.lagrangian == "splitting") {
      // Order 4, and what is left of the next one. A rate that is left out leaves 2.5 at every h.
      CHECK(std::log2(sizes[0] / sizes[1]) == Approx(4.0).margin(0.5));
      CHECK(std::log2(sizes[1] / sizes[2]) == Approx(4.0).margin(0.3));
    } else {
      // The rates of stages are those of their polynomial, and the law is theirs but for products that 64 nodes alias:
      // some 1e-9 of terms of order 1.
      CHECK(*std::ranges::max_element(sizes) < 1e-7);
    }
  }
}
