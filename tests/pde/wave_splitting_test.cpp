// Splittings on lattices: waves exactly, the rest node by node, composed; with their generating Hamiltonian.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/potential_rest.hpp>
#include <rubato/pde/wave_loops.hpp>
#include <rubato/pde/wave_splitting.hpp>

#include "equations.hpp"
#include "kept_energy.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

double hump(double x, double scale) {
  return scale * std::exp(std::cos(2 * std::numbers::pi * x / 16) * 3 - 3);  // period 16
}

LatticeLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                         const std::vector<std::string>& given) {
  InitialFields initial(system.fields().size());
  double scale = 1.0;
  for (const std::string& name : given) {
    initial[static_cast<std::size_t>(system.field(name))] =
        sampled(grid, [scale](double x) { return hump(x - scale, scale); });
    scale *= 0.6;
  }
  return initial_level(system, grid, initial, Collocation::nodes);
}

struct Example {
  std::string name;
  MultisymplecticSystem system;
  std::vector<std::string> given;
  double until;
};

std::vector<Example> examples() {
  return {{"sine-Gordon, a kick", sine_gordon(), {"u", "v"}, 2.0},
          {"Schroedinger, a turn", schroedinger(2), {"p", "q"}, 0.4},
          {"Dirac, turns of two pairs", dirac(1, 0.5), {"p1", "q1", "p2", "q2"}, 1.0}};
}

const grids::Grid line({{"x", -8, 8, 48}});

/// z after `steps` equal steps; E_k of the last into `energy`.
grids::FieldSet after(const Example& example, const std::string& name, int steps, double* energy = nullptr) {
  const auto method = make_lattice_method({.name = "splitting", .composition = name});
  const double h = example.until / steps;
  const auto scheme = method->scheme(example.system, line, first_level(example.system, line, example.given), h);
  for (int k = 0; k < steps; ++k) {
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    if (energy != nullptr) {
      *energy = scheme->discrete_energy();
    }
    scheme->accept();
  }
  return scheme->level().fields;
}

}  // namespace

TEST_CASE("splittings on lattices lead where Gauss collocation leads, with the order of their composition") {
  // Six Gauss stages solve the same equation by another program; their error is far below those compared.
  for (const Example& example : examples()) {
    std::vector<std::pair<std::string, int>> all = {
        {"verlet", 2}, {"golden", 2}, {"blanes-moan-4", 4}, {"kahan-li-6", 6}};
    if (example.name.find("kick") != std::string::npos) {
      all.emplace_back("blanes-moan-rkn-6", 6);
    }
    const auto gauss = make_gauss_lattice(example.system, line, 6, first_level(example.system, line, example.given));
    for (int k = 0; k < 40; ++k) {
      REQUIRE(gauss->advance(example.until / 40, 0.0) == Status::success);
      gauss->accept();
    }
    for (const auto& [name, order] : all) {
      INFO(example.name << ", " << name);
      std::vector<double> errors;
      const int first = name == "blanes-moan-rkn-6" ? 4 : 10;  // it errs too little in ten
      for (const int steps : {first, 2 * first, 4 * first}) {
        errors.push_back(largest_difference(after(example, name, steps).all(), gauss->level().fields.all()));
      }
      REQUIRE(errors.back() > 1e-13);
      CHECK(std::log2(errors[1] / errors[2]) == Approx(order).margin(0.35));
    }
  }
}

TEST_CASE("the generating Hamiltonian of a splitting on a lattice is the energy to its order") {
  // K_h = H + O(h^s) at the level that the step leads to.
  const Example example = examples()[0];
  const auto level = first_level(example.system, line, example.given);
  WaveSplitting splitting(example.system, line);
  std::vector<double> misses;
  for (const double h : {0.05, 0.025, 0.0125}) {
    splitting.stand(level);
    REQUIRE(splitting.step(composition("golden"), h));
    const double K = splitting.generator();
    misses.push_back(std::abs(K - splitting.energy()));
  }
  CHECK(std::log2(misses[1] / misses[2]) == Approx(2.0).margin(0.3));
}

TEST_CASE("a splitting's K generates it in h") {
  // ∂_hψ_h = J∇K_h∘ψ_h, so that K_h∘ψ_h changes along h by ∂_hK alone: for the flow of a linear system K is its energy,
  // constant to rounding; a wrong weight of one part is seen.
  const auto system = wave_equation("u^2/2");
  const auto level = first_level(system, line, {"u", "v"});
  WaveSplitting splitting(system, line);
  splitting.stand(level);
  REQUIRE(splitting.step(composition("golden"), 0.0));
  const double energy = splitting.generator();
  for (const double h : {0.1, 1.0, 7.0}) {
    REQUIRE(splitting.step(composition("golden"), h));
    CHECK(splitting.generator() == Approx(energy).epsilon(1e-13));
    CHECK(splitting.energy() == Approx(energy).epsilon(1e-13));
  }
}

TEST_CASE("a step of a splitting is taken back by the step of opposite length") {
  // Symmetric compositions of exact flows: ψ_{-h}∘ψ_h = id, to rounding of some twenty transforms.
  for (const Example& example : examples()) {
    INFO(example.name);
    const auto level = first_level(example.system, line, example.given);
    WaveSplitting splitting(example.system, line);
    LatticeLevel there = level;
    splitting.stand(level);
    REQUIRE(splitting.step(composition("kahan-li-6"), 0.1));
    splitting.fields(there.fields);
    CHECK(largest_difference(there.fields.all(), level.fields.all()) > 1e-3);
    splitting.stand(there);
    REQUIRE(splitting.step(composition("kahan-li-6"), -0.1));
    splitting.fields(there.fields);
    CHECK(largest_difference(there.fields.all(), level.fields.all()) < 1e-13);
  }
}

TEST_CASE("levels of splittings on lattices keep the discrete energy, and their laws fall as the order says") {
  const auto system = sine_gordon();
  const grids::Grid fine({{"x", -10, 10, 192}});
  InitialFields initial(3);
  initial[0] = sampled(fine, [](double x) { return std::exp(-x * x); });
  initial[1] = sampled(fine, [](double) { return 0.0; });
  const LatticeOptions options = {.lagrangian = "splitting", .composition = "blanes-moan-4", .step = 0.2, .until = 2};
  LatticeOptions variable = options;
  variable.potential.kind = StepPotentialChoice::Kind::automatic;
  variable.until = 400;  // a run worth a look-ahead
  LatticeIntegrator run(system, fine, initial, variable);
  CHECK(check_energy_is_kept(run, 2).longest > 0.2 * (1.0 + 1e-5));  // with f' ten times what the energy is off by
  std::vector<double> worst;
  for (const double h : {0.2, 0.1, 0.05}) {
    LatticeOptions fixed = options;
    fixed.step = h, fixed.levels = Levels::fixed;
    LatticeIntegrator lattice(system, fine, initial, fixed);
    double largest = 0.0;
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
      largest = std::max(largest, lattice.residuals()[0].largest());
    }
    worst.push_back(largest);
  }
  INFO(worst[0] << ", " << worst[1] << ", " << worst[2]);
  CHECK(std::log2(worst[1] / worst[2]) == Approx(4.0).margin(0.2));
}

TEST_CASE(
    "a short run with variable levels takes equal steps but for some thousandths, and hardly two trials for each") {
  const auto system = wave_equation("u^2/2 + u^4/4");
  const grids::Grid grid({{"x", -20, 20, 128}});
  InitialFields initial(3);
  initial[0] = sampled(grid, [](double x) { return 2.0 / std::cosh(x); });
  initial[1] = sampled(grid, [](double) { return 0.0; });
  const LatticeOptions short_run = {
      .lagrangian = "splitting", .composition = "blanes-moan-4", .step = 12.0 / 74.0, .until = 12};
  struct Seen {
    int steps = 0, trials = 0;
    double shortest = 1e300, longest = 0.0;
  };
  const auto run = [&](const LatticeOptions& options) {
    LatticeIntegrator lattice(system, grid, initial, options);
    Seen seen;
    double energy = 0.0;
    while (lattice.t() < 12.0 - 1e-6) {
      const StepReport report = lattice.step();
      REQUIRE(report.status == Status::success);
      REQUIRE_FALSE(report.off_law);
      energy = seen.steps == 0 ? report.energy : energy;
      // The tolerance, 1e-13 of the terms of E_k.
      REQUIRE(std::abs(report.energy - energy) <= 1e-13 * lattice.levels().energy_scale());
      ++seen.steps;
      seen.trials += report.iterations;
      seen.shortest = std::min(seen.shortest, report.h);
      seen.longest = std::max(seen.longest, report.h);
    }
    return seen;
  };
  const Seen seen = run(short_run);
  CHECK(std::abs(seen.steps - 74) <= 1);
  CHECK(seen.trials <= 2.6 * seen.steps);
  CHECK(seen.longest < 1.005 * seen.shortest);
  // The twin: a run worth a look-ahead, as far as the same time, whose potential is as weak as what was seen allows.
  LatticeOptions long_run = short_run;
  long_run.until = 1000;
  const Seen looked = run(long_run);
  CHECK(looked.longest - looked.shortest > 2.0 * (seen.longest - seen.shortest));
}

TEST_CASE("what a splitting on a lattice cannot split is refused with the reason") {
  using Catch::Matchers::Contains;
  CHECK_THROWS_WITH(WaveSplitting(korteweg_de_vries(6, 1), line), Contains("w has none") && Contains("stages"));
  CHECK_THROWS_WITH(
      WaveSplitting(wave_equation_2d("1 - cos(u) + a/10"), grids::Grid({{"x", -1, 1, 8}, {"y", -1, 1, 8}})),
      Contains("beyond its quadratic terms with constant coefficients S depends on a"));
  const auto neither = make_system({"p", "q", "v", "w"}, {{"p", "q", 1}}, {{{"p", "v", 1}, {"q", "w", 1}}},
                                   "(v^2 + w^2)/2 + p^4 + q^2*p^2/3");
  CHECK_THROWS_WITH(WaveSplitting(neither, line), Contains("neither"));
  // [N, [N, [N, L]]] is 0 for kicks, not for turns.
  const Composition& nystrom = composition("blanes-moan-rkn-6");
  CHECK_NOTHROW(WaveSplitting(sine_gordon(), line).check(nystrom));
  CHECK_THROWS_WITH(WaveSplitting(schroedinger(2), line).check(nystrom), Contains("turns") && Contains("kahan-li-6"));
  CHECK_NOTHROW(WaveSplitting(schroedinger(2), line).check(composition("kahan-li-6")));
  CHECK_THROWS_AS(after(examples()[1], "blanes-moan-rkn-6", 1), SchemeRefusal);
}

TEST_CASE("a splitting goes on in waves, the same whether its levels are looked at or not, and from a saved state") {
  for (const Example& example : examples()) {
    for (const char* name : {"verlet", "golden", "kahan-li-8"}) {
      INFO(example.name << ", " << name);
      const double h = example.until / 20;
      const auto method = make_lattice_method({.name = "splitting", .composition = name});
      const auto make = [&] {
        return method->scheme(example.system, line, first_level(example.system, line, example.given), h);
      };
      const auto go = [&](LatticeScheme& scheme, int steps, bool look) {
        std::vector<double> reported;
        for (int k = 0; k < steps; ++k) {
          REQUIRE(scheme.advance(h, 0.0) == Status::success);
          reported.push_back(scheme.discrete_energy());
          if (look) {
            static_cast<void>(scheme.node());
          }
          scheme.accept();
          CHECK_FALSE(scheme.level_is_current());
          if (look) {
            static_cast<void>(scheme.level());
            static_cast<void>(scheme.node());
            CHECK(scheme.level_is_current());
          }
        }
        const auto fields = scheme.level().fields.all();
        reported.insert(reported.end(), fields.begin(), fields.end());
        reported.push_back(scheme.node().energy);
        return reported;
      };
      const auto unseen = make(), seen = make();
      CHECK(go(*unseen, 4, false) == go(*seen, 4, true));
      StateWriter saved;
      seen->save(saved);
      const auto expected = go(*seen, 3, true);
      const auto resumed = make();
      StateReader reader(saved.values());
      resumed->restore(reader);
      REQUIRE(reader.done());
      CHECK(go(*resumed, 3, false) == expected);
    }
  }
}

TEST_CASE("an integrator has the level before, whether it was looked at or not") {
  const Example example = examples()[0];
  LatticeOptions options;
  options.lagrangian = "splitting";
  options.composition = "kahan-li-6";
  options.levels = Levels::fixed;
  options.step = 0.1;
  options.until = 1.0;
  const auto make = [&] {
    InitialFields initial(3);
    const auto first = first_level(example.system, line, example.given);
    for (int f = 0; f < 2; ++f) {
      const auto values = first.fields.field(f);
      initial[static_cast<std::size_t>(f)] = std::vector<double>(values.begin(), values.end());
    }
    return LatticeIntegrator(example.system, line, initial, options);
  };
  LatticeIntegrator asked = make(), silent = make();
  for (int k = 0; k < 5; ++k) {
    const grids::FieldSet before = asked.level().fields;
    REQUIRE(asked.step().status == Status::success);
    REQUIRE(silent.step().status == Status::success);
    CHECK(std::ranges::equal(asked.previous().fields.all(), before.all()));
    if (k % 2 == 1) {
      CHECK(std::ranges::equal(silent.previous().fields.all(), before.all()));
      CHECK_FALSE(std::ranges::equal(silent.previous().fields.all(), silent.level().fields.all()));
    }
  }
}

TEST_CASE("matrices that turn waves have determinant 1 beyond double precision") {
  // What mends a matrix makes up for what is missing to second order in ε: left are the roundings of the numbers here,
  // 2^-64 in each of four products, with some room for the sums.
  using Real = long double;
  const Real bound = 32.0L * std::ldexp(1.0L, -64);
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> angle(-10.0, 10.0), frequency(0.01, 100.0);
  constexpr std::size_t count = 1000;
  std::vector<double> a(count), b(count), c(count), mend(count);
  for (std::size_t w = 0; w < count; ++w) {
    const double theta = w == 0 ? 0.0 : angle(random), omega = frequency(random);
    a[w] = std::cos(theta);
    b[w] = std::sin(theta) / omega;
    c[w] = -std::sin(theta) * omega;
  }
  std::vector<double> d = a;
  const auto determinant = [&] {
    std::vector<Real> result;
    for (std::size_t w = 0; w < count; ++w) {
      const Real factor = 1.0L + static_cast<Real>(mend[w]);
      result.push_back(
          factor * factor *
          (static_cast<Real>(a[w]) * static_cast<Real>(d[w]) - static_cast<Real>(b[w]) * static_cast<Real>(c[w])));
    }
    return result;
  };
  int off = 0;
  for (const Real value : determinant()) {
    off += std::abs(value - 1.0L) > bound ? 1 : 0;
  }
  CHECK(off > 500);  // the twin: as rounded
  mend_turns(count, {a.data(), b.data(), c.data(), d.data(), mend.data()});
  for (const Real value : determinant()) {
    CHECK(std::abs(value - 1.0L) <= bound);
  }
}

TEST_CASE("matrices made of sines are the mended ones of the same entries") {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> angle(-10.0, 10.0), frequency(0.01, 100.0);
  constexpr std::size_t count = 61;  // no whole number of vectors
  constexpr double tau = 0.3;
  std::vector<double> omega(count), cosine(count), sine(count), up(count), down(count);
  std::vector<double> a(count), b(count), c(count);
  for (std::size_t w = 0; w < count; ++w) {
    const double theta = angle(random);
    omega[w] = w == 7 ? 0.0 : frequency(random);
    cosine[w] = w == 7 ? 1.0 : std::cos(theta);
    sine[w] = w == 7 ? 0.0 : std::sin(theta);
    up[w] = w == 7 ? 1.0 : 1.0 / omega[w];
    down[w] = -omega[w];
    a[w] = cosine[w];
    b[w] = w == 7 ? tau : sine[w] * up[w];
    c[w] = sine[w] * down[w];
  }
  std::vector<double> d = a, mend(count);
  mend_turns(count, {a.data(), b.data(), c.data(), d.data(), mend.data()});
  std::vector<std::vector<double>> made(4, std::vector<double>(count));
  make_turns(tau, omega.data(), cosine.data(), sine.data(), up.data(), down.data(), count,
             {made[0].data(), made[1].data(), made[2].data(), nullptr, made[3].data()});
  CHECK(made == std::vector<std::vector<double>>{a, b, c, mend});
  CHECK(made[1][7] == tau);
  CHECK(made[1][8] != tau);  // the twin: a wave that turns
}

TEST_CASE("a pair of waves is kicked, summed and turned in one pass") {
  // Lengths with and without a rest beside whole vectors. Sums of products of numbers below 1 err by less than ε of
  // each term and addition: count² ε in all.
  std::mt19937_64 random(10);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  const auto brief = [](double entry) {  // its first 12 bits
    int exponent = 0;
    const double scaled = std::ldexp(std::frexp(entry, &exponent), 12);
    return std::ldexp(std::trunc(scaled), exponent - 12);
  };
  for (const std::size_t count : {std::size_t{3}, std::size_t{64}, std::size_t{77}}) {
    std::vector<std::vector<double>> rows(16, std::vector<double>(count));
    for (auto& row : rows) {
      std::ranges::generate(row, [&] { return value(random); });
    }
    const auto at = [&](int row) { return rows[static_cast<std::size_t>(row)].data(); };
    const PairMatrices matrices{at(0), at(1), at(2), at(3), at(4)};
    constexpr double kick = 0.7;
    for (const bool kicks : {false, true}) {
      std::vector<std::vector<double>> x(rows.begin() + 8, rows.begin() + 12), wanted = x;
      double sum = 0.0, sum_turned = 0.0;
      for (std::size_t w = 0; w < count; ++w) {
        wanted[2][w] += kicks ? kick * rows[12][w] : 0.0;
        wanted[3][w] += kicks ? kick * rows[13][w] : 0.0;
        const auto weighted = [&] {
          return rows[5][w] * (rows[14][w] * (wanted[0][w] * wanted[0][w] + wanted[1][w] * wanted[1][w]) +
                               rows[15][w] * (wanted[2][w] * wanted[2][w] + wanted[3][w] * wanted[3][w]));
        };
        sum += weighted();
        for (const std::size_t part : {0u, 1u}) {
          const double u = wanted[part][w], v = wanted[2 + part][w];
          const auto turned = [&](double first, double second) {
            const double product = brief(first) * u + brief(second) * v;
            return product + (((first - brief(first)) * u + (second - brief(second)) * v) + rows[4][w] * product);
          };
          wanted[part][w] = turned(rows[0][w], rows[1][w]);
          wanted[2 + part][w] = turned(rows[2][w], rows[3][w]);
        }
        sum_turned += weighted();
      }
      const RowPair pair{x[0].data(), x[1].data(), x[2].data(), x[3].data()};
      BeforeTurn before;
      if (kicks) {
        before.kick = kick;
        before.re = at(12);
        before.im = at(13);
      }
      const auto start = x;
      CHECK(turn_pair(matrices, before, count, pair) == 0.0);
      CHECK(x == wanted);
      x = start;
      before.of_x = at(14);
      before.of_y = at(15);
      before.weights = at(5);
      const double found = turn_pair(matrices, before, count, pair);
      CHECK(x == wanted);
      const auto n = static_cast<double>(count);
      CHECK(found == Approx(sum).epsilon(0.0).margin(n * n * 2.3e-16));
      CHECK(found != Approx(sum_turned).epsilon(0.0).margin(n * n * 2.3e-16));  // the twin: after the turn
    }
  }
}

TEST_CASE("steps of a splitting in any order of lengths are those of their own") {
  // What turns the waves is kept from step to step: more lengths than there is room for, and one that is no number.
  for (const Example& example : examples()) {
    INFO(example.name);
    const auto level = first_level(example.system, line, example.given);
    WaveSplitting kept(example.system, line);
    kept.prepare(composition("kahan-li-6"), 0.1);
    grids::FieldSet found = level.fields, wanted = level.fields;
    for (const double h : {0.1, 0.07, 0.11, 0.1, 0.1, 0.07, 0.0, -0.1, 0.1, 0.09, 0.08}) {
      kept.stand(level);
      REQUIRE(kept.step(composition("kahan-li-6"), h));
      kept.fields(found);
      WaveSplitting own(example.system, line);
      own.stand(level);
      REQUIRE(own.step(composition("kahan-li-6"), h));
      own.fields(wanted);
      CHECK(std::ranges::equal(found.all(), wanted.all()));
      CHECK(kept.generator() == own.generator());
      CHECK_FALSE(kept.step(composition("kahan-li-6"), std::numeric_limits<double>::quiet_NaN()));
      REQUIRE(own.step(composition("kahan-li-6"), h + 1e-3));  // the twin
      own.fields(wanted);
      CHECK_FALSE(std::ranges::equal(found.all(), wanted.all()));
    }
  }
}

TEST_CASE("splittings of waves do not drift by the rounding of what turns them") {
  // With rounded matrices a wave grows by up to ε in every step, always by the same: 1e-16 of the energy, 2e-12 in
  // 20000 steps. At random that is √20000 ε, and this a few times, for 17 stages.
  const grids::Grid grid({{"x", -20, 20, 96}});
  const auto system = sine_gordon();
  InitialFields initial(3);
  initial[0] = sampled(grid, [](double) { return 0.0; });
  initial[1] = sampled(grid, [](double x) { return 2.0 * std::sqrt(3.0) / std::cosh(std::sqrt(0.75) * x); });
  LatticeIntegrator lattice(
      system, grid, initial,
      {.lagrangian = "splitting", .composition = "kahan-li-8", .step = 0.125, .until = 2500, .levels = Levels::fixed});
  std::vector<double> energies;
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    energies.push_back(lattice.totals()[0]);
  }
  const auto mean = [&](std::size_t eighth) {
    const std::size_t count = energies.size() / 8;
    return std::accumulate(energies.begin() + static_cast<std::ptrdiff_t>(eighth * count),
                           energies.begin() + static_cast<std::ptrdiff_t>((eighth + 1) * count), 0.0) /
           static_cast<double>(count);
  };
  CHECK(std::abs(mean(7) - mean(0)) <= 20.0 * std::sqrt(20000.0) * 2.2e-16 * mean(0));
  // The twin: what the energy strays by within an eighth, the error of the scheme, is seen.
  const auto [least, greatest] = std::minmax_element(energies.begin(), energies.begin() + 1000);
  CHECK(*greatest - *least > 1e-12 * mean(0));
}

TEST_CASE("a splitting has the symmetry of a periodic S: waves at u = 2πn have the error of those at 0") {
  // Of u = 2πn + w each step leaves rounding errors of 2πn. The twin is an S that is not periodic.
  constexpr double far = 200.0 * std::numbers::pi;
  const auto strays = [](const std::string& V) {
    const auto after_steps = [&](double offset) {
      const MultisymplecticSystem system = wave_equation(V);
      LatticeLevel level = first_level(system, line, {"u", "v"});
      for (double& u : level.fields.field(system.field("u"))) {
        u += offset;
      }
      WaveSplitting splitting(system, line);
      splitting.stand(level);
      for (int k = 0; k < 20; ++k) {
        REQUIRE(splitting.step(composition("blanes-moan-4"), 0.1));
        splitting.accept();
      }
      splitting.fields_here(level.fields);
      for (double& u : level.fields.field(system.field("u"))) {
        u -= offset;
      }
      return level.fields;
    };
    return largest_difference(after_steps(far).all(), after_steps(0.0).all());
  };
  CHECK(strays("1 - cos(u)") < 20.0 * far * 2.2e-16 * 10.0);
  CHECK(strays("(1 - cos(u))*cos(sin(u/2)^2)") < 20.0 * far * 2.2e-16 * 10.0);
  CHECK(strays("sqrt(1 + u^2)") > 1e-3);
}

TEST_CASE("waves have the quadratic part of S without sines and cosines of the fields") {
  const auto of = [](const std::string& V) { return hessian_of_waves(wave_equation(V), line)(0, 0); };
  CHECK(of("3*u^2/2 + u^4/4") == 3.0);
  CHECK(of("1 - cos(u)") == 0.0);
  CHECK(of("3*u^2/2 - cos(2*u + 1)*sin(u)") == 3.0);
  CHECK(of("exp(-cos(u))") == 0.0);
  // Of an angle that is not linear in the fields, and of the place, S is not periodic.
  CHECK(of("cos(u^2)*u^2/2") == 1.0);
  CHECK(of("(2 + cos(x))*cosh(u)") == Approx(2.0).epsilon(0.2));
}

TEST_CASE("rates that are asked for are the same as among those of all fields") {
  // Bit by bit, of one field after the other; the twin: what is not asked for is not reported.
  for (const Example& example : examples()) {
    INFO(example.name);
    const LatticeLevel first = first_level(example.system, line, example.given);
    WaveSplitting splitting(example.system, line);
    const int d = example.system.field_count();
    grids::FieldSet all(d, line.size()), some(d, line.size());
    for (const bool here : {true, false}) {
      splitting.stand(first);
      REQUIRE(splitting.step(composition("blanes-moan-4"), 0.05));
      const auto write = [&](grids::FieldSet& rates, const std::vector<bool>& asked) {
        here ? splitting.rates_here(rates, asked) : splitting.rates(rates, asked);
      };
      write(all, {});
      int moving = 0;
      for (int f = 0; f < d; ++f) {
        std::vector<bool> asked(static_cast<std::size_t>(d), false);
        asked[static_cast<std::size_t>(f)] = true;
        write(some, asked);
        CHECK(std::ranges::equal(std::as_const(some).field(f), std::as_const(all).field(f)));
        const auto is_zero = [](double value) { return value == 0.0; };
        for (int other = 0; other < d; ++other) {
          CHECK((other == f || std::ranges::all_of(std::as_const(some).field(other), is_zero)));
        }
        moving += !std::ranges::all_of(std::as_const(all).field(f), is_zero);
      }
      CHECK(moving >= 2);
    }
  }
}
