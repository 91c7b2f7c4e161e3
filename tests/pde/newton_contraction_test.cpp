#include <catch2/catch.hpp>

#include <cmath>
#include <limits>

#include <rubato/pde/newton_contraction.hpp>

using rubato::NewtonContraction;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

}  // namespace

TEST_CASE("nothing measured, Newton's error is the square of its last correction") {
  const NewtonContraction contraction;
  CHECK(contraction.error_after(1e-4, 0.1) == Approx(1e-8));
  // Twin: after a measurement it is less.
  NewtonContraction measured;
  measured.observe(1e-3, 1e-9, 0.1);
  CHECK(measured.error_after(1e-4, 0.1) < 1e-9);
}

TEST_CASE("a measured contraction bounds the next correction of x -> x^2 - a, and half of it does not") {
  // Newton for x² = a, sizes relative to x = 1: c' = -c²/2 + O(c³), so that κ = 1/2 at every correction.
  const auto next_correction = [](double& x) {
    const double c = (2.0 - x * x) / (2.0 * x);
    x += c;
    return std::abs(c);
  };
  NewtonContraction contraction;
  double x = 1.5;
  double last = next_correction(x);
  int checked = 0;
  for (int i = 0; i < 2; ++i) {
    const double size = next_correction(x);
    contraction.observe(last, size, 0.1);
    double ahead = x;
    const double next = next_correction(ahead);
    if (next > 16.0 * epsilon) {
      CHECK(next <= contraction.error_after(size, 0.1));
      CHECK(next > 0.1 * contraction.error_after(size, 0.1));
      ++checked;
    }
    last = size;
  }
  CHECK(checked > 0);
}

TEST_CASE(
    "a measurement fades from level to level and with longer steps, and corrections of rounding do not spoil it") {
  NewtonContraction contraction;
  contraction.observe(1e-3, 1e-10, 0.1);  // κ = 1e-4
  const double fresh = contraction.error_after(1e-5, 0.1);
  CHECK(fresh == Approx(4e-14));
  CHECK(contraction.error_after(1e-5, 0.05) == Approx(fresh));
  CHECK(contraction.error_after(1e-5, -0.2) == Approx(8.0 * fresh));
  contraction.observe(1e-7, epsilon, 0.1);  // says κ < 0.36 and no more
  CHECK(contraction.error_after(1e-5, 0.1) == fresh);
  contraction.observe(1e-3, 1e-9, 0.1);  // twin: a real one counts
  CHECK(contraction.error_after(1e-5, 0.1) == Approx(10.0 * fresh));
  contraction.advance();
  CHECK(contraction.error_after(1e-5, 0.1) == Approx(20.0 * fresh));
  for (int level = 0; level < 100; ++level) {
    contraction.advance();
  }
  CHECK(contraction.error_after(1e-5, 0.1) == Approx(1e-10));
  // Where Newton's method contracts badly, that is what is known, however many levels ago.
  contraction.observe(1e-3, 1e-5, 0.1);  // κ = 10
  CHECK(contraction.error_after(1e-5, 0.1) == Approx(4e-9));
  for (int level = 0; level < 100; ++level) {
    contraction.advance();
  }
  CHECK(contraction.error_after(1e-5, 0.1) == Approx(4e-9));
}

TEST_CASE("a contraction restored goes on as it would have") {
  NewtonContraction contraction;
  contraction.observe(1e-3, 1e-10, 0.1);
  contraction.advance();
  rubato::StateWriter state;
  contraction.save(state);
  NewtonContraction restored;
  CHECK(restored.error_after(1e-5, 0.3) != contraction.error_after(1e-5, 0.3));
  rubato::StateReader reader(state.values());
  restored.restore(reader);
  CHECK(restored.error_after(1e-5, 0.3) == contraction.error_after(1e-5, 0.3));
}
