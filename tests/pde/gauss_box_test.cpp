// Gauss collocation in time on the cells of the box: against the box scheme, by slopes, and by its own laws.

#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/tangent.hpp>
#include <rubato/variation/gauss_tableau.hpp>

#include "humps.hpp"
#include "kept_energy.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr SpaceRule cells{.stages = 1};

/// sine-Gordon from a hump that is smooth beyond its period, at rest, on 16.
InitialFields smooth_hump(const grids::Grid& grid) {
  InitialFields initial(3);
  initial[0] = sampled(grid, [](double x) { return 2 * std::exp(2 * std::cos(2 * M_PI * x / 16) - 2); });
  initial[1] = sampled(grid, [](double x) { return 0.5 * std::exp(2 * std::cos(2 * M_PI * (x - 1) / 16) - 2); });
  return initial;
}

/// Every equation with one stage in space, those on a line with three, too.
std::vector<std::pair<Example, int>> examples_and_stages() {
  std::vector<std::pair<Example, int>> all;
  for (const Example& example : examples(true)) {
    all.emplace_back(example, 1);
    if (example.grid.dimensions() == 1) {
      all.emplace_back(example, 3);
    }
  }
  return all;
}

}  // namespace

TEST_CASE("one Gauss stage on cells is the box scheme") {
  // Two programs that share no line of the step: block elimination in the cells, and the fixed point on every wave,
  // whose sawtooths rounding enters 45 times enlarged.
  for (const Example& example : examples(true)) {
    INFO(example.name);
    const LatticeLevel first = first_level(example, Collocation::cells);
    const double h = 0.02;
    const auto box = make_box_scheme(example.system, example.grid, first, h);
    const auto gauss = make_gauss_lattice(example.system, example.grid, 1, first, cells);
    const auto two = make_gauss_lattice(example.system, example.grid, 2, first, cells);
    const auto spectral = make_gauss_lattice(example.system, example.grid, 1, first);
    for (LatticeScheme* scheme : {box.get(), gauss.get(), two.get(), spectral.get()}) {
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
    }
    const double energy = box->discrete_energy();
    CHECK(std::abs(gauss->discrete_energy() - energy) < 1e-12 * std::max(1.0, std::abs(energy)));
    const auto expected = after(*box, h, 3);
    CHECK(largest_difference(after(*gauss, h, 3).all(), expected.all()) < 1e-11);
    // The twins: two stages are another map, by terms of order h³; so are other derivatives, by terms of order Δx².
    CHECK(largest_difference(after(*two, h, 3).all(), expected.all()) > 1e-9);
    CHECK(largest_difference(after(*spectral, h, 3).all(), expected.all()) > 1e-5);
  }
}

TEST_CASE("the stages of Gauss collocation on cells solve the equation at every point, and are what the energy sums") {
  // As for the spectral lattice; derivatives in cells enlarge what rounding leaves of sawtooths by 2/Δx ~ 6.
  for (const auto& [example, space_stages] : examples_and_stages()) {
    INFO(example.name << ", " << space_stages << " in space");
    const LatticeLevel first = first_level(example, Collocation::elements(space_stages));
    GaussStep slab(example.system, example.grid, 3, first, {.stages = space_stages});
    REQUIRE(slab.take(first, first, 0.05) == Status::success);
    CellSweep sweep(example.system, example.grid, Collocation::elements(space_stages));
    grids::FieldSet z = first.fields, rate = z, residual = z;
    double energy = 0.0;
    for (int i = 0; i < slab.count(); ++i) {
      slab.stage(i, z, rate);
      energy += slab.weight(i) * sweep(std::as_const(z).pointers(), first.slopes, std::as_const(rate).pointers(), 1.0,
                                       residual.pointers(), {})
                                     .energy;
      CHECK(grids::max_abs(std::as_const(residual).all()) < 1e-11);
      sweep(std::as_const(z).pointers(), first.slopes, std::as_const(rate).pointers(), 1.01, residual.pointers(), {});
      CHECK(grids::max_abs(std::as_const(residual).all()) > 1e-5);  // the twin: other rates
    }
    CHECK(slab.energy() == Approx(energy).epsilon(1e-12).margin(1e-12));
    slab.stage(0, z, rate);
    if (example.name == "sine-Gordon") {  // the twin: one stage alone
      CHECK(std::abs(sweep(std::as_const(z).pointers(), first.slopes, {}, 0.0, {}, {}).energy - energy) > 1e-10);
    }
  }
}

TEST_CASE("Gauss collocation on cells with m stages in time and r in space is of order 2m in h and 2r in the cells") {
  const auto system = sine_gordon();
  // At the nodes that the coarsest grid has, against the spectral lattice.
  const auto on = [&](std::size_t n, const std::string& scheme, int stages, double h, int space_stages = 1) {
    const grids::Grid grid({{"x", -8, 8, n}});
    LatticeIntegrator lattice(system, grid, smooth_hump(grid),
                              {.lagrangian = scheme,
                               .stages = stages,
                               .space_stages = space_stages,
                               .step = h,
                               .until = 1.6,
                               .levels = Levels::fixed});
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
    }
    std::vector<double> u;
    for (std::size_t i = 0; i < 45; ++i) {
      u.push_back(lattice.field(0)[i * (n / 45)]);
    }
    return u;
  };
  const auto slope = [](const std::vector<std::vector<double>>& u, const std::vector<double>& exact, std::size_t i) {
    return std::pair(largest_difference(u[i], exact), largest_difference(u[i + 1], exact));
  };
  const auto exact = on(135, "fourier", 6, 0.1);
  std::vector<std::vector<double>> in_space, in_time;
  for (const int space_stages : {1, 3}) {
    in_space.clear();
    for (const std::size_t n : {45u, 135u, 405u}) {
      in_space.push_back(on(n, "box", 6, 0.1, space_stages));
    }
    for (const std::size_t i : {0u, 1u}) {
      const auto [coarse, fine] = slope(in_space, exact, i);
      INFO(space_stages << ": " << coarse << " " << fine);
      CHECK(std::log(coarse / fine) / std::log(3.0) == Approx(2 * space_stages).margin(0.1 * space_stages));
    }
  }
  const auto same_cells = on(45, "box", 6, 0.1);
  for (const int stages : {2, 3}) {
    in_time.clear();
    for (const int steps : {4, 8, 16}) {
      in_time.push_back(on(45, "box", stages, 1.6 / steps));
    }
    for (const std::size_t i : {0u, 1u}) {
      const auto [coarse, fine] = slope(in_time, same_cells, i);
      INFO(stages << ": " << coarse << " " << fine);
      CHECK(std::log2(coarse / fine) == Approx(2 * stages).margin(0.1 * stages + 0.1));
    }
  }
}

TEST_CASE("levels of Gauss collocation on cells keep the discrete energy, with a step potential") {
  const grids::Grid grid({{"x", -8, 8, 45}});
  for (const auto& [stages, space_stages] : {std::pair(2, 1), {3, 1}, {1, 3}, {3, 3}}) {
    INFO(stages << " stages, " << space_stages << " in space");
    LatticeIntegrator lattice(sine_gordon(), grid, smooth_hump(grid),
                              {.lagrangian = "box",
                               .stages = stages,
                               .space_stages = space_stages,
                               .step = 0.25,
                               .until = 1000,  // a run worth a look-ahead
                               .potential = {.kind = StepPotentialChoice::Kind::automatic}});
    const auto [shortest, longest] = check_energy_is_kept(lattice, 20);
    // Levels that vary, else nothing is shown: from order 4 on they are nearly equal, and equal ones would leave E off
    // by p f' dh/h, 16e-4 · 1e-7 of it or more.
    CHECK(longest > (stages == 1 ? 1.001 : 1.0 + 1e-7) * shortest);
  }
}

TEST_CASE("local laws of Gauss collocation on cells: energy falls with the step, momentum with the cells") {
  // S is not quadratic. In a cell D(ab) = Da Āb + Āa Db holds, so that the law of energy has the error of the
  // quadrature in time, h^2m, alone, and that of momentum the error in space, Δx².
  const auto worst = [](std::size_t n, int stages, double h, int space_stages = 1) {
    const grids::Grid grid({{"x", -8, 8, n}});
    LatticeIntegrator lattice(sine_gordon(), grid, smooth_hump(grid),
                              {.lagrangian = "box",
                               .stages = stages,
                               .space_stages = space_stages,
                               .step = h,
                               .until = 1,
                               .levels = Levels::fixed});
    std::vector<double> cells_of_energy(n), cells_of_momentum(n);
    std::vector<double> largest(2, 0.0);
    double energy = lattice.totals()[0];
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
      double* const out[] = {cells_of_energy.data(), cells_of_momentum.data()};
      const auto sizes = lattice.residuals(out);
      largest = {std::max(largest[0], sizes[0].largest()), std::max(largest[1], sizes[1].largest())};
      // Fluxes cancel in the sum over all cells.
      const double after = lattice.totals()[0];
      const double sum = grids::sum(cells_of_energy) * grid.spacing(0) * h;
      CHECK(std::abs(sum - (after - energy)) < 1e-12);
      CHECK(std::abs(cells_of_energy[0] * grid.spacing(0) * h) + std::abs(after - energy) > 0.0);
      energy = after;
    }
    return largest;
  };
  for (const auto& [stages, space_stages] : {std::pair(2, 1), {3, 1}, {2, 3}, {3, 3}}) {
    const auto a = worst(45, stages, 0.15, space_stages), b = worst(45, stages, 0.1, space_stages),
               c = worst(45, stages, 0.2 / 3, space_stages);
    INFO(stages << " stages, " << space_stages << " in space, energy: " << a[0] << ", " << b[0] << ", " << c[0]);
    CHECK(std::log(a[0] / b[0]) / std::log(1.5) == Approx(2.0 * stages).margin(0.5));
    CHECK(std::log(b[0] / c[0]) / std::log(1.5) == Approx(2.0 * stages).margin(0.5));
  }
  for (const int space_stages : {1, 3}) {
    const auto a = worst(45, 6, 0.1, space_stages), b = worst(135, 6, 0.1, space_stages),
               c = worst(405, 6, 0.1, space_stages);
    INFO(space_stages << " in space, momentum: " << a[1] << ", " << b[1] << ", " << c[1]);
    CHECK(std::log(a[1] / b[1]) / std::log(3.0) == Approx(2.0 * space_stages).margin(0.2 * space_stages));
    CHECK(std::log(b[1] / c[1]) / std::log(3.0) == Approx(2.0 * space_stages).margin(0.2 * space_stages));
  }
}

TEST_CASE("collocation with three stages in space: derivatives and values by waves are those of the cells") {
  // Within an element of length l: z at the Gauss points is z_face + l Σ a_ij z'_j, and z at the next face z_face + l Σ
  // b_j z'_j; faces are every third node. Any node values will do.
  const grids::Grid grid({{"x", -8, 8, 45}});
  ElementOperators elements(grid, 3);
  const GaussTableau tableau(3);
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> amplitude(-1.0, 1.0);
  std::vector<double> nodes(45), values(45), derivative(45);
  for (double& node : nodes) {
    node = amplitude(random);
  }
  elements(nodes.data(), values.data(), derivative.data());
  const double length = 3 * grid.spacing(0);
  double worst = 0.0, twin = 0.0, sum = 0.0, size = 0.0;
  for (std::size_t e = 0; e < 45; e += 3) {
    double next = nodes[e];
    for (int i = 0; i < 3; ++i) {
      double value = nodes[e], other = nodes[e];
      for (int j = 0; j < 3; ++j) {
        value += length * tableau.a(i, j) * derivative[e + static_cast<std::size_t>(j)];
        other += length * tableau.a(j, i) * derivative[e + static_cast<std::size_t>(j)];
      }
      const auto at = e + static_cast<std::size_t>(i);
      worst = std::max(worst, std::abs(value - values[at]));
      twin = std::max(twin, std::abs(other - values[at]));
      next += length * tableau.b[i] * derivative[at];
      sum += tableau.b[i] * values[at] * derivative[at];
      size += tableau.b[i] * std::abs(values[at] * derivative[at]);
    }
    worst = std::max(worst, std::abs(next - nodes[(e + 3) % 45]));
  }
  // Derivatives of waves that alternate are some 45·8/l, and round accordingly.
  CHECK(worst < 1e-11);
  CHECK(twin > 1e-2);
  CHECK(std::abs(sum) < 1e-12 * size);  // ∂ is skew in the quadrature of the elements
}

TEST_CASE("energies on elements are their quadrature's") {
  const grids::Grid grid({{"x", -8, 8, 45}});
  const MultisymplecticSystem system = sine_gordon();
  const LatticeLevel level = initial_level(system, grid, smooth_hump(grid), Collocation::elements(3));
  ElementOperators elements(grid, 3);
  std::vector<std::vector<double>> z(3, std::vector<double>(45)), dz = z;
  for (std::size_t f = 0; f < 3; ++f) {
    elements(level.fields.field(static_cast<int>(f)).data(), z[f].data(), dz[f].data());
  }
  // K₊ has one of the entries (u, w) of K, so that the density is S + u_x w.
  const Eigen::MatrixXd& plus = system.structure().K_plus[0];
  const GaussTableau tableau(3);
  double energy = 0.0, twin = 0.0;
  for (std::size_t p = 0; p < 45; ++p) {
    double density = 0.5 * (z[1][p] * z[1][p] - z[2][p] * z[2][p]) + 1.0 - std::cos(z[0][p]);
    density += plus(0, 2) * dz[0][p] * z[2][p] + plus(2, 0) * dz[2][p] * z[0][p];
    energy += 3 * grid.spacing(0) * tableau.b[static_cast<Eigen::Index>(p % 3)] * density;
    twin += grid.spacing(0) * density;
  }
  CellSweep sweep(system, grid, Collocation::elements(3));
  const double swept = sweep(level.fields.pointers(), level.slopes, {}, 0.0, {}, {}).energy;
  CHECK(swept == Approx(energy).epsilon(1e-13));
  CHECK(std::abs(swept - twin) > 1e-8);
  const auto method = make_lattice_method({.name = "box", .stages = 2, .space_stages = 3});
  CHECK(make_local_laws(*method, system, grid).totals(level)[0] == Approx(energy).epsilon(1e-13));
}

TEST_CASE("Gauss collocation on cells conserves the form of two tangent solutions in every cell") {
  // Random tangents of size 10 after some steps: 1e2 ε/Δx, and sawtooths enlarged 45 times.
  for (const auto& [example, space_stages] : examples_and_stages()) {
    for (const int stages : {1, 2, 3}) {
      const auto method = make_lattice_method({.name = "box", .stages = stages, .space_stages = space_stages});
      if (stages == 1 && space_stages == 1) {
        continue;
      }
      INFO(example.name << ", " << stages << " stages, " << space_stages << " in space");
      const LatticeLevel first = first_level(example, Collocation::elements(space_stages));
      const double h = 0.02;
      const auto scheme = method->scheme(example.system, example.grid, first, h);
      LocalLaws laws = make_local_laws(*method, example.system, example.grid);
      TangentPair pair(laws, method->tangents(example.system, example.grid), example.system, example.grid, 1);
      double worst = 0.0;
      for (int k = 0; k < 5; ++k) {
        const LatticeLevel before = scheme->level();
        REQUIRE(scheme->advance(h, 0.0) == Status::success);
        scheme->accept();
        REQUIRE(pair.take(before, scheme->level(), h) == Status::success);
        worst = std::max(worst, pair.residual()->largest());
      }
      CHECK(worst < 1e-10);
    }
  }
}

TEST_CASE("tangent solutions of Gauss collocation are derivatives of its map") {
  for (const int space_stages : {1, 3}) {
    const Example example = examples(true)[1];
    const auto method = make_lattice_method({.name = "box", .stages = 2, .space_stages = space_stages});
    const LatticeLevel first = first_level(example, Collocation::elements(space_stages));
    const grids::FieldSet u = random_tangent(example.system, example.grid, 3),
                          v = random_tangent(example.system, example.grid, 4);
    const double h = 0.02, epsilon = 1e-4;
    const auto moved = [&](double by) {
      LatticeLevel level = first;
      for (std::size_t i = 0; i < level.fields.all().size(); ++i) {
        level.fields.all()[i] += by * u.all()[i];
      }
      const auto scheme = method->scheme(example.system, example.grid, level, h);
      return after(*scheme, h, 1);
    };
    const auto forward = moved(epsilon), back = moved(-epsilon);
    std::vector<double> difference;
    for (std::size_t i = 0; i < u.all().size(); ++i) {
      difference.push_back((std::as_const(forward).all()[i] - std::as_const(back).all()[i]) / (2 * epsilon));
    }
    const auto step = method->tangents(example.system, example.grid);
    grids::FieldSet next = u, other = v;
    REQUIRE(step->operator()(first, first, h, u, next) == Status::success);
    const std::vector<grids::FieldSet> of_u(step->stages().begin(), step->stages().end());
    REQUIRE(step->operator()(first, first, h, v, other) == Status::success);
    const std::vector<grids::FieldSet> of_v(step->stages().begin(), step->stages().end());
    CHECK(largest_difference(std::as_const(next).all(), difference) < 1e-5);  // ε² and 1e-13/ε
    CHECK(largest_difference(std::as_const(next).all(), u.all()) > 1e-2);
    // The law with what are not their stages, and without.
    LocalLaws laws = make_local_laws(*method, example.system, example.grid);
    CHECK(laws.multisymplectic_residual({u, next, nullptr, of_u}, {v, other, nullptr, of_v}, h).largest() < 1e-10);
    const std::vector<grids::FieldSet> turned(of_v.rbegin(), of_v.rend());
    CHECK(laws.multisymplectic_residual({u, next, nullptr, of_u}, {v, other, nullptr, turned}, h).largest() > 1e-6);
    CHECK_THROWS_WITH(laws.multisymplectic_residual({u, next}, {v, other}, h), Catch::Matchers::Contains("stages"));
  }
}

TEST_CASE("first levels fulfil their constraints at the points of elements") {
  // nᵀ(K D z - ∇S(A z)) of terms up to 2/Δx ~ 6 times the values; sawtooths, enlarged 15 times, are solved for.
  for (const auto& [example, space_stages] : examples_and_stages()) {
    const Eigen::MatrixXd& constraints = example.system.structure().level_constraints;
    if (space_stages == 1 || constraints.cols() == 0) {
      continue;
    }
    INFO(example.name);
    CellSweep sweep(example.system, example.grid, Collocation::elements(3));
    const auto left = [&](const LatticeLevel& level) {
      grids::FieldSet residual(example.system.field_count(), example.grid.size());
      sweep(level.fields.pointers(), level.slopes, {}, 0.0, residual.pointers(), {});
      double worst = 0.0;
      for (Eigen::Index c = 0; c < constraints.cols(); ++c) {
        for (std::size_t p = 0; p < example.grid.size(); ++p) {
          double sum = 0.0;
          for (int row = 0; row < example.system.field_count(); ++row) {
            sum += constraints(row, c) * std::as_const(residual).field(row)[p];
          }
          worst = std::max(worst, std::abs(sum));
        }
      }
      return worst;
    };
    CHECK(left(first_level(example, Collocation::elements(3))) < 1e-12);
    CHECK(left(first_level(example, Collocation::cells)) > 1e-4);  // the twin: constraints of the box
  }
}

TEST_CASE("collocation on cells refuses even numbers of them") {
  CHECK_THROWS_WITH(SpaceCollocation(grids::Grid({{"x", -8, 8, 44}}), cells),
                    Catch::Matchers::Contains("44 cells") && Catch::Matchers::Contains("sawtooth"));
  CHECK_NOTHROW(SpaceCollocation(grids::Grid({{"x", -8, 8, 44}}), SpaceRule{}));
}
