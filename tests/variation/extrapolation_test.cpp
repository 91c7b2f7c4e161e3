#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include <catch2/catch.hpp>

#include <rubato/variation/extrapolation.hpp>

using rubato::Extrapolation;

namespace {

/// How far what is foreseen is off the values of f at unequal times, at most, of the last of `count`.
double error_of_last(const std::function<double(double)>& f, int count, double step) {
  Extrapolation values;
  double time = 0.0, error = 0.0;
  for (int k = 0; k < count; ++k) {
    const double ahead = step * (1.0 + 0.2 * std::sin(1.7 * k));
    if (k == 0) {
      values.add(0.0, f(time));
      continue;
    }
    const double foreseen = values.at(ahead);
    time += ahead;
    error = k + 10 >= count ? std::max(error, std::abs(foreseen - f(time))) : 0.0;
    values.add(ahead, f(time));
  }
  return error;
}

}  // namespace

TEST_CASE("what is foreseen of a polynomial of degree five is that, at unequal times, and of degree six is not") {
  const auto quintic = [](double t) { return 1.0 - t + t * t * (0.5 - 0.1 * t + 0.01 * t * t * t); };
  // At t = 10 terms of 1000, differences of which lose six digits to rounding: times ε.
  const double rounding = 1e6 * 1000.0 * std::numeric_limits<double>::epsilon();
  CHECK(error_of_last(quintic, 100, 0.1) < rounding);
  // The remainder is f'''''' Π (t - t_j)/6! ≥ (0.08)^6 of t^6.
  const auto sextic = [](double t) { return std::pow(t, 6); };
  CHECK(error_of_last(sextic, 100, 0.5) > 0.9 * std::pow(0.4, 6));
}

TEST_CASE("of something smooth the highest degree is believed: the error falls with the sixth power of the step") {
  const auto wave = [](double t) { return std::sin(t); };
  const double coarse = error_of_last(wave, 200, 0.2), fine = error_of_last(wave, 400, 0.1);
  CHECK(coarse / fine > 40.0);  // 2⁶ = 64; times are unequal, and which ones come last differs
  CHECK(coarse <
        6.0 * 24.0 * std::pow(0.24, 6));  // |f⁽⁶⁾| 6! h⁶/6! at equal steps of the longest, twice that for the last
}

TEST_CASE("of noise a low degree is believed, which is off by little more than the noise") {
  std::mt19937_64 engine(7);
  std::normal_distribution<double> normal;
  Extrapolation values;
  values.add(0.0, 5.0);
  double square = 0.0, exaggerated = 0.0, before = 5.0, before_that = 5.0;
  constexpr int count = 4000;
  for (int k = 0; k < count; ++k) {
    const double value = 5.0 + normal(engine);
    const double error = values.at(1.0) - value, of_line = 2.0 * before - before_that - value;
    square += error * error / count;
    exaggerated += of_line * of_line / count;
    values.add(1.0, value);
    before_that = before;
    before = value;
  }
  // The value before has a variance of the difference of 2, a line through two of them one of 6; that which degree was
  // near of late shows nothing here costs some more of the low one.
  CHECK(square < 5.0);
  CHECK(exaggerated > 5.5);
}

TEST_CASE("a bend costs some steps, not the rest of the run") {
  const auto bent = [](double t) { return t < 20.0 ? t * t : 400.0 + std::sin(t - 20.0); };
  CHECK(error_of_last(bent, 400, 0.1) < 1e-6);  // 380 steps of 0.1 are t = 38
  CHECK(error_of_last(bent, 202, 0.1) > 1e-3);  // the same at the bend
}

TEST_CASE("an extrapolation that is saved goes on as if it had not been") {
  Extrapolation first;
  first.add(0.0, 1.0);
  for (int k = 1; k < 20; ++k) {
    (void)first.at(0.3);
    first.add(0.3, std::exp(0.1 * k));
  }
  rubato::StateWriter writer(rubato::StateWriter::For::record);
  first.save(writer);
  Extrapolation second;
  rubato::StateReader reader(writer);
  second.restore(reader);
  CHECK(second.newest() == first.newest());
  CHECK(second.error() == first.error());
  for (int k = 20; k < 30; ++k) {
    CHECK(first.at(0.3) == second.at(0.3));
    first.add(0.3, std::cos(k));
    second.add(0.3, std::cos(k));
    CHECK(first.error() == second.error());
  }
}

TEST_CASE("what was foreseen for another time is not judged, and so a save in between changes nothing") {
  Extrapolation first;
  first.add(0.0, 1.0);
  for (int k = 1; k < 10; ++k) {
    (void)first.at(0.3);
    first.add(0.3, std::exp(0.1 * k));
  }
  const double error = first.error();
  (void)first.at(0.1);
  first.add(0.3, std::exp(1.0) + 1.0);
  CHECK(first.error() == error);
  (void)first.at(0.3);
  first.add(0.3, std::exp(1.1));
  CHECK(first.error() != error);
}
