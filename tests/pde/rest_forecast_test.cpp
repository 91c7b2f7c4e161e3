// What Gauss collocation on lattices begins its iteration with: against the waves that it is exact for.

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/rest_forecast.hpp>

#include "humps.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

using Wave = std::function<std::complex<double>(std::size_t wave, double t)>;

/// Stages of the step that begins at t, with h = 1; a second field is twice the first.
void sample(const Wave& wave, const GaussTableau& tableau, double t, WaveRows& rests) {
  for (int row = 0; row < rests.rows(); ++row) {
    for (std::size_t w = 0; w < rests.waves(); ++w) {
      const std::complex<double> value =
          (row < tableau.stages ? 1.0 : 2.0) * wave(w, t + tableau.c[row % tableau.stages]);
      rests.re.field(row)[w] = value.real();
      rests.im.field(row)[w] = value.imag();
    }
  }
}

/// The largest error of what is foreseen after so many steps, all of them foreseen that can be.
double error_after(int steps, const Wave& wave, int stages) {
  const GaussTableau tableau(stages);
  RestForecast forecast(tableau, 2, 21);
  WaveRows foreseen(2 * stages, 21), expected = foreseen;
  for (int k = 0; k < steps; ++k) {
    if (k > 0) {
      forecast.foresee(foreseen);
    }
    sample(wave, tableau, k, forecast.next());
    forecast.add(1.0);
  }
  forecast.foresee(foreseen);
  sample(wave, tableau, steps, expected);
  double largest = 0.0;
  for (int row = 0; row < foreseen.rows(); ++row) {
    for (std::size_t w = 0; w < foreseen.waves(); ++w) {
      largest = std::max({largest, std::abs(foreseen.re.field(row)[w] - expected.re.field(row)[w]),
                          std::abs(foreseen.im.field(row)[w] - expected.im.field(row)[w])});
    }
  }
  return largest;
}

/// `count` frequencies on each wave, up to 9 in a step.
Wave turning(int count) {
  return [count](std::size_t wave, double t) {
    std::complex<double> sum = 0.0;
    for (int j = 0; j < count; ++j) {
      sum += std::polar(1.0 / (1 + j), (j + 1) * (0.3 + 0.13 * static_cast<double>(wave)) * t + j);
    }
    return sum;
  };
}

}  // namespace

TEST_CASE("rests of waves that turn with one or two frequencies are foreseen") {
  // One frequency takes two steps to fit, two take three; one more step shows that the recurrence is better than the
  // polynomial. Rounding grows by what the second frequency has that the first has not, a tenth at least, squared.
  for (const int stages : {3, 6, 8}) {
    INFO(stages << " stages");
    CHECK(error_after(3, turning(1), stages) < 1e-13);
    CHECK(error_after(4, turning(2), stages) < 1e-11);
    // The twins: a step or a frequency more than it can show, and the polynomial alone.
    CHECK(error_after(1, turning(1), stages) > 1e-2);
    CHECK(error_after(4, turning(3), stages) > 1e-4);
  }
}

TEST_CASE("rests of one stage are foreseen by as many steps as are known, eight at most") {
  const auto power = [](int degree) {
    return [degree](std::size_t wave, double t) {
      return std::complex<double>(std::pow(1.0 + 0.1 * t, degree), 0.1 * static_cast<double>(wave));
    };
  };
  for (const int steps : {1, 4, 8, 12}) {
    INFO(steps << " steps");
    // The binomial coefficients of eight are 255 in all. Values are up to 2.25^7 < 300 and off by two units, and each
    // of the eight sums rounds. (Through fewer points than eight or four the polynomials are the same.)
    constexpr double rounding = 255.0 * 300.0 * 10.0 * 1.2e-16;
    const int points = std::min(steps, 8);
    CHECK(error_after(steps, power(points - 1), 1) < rounding);
    CHECK(error_after(steps, power(points), 1) > 1e3 * rounding);  // the twin: Δ^n (0.1 t)^n is n!/10^n
  }
  // What turns too far in a step for polynomials is begun where it was: off by no more than what it moves by.
  CHECK(error_after(12, turning(1), 1) < 2.0 * 2.0);
  CHECK(error_after(12, turning(1), 1) > 0.1);
}

TEST_CASE("rests that are polynomials in time are foreseen from one step") {
  const auto power = [](int degree) {
    return [degree](std::size_t wave, double t) {
      return std::complex<double>(std::pow(1.0 + 0.1 * t, degree), 0.1 * static_cast<double>(wave));
    };
  };
  // Σ |ℓ_j(2)| is 7, 1.7e3 and 5.8e4 with 2, 6, 8 stages or less, which rounding is multiplied by.
  for (const int stages : {2, 6, 8}) {
    INFO(stages << " stages");
    CHECK(error_after(1, power(stages - 1), stages) < 1e5 * 1e-15);
    CHECK(error_after(1, power(stages), stages) > 1e5 * 1e-15);
  }
}

TEST_CASE("a step near one whose matrices are there is as good as one with its own") {
  for (const int which : {0, 1, 3}) {
    const Example example = examples()[static_cast<std::size_t>(which)];
    INFO(example.name);
    const LatticeLevel first = first_level(example);
    const double h = 0.05;
    for (const double apart : {3e-11, 1e-13}) {
      const auto kept = make_gauss_lattice(example.system, example.grid, 4, first);
      REQUIRE(kept->advance(h, 0.0) == Status::success);
      const double energy = kept->discrete_energy();
      REQUIRE(kept->advance(h * (1.0 + apart), 0.0) == Status::success);
      const auto own = make_gauss_lattice(example.system, example.grid, 4, first);
      REQUIRE(own->advance(h * (1.0 + apart), 0.0) == Status::success);
      CHECK(kept->discrete_energy() == Approx(own->discrete_energy()).epsilon(1e-14));
      kept->accept();
      own->accept();
      const auto a = kept->level().fields.all(), b = own->level().fields.all();
      CHECK(largest_difference(a, b) < 1e-15);
      // The twin: the step itself differs, by `apart` of what it moves by, some tenths.
      if (apart > 1e-12) {
        const auto other = make_gauss_lattice(example.system, example.grid, 4, first);
        REQUIRE(other->advance(h, 0.0) == Status::success);
        CHECK(energy == Approx(other->discrete_energy()).epsilon(1e-14));
        other->accept();
        CHECK(largest_difference(a, other->level().fields.all()) > 1e-13);
      }
    }
  }
}

TEST_CASE("equal steps of Gauss collocation continue bit by bit from their saved state") {
  // Matrices, stages foreseen and the ways that were nearest are all of the state.
  const Example example = examples()[1];
  const LatticeLevel first = first_level(example);
  const auto straight = make_gauss_lattice(example.system, example.grid, 4, first);
  static_cast<void>(after(*straight, 0.02, 1));
  const double near_by = 0.02 * (1.0 + 1e-12);
  for (const int steps : {0, 1, 1, 2}) {
    static_cast<void>(after(*straight, near_by, steps));
    StateWriter saved;
    straight->save(saved);
    const auto resumed = make_gauss_lattice(example.system, example.grid, 4, first);
    StateReader reader(saved.values());
    resumed->restore(reader);
    CHECK(reader.done());
    const auto a = after(*resumed, near_by, 3);
    StateReader back(saved.values());
    const auto b = after(*straight, near_by, 3);
    CHECK(std::ranges::equal(a.all(), b.all()));
    straight->restore(back);
  }
  // The twin: without what was saved the last digits are others.
  const auto fresh = make_gauss_lattice(example.system, example.grid, 4, straight->level());
  CHECK_FALSE(std::ranges::equal(after(*fresh, near_by, 3).all(), after(*straight, near_by, 3).all()));
}
