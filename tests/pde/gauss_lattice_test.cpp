// Gauss collocation in time on spectral lattices: against the midpoint scheme, by slopes, and by its own laws.

#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/pde/potential_rest.hpp>
#include <rubato/pde/stage_loops.hpp>
#include <rubato/pde/step_equation.hpp>

#include "humps.hpp"
#include "kept_energy.hpp"

using namespace rubato;
using namespace rubato::tests;

TEST_CASE("one Gauss stage on a spectral lattice is the midpoint scheme") {
  // Its equation is taken by the sweep over the nodes, which shares no line with the solution on waves: terms are of
  // order 10, and a rate rounds at ε|z|/h with h = 0.02, 1e-14 times a few.
  for (const Example& example : examples()) {
    INFO(example.name);
    const LatticeLevel first = first_level(example);
    const double h = 0.02;
    const auto equation = make_midpoint_equation(example.system, example.grid, Collocation::nodes, first, h);
    const auto measured = [&](int stages) {
      const auto scheme = make_gauss_lattice(example.system, example.grid, stages, first);
      static_cast<void>(after(*scheme, h, 3));
      const LatticeLevel before = scheme->level();
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      const double energy = scheme->discrete_energy();
      scheme->accept();
      const StepLaw law = equation->measure(before, scheme->level(), h);
      return std::pair(law.residual.largest(), std::abs(law.energy - energy) / std::max(1.0, std::abs(energy)));
    };
    const auto [residual, miss] = measured(1);
    CHECK(residual < 1e-11);
    CHECK(miss < 1e-12);
    // The twin: two stages are another map, by terms of order h³.
    CHECK(measured(2).first > 1e-8);
  }
}

TEST_CASE("Gauss collocation on lattices has order 2m") {
  // Differences from four stages at the finest step, whose error is smaller by h² than those of three.
  for (const Example& example : {examples()[0], examples()[3], examples()[4]}) {
    const LatticeLevel first = first_level(example);
    const double until = example.name == "KdV, even" ? 0.1 : 1.6;
    const auto reference = after(*make_gauss_lattice(example.system, example.grid, 5, first), until / 32, 32);
    for (const int stages : {2, 3}) {
      INFO(example.name << ", " << stages << " stages");
      std::vector<double> errors;
      for (const int steps : {4, 8, 16}) {
        const auto scheme = make_gauss_lattice(example.system, example.grid, stages, first);
        errors.push_back(largest_difference(after(*scheme, until / steps, steps).all(), reference.all()));
      }
      REQUIRE(errors.back() > 1e-13);
      const double slope = std::log2(errors[1] / errors[2]);
      // The next term is smaller by (ωh)² < 0.3 at the middle step, which moves the slope by less than log2(1.3).
      CHECK(slope == Approx(2.0 * stages).margin(0.4));
      CHECK(std::log2(errors[0] / errors[2]) / 2.0 == Approx(2.0 * stages).margin(0.8));
    }
  }
}

TEST_CASE("the discrete energy of Gauss collocation is the mean of S over the stages, by another evaluation") {
  for (const Example& example : examples()) {
    INFO(example.name);
    const LatticeLevel first = first_level(example);
    const auto scheme = make_gauss_lattice(example.system, example.grid, 3, first);
    REQUIRE(scheme->advance(0.05, 0.0) == Status::success);
    const auto stages = scheme->stages();
    CellSweep sweep(example.system, example.grid, Collocation::nodes);
    grids::FieldSet z = first.fields, rate = z;
    double energy = 0.0, at_first = 0.0;
    for (int i = 0; i < stages->count(); ++i) {
      stages->stage(i, z, rate);
      const double value = sweep(std::as_const(z).pointers(), first.slopes, {}, 0.0, {}, {}).energy;
      energy += stages->weight(i) * value;
      at_first = i == 0 ? value : at_first;
    }
    // Sums over 200 cells of terms of order 1, in real space and on waves.
    CHECK(scheme->discrete_energy() == Approx(energy).epsilon(1e-12).margin(1e-12));
    if (example.name == "sine-Gordon") {
      CHECK(std::abs(scheme->discrete_energy() - at_first) > 1e-10);  // the twin: one stage alone
    }
  }
}

TEST_CASE("the stages of Gauss collocation solve the equation at every node") {
  // R = M Ż + Σ K ∂Z - ∇S(Z), taken by the sweep of the midpoint scheme; its terms are of order 10, and what a rate
  // rounds to is ε|z|/h with h = 0.05: 1e-13 leaves a margin of ten.
  for (const Example& example : examples()) {
    INFO(example.name);
    const LatticeLevel first = first_level(example);
    GaussStep slab(example.system, example.grid, 3, first);
    REQUIRE(slab.take(first, first, 0.05) == Status::success);
    CellSweep sweep(example.system, example.grid, Collocation::nodes);
    grids::FieldSet z = first.fields, rate = z, residual = z;
    for (int i = 0; i < slab.count(); ++i) {
      slab.stage(i, z, rate);
      sweep(std::as_const(z).pointers(), first.slopes, std::as_const(rate).pointers(), 1.0, residual.pointers(), {});
      CHECK(grids::max_abs(std::as_const(residual).all()) < 1e-11);
      sweep(std::as_const(z).pointers(), first.slopes, std::as_const(rate).pointers(), 1.01, residual.pointers(), {});
      CHECK(grids::max_abs(std::as_const(residual).all()) > 1e-5);  // the twin: other rates
    }
  }
}

TEST_CASE("a lattice with Gauss collocation continues bit by bit from its saved state") {
  const Example example = examples()[3];
  const LatticeLevel first = first_level(example);
  const auto straight = make_gauss_lattice(example.system, example.grid, 3, first);
  static_cast<void>(after(*straight, 0.02, 3));
  StateWriter saved;
  straight->save(saved);
  const auto resumed = make_gauss_lattice(example.system, example.grid, 3, first);
  StateReader reader(saved.values());
  resumed->restore(reader);
  CHECK(reader.done());
  // A trial that is not accepted leaves no trace.
  REQUIRE(resumed->advance(0.03, 0.0) == Status::success);
  StateReader again(saved.values());
  resumed->restore(again);
  const auto a = after(*straight, 0.025, 2), b = after(*resumed, 0.025, 2);
  CHECK(std::ranges::equal(a.all(), b.all()));
}

TEST_CASE("the squares of the Korteweg-de Vries equation stay what they are, however many stages") {
  // Σ u² is quadratic and its flow is kept, so that a symplectic scheme keeps it at any step. A tableau that is off by
  // d moves it by about d in every step: with eight stages VΛV⁻¹ is off by 1e-12 of A⁻¹, and 200 steps by 3e-12. What
  // rounding makes of a level is ε of it at random: √200 ε, and a few times that beside what is sampled.
  const grids::Grid grid({{"x", -10, 10, 101}});
  const auto system = korteweg_de_vries(6, 1);
  InitialFields initial(system.fields().size());
  const auto u = static_cast<std::size_t>(std::ranges::find(system.fields(), "u") - system.fields().begin());
  initial[u] = sampled(grid, [](double x) { return 2.0 / std::pow(std::cosh(x), 2); });
  const LatticeLevel first = initial_level(system, grid, initial, Collocation::nodes);
  const auto squares = [&](const grids::FieldSet& z) {
    return grids::dot(z.field(static_cast<int>(u)), z.field(static_cast<int>(u)));
  };
  const double before = squares(first.fields), bound = 8.0 * std::sqrt(200.0) * 2.2e-16;
  for (const int stages : {2, 5, 8}) {
    INFO(stages << " stages");
    const auto scheme = make_gauss_lattice(system, grid, stages, first);
    CHECK(std::abs(squares(after(*scheme, 0.01, 200)) - before) <= bound * before);
  }
  // The twin: Σ u³, which no scheme keeps, shows that the steps are far from exact.
  const auto cubes = [&](const grids::FieldSet& z) {
    double sum = 0.0;
    for (const double value : z.field(static_cast<int>(u))) {
      sum += value * value * value;
    }
    return sum;
  };
  const auto scheme = make_gauss_lattice(system, grid, 2, first);
  const double start = cubes(first.fields);
  CHECK(std::abs(cubes(after(*scheme, 0.01, 200)) - start) > 100.0 * bound * std::abs(start));
}

TEST_CASE("levels of Gauss collocation on lattices keep the discrete energy, with a step potential") {
  const Example example = examples()[0];
  InitialFields initial(3);
  initial[0] = sampled(example.grid, [](double x) { return 1.5 * std::exp(-x * x); });
  initial[1] = sampled(example.grid, [](double) { return 0.0; });
  for (const int stages : {2, 3}) {
    LatticeIntegrator lattice(example.system, example.grid, initial,
                              {.lagrangian = "fourier",
                               .stages = stages,
                               .step = 0.25,
                               .until = 1000,  // a run worth a look-ahead
                               .potential = {.kind = StepPotentialChoice::Kind::automatic}});
    const auto [shortest, longest] = check_energy_is_kept(lattice, 20);
    // Levels that vary, else nothing is shown: equal ones would leave E off by p f' dh/h, 16e-4 · 1e-7 of it or more.
    CHECK(longest > (1.0 + 1e-7) * shortest);
  }
}

TEST_CASE("local laws of Gauss collocation fall as the order of the scheme says") {
  // Energy: S is not quadratic, and the law of the stages' fluxes is O(h^2m). The grid resolves products of all waves,
  // too: 96 cells leave 6e-7 of aliasing, 128 cells 2e-10.
  const grids::Grid grid({{"x", -10, 10, 192}});
  const auto system = sine_gordon();
  InitialFields initial(3);
  initial[0] = sampled(grid, [](double x) { return std::exp(-x * x); });
  initial[1] = sampled(grid, [](double) { return 0.0; });
  for (const int stages : {2, 3}) {
    std::vector<double> worst;
    for (const double h : {0.2, 0.1, 0.05}) {
      LatticeIntegrator lattice(
          system, grid, initial,
          {.lagrangian = "fourier", .stages = stages, .step = h, .until = 1, .levels = Levels::fixed});
      double largest = 0.0;
      while (!lattice.finished()) {
        REQUIRE(lattice.step().status == Status::success);
        largest = std::max(largest, lattice.residuals()[0].largest());
      }
      worst.push_back(largest);
    }
    INFO(stages << " stages: " << worst[0] << ", " << worst[1] << ", " << worst[2]);
    CHECK(std::log2(worst[1] / worst[2]) == Approx(2.0 * stages).margin(0.5));
  }
}

TEST_CASE("the middle of S'' leaves the least sum of fourth powers") {
  // Σ (v - c)³ = 0 there, of numbers of both signs up to 24: rounding of each is some ε of the largest cube.
  for (const std::string& V : {std::string("u^4/4"), std::string("-u^4/4"), std::string("u^2/2")}) {
    INFO(V);
    const MultisymplecticSystem system = wave_equation(V);
    const grids::Grid grid({{"x", -8.0, 8.0, 57}});
    grids::FieldSet z(3, grid.size());
    const auto u = sampled(grid, [](double x) { return 2.0 * sech(x); });
    std::copy(u.begin(), u.end(), z.field(0).begin());
    std::vector<double> curvatures;
    for (const double value : u) {
      curvatures.push_back(V == "u^2/2" ? 1.0 : (V[0] == '-' ? -3.0 : 3.0) * value * value);
    }
    const auto cubes = [&](double c) {
      double sum = 0.0, sizes = 0.0;
      for (const double v : curvatures) {
        sum += std::pow(v - c, 3);
        sizes += std::pow(std::abs(v - c), 3);
      }
      return sizes == 0.0 ? 0.0 : sum / sizes;
    };
    CHECK(std::abs(cubes(middle_hessian(system, grid, z)(0, 0))) < 1e-13);
    if (V != "u^2/2") {  // the twin: the mean does not
      CHECK(std::abs(cubes(std::accumulate(curvatures.begin(), curvatures.end(), 0.0) / 57.0)) > 0.1);
    }
  }
}

TEST_CASE("loops over stages do what their sums say, however many waves are left over") {
  // The same products and sums in the same order: bit by bit.
  constexpr std::size_t waves = 29;
  constexpr int rows = 6, columns = 5;
  WaveRows x(columns, waves), y(rows, waves), base(rows, waves);
  std::vector<std::complex<double>> weights;
  PackedMatrices matrices(rows, columns, waves);
  const auto number = [](int i, std::size_t w) { return std::sin(1.7 * i + 0.3 * static_cast<double>(w)); };
  for (int c = 0; c < columns; ++c) {
    for (std::size_t w = 0; w < waves; ++w) {
      x.re.field(c)[w] = number(c, w);
      x.im.field(c)[w] = number(c + 20, w);
    }
  }
  std::vector<double> one(waves, 1.0), none(waves, 0.0);
  for (int r = 0; r < rows; ++r) {
    for (std::size_t w = 0; w < waves; ++w) {
      base.re.field(r)[w] = number(r + 40, w);
      base.im.field(r)[w] = number(r + 60, w);
    }
    for (int c = 0; c < columns; ++c) {
      weights.emplace_back(number(r, 3 * c), number(c, 7 * r));
      matrices.add(r, c, weights.back(), one.data(), none.data(), 0, waves);
    }
  }
  const auto expected = [&](int r, std::size_t w, bool conjugate) {
    std::complex<double> sum(base.re.field(r)[w], base.im.field(r)[w]);
    for (int c = 0; c < columns; ++c) {
      const double a = weights[r * columns + c].real(), b = (conjugate ? -1.0 : 1.0) * weights[r * columns + c].imag();
      const double p = x.re.field(c)[w], q = x.im.field(c)[w];
      sum = {sum.real() + (a * p - b * q), sum.imag() + (a * q + b * p)};
    }
    return sum;
  };
  for (const std::size_t count : {1, 7, 8, 9, 16, 21, 29}) {
    for (const bool packed : {false, true}) {
      INFO(count << (packed ? " waves, matrices" : " waves, weights"));
      y.re.copy_from(base.re);
      y.im.copy_from(base.im);
      if (packed) {
        matrices.apply(x, &base, 0, count, y);
      } else {
        add_mixed(rows, columns, weights.data(), {x.re.all().data(), x.im.all().data(), waves}, count,
                  {y.re.all().data(), y.im.all().data(), waves});
      }
      int off = 0, off_of_twin = 0;
      for (int r = 0; r < rows; ++r) {
        for (std::size_t w = 0; w < waves; ++w) {
          const std::complex<double> found(y.re.field(r)[w], y.im.field(r)[w]);
          const std::complex<double> before(base.re.field(r)[w], base.im.field(r)[w]);
          off += found != (w < count ? expected(r, w, false) : before);
          off_of_twin += found != (w < count ? expected(r, w, true) : before);
        }
      }
      CHECK(off == 0);
      CHECK(off_of_twin > 0);
    }
  }
}

TEST_CASE("rates of stages that are asked for are the same as among those of all fields") {
  // Bit by bit; the twin: what is not asked for is not reported.
  for (const Example& example : examples()) {
    INFO(example.name);
    const LatticeLevel first = first_level(example);
    const int d = example.system.field_count();
    const auto stages = make_gauss_stages(example.system, example.grid, 3);
    grids::FieldSet z(d, example.grid.size()), all = z, some = z;
    REQUIRE(stages->take(first, first, 0.02) == Status::success);
    stages->stage(1, z, all);
    for (int f = 0; f < d; ++f) {
      std::vector<bool> asked(static_cast<std::size_t>(d), false);
      asked[static_cast<std::size_t>(f)] = true;
      stages->ask_rates_of(asked);
      stages->stage(1, z, some);
      CHECK(std::ranges::equal(std::as_const(some).field(f), std::as_const(all).field(f)));
      for (int other = 0; other < d; ++other) {
        CHECK((other == f || grids::max_abs(std::as_const(some).field(other)) == 0.0));
      }
    }
    CHECK(grids::max_abs(std::as_const(all).all()) > 0.0);
  }
}
