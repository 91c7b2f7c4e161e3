// Sums and maxima of arrays, in vectors, beside the templates that they are instances of.

#include <catch2/catch.hpp>

#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include <rubato/grids/reductions.hpp>

using namespace rubato::grids;

namespace {

/// Of sizes so different that a plain sum loses most of them.
std::vector<double> uneven_values(std::size_t count) {
  std::mt19937_64 random(count);
  std::uniform_real_distribution<double> mantissa(-1.0, 1.0), exponent(-12.0, 12.0);
  std::vector<double> values(count);
  for (double& value : values) {
    value = mantissa(random) * std::pow(10.0, exponent(random));
  }
  return values;
}

double largest_of(const std::vector<double>& values) {
  double largest = 0.0;
  for (const double value : values) {
    largest = std::max(largest, std::abs(value));
  }
  return largest;
}

}  // namespace

TEST_CASE("Sums in vectors have the bits of sums in lanes", "[reductions]") {
  std::size_t plain_sums_that_differ = 0;
  for (std::size_t count = 0; count < 5000; count = count < 70 ? count + 1 : 2 * count - 3) {
    const std::vector<double> v = uneven_values(count);
    CAPTURE(count);
    CHECK(sum(v) == sum_of(count, [&](std::size_t i) { return v[i]; }));
    double plain = 0.0;
    for (const double value : v) {
      plain += value;
    }
    plain_sums_that_differ += plain != sum(v);
  }
  CHECK(plain_sums_that_differ > 30);  // otherwise the values would show nothing
}

TEST_CASE("Maxima in vectors find every place, and values that are not finite", "[reductions]") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  for (const std::size_t count :
       {std::size_t{1}, std::size_t{7}, std::size_t{33}, std::size_t{100}, std::size_t{4097}}) {
    std::vector<double> a = uneven_values(count);
    const std::vector<double> b(a.rbegin(), a.rend());
    std::vector<double> difference(count);
    for (std::size_t i = 0; i < count; ++i) {
      difference[i] = a[i] - b[i];
    }
    CAPTURE(count);
    CHECK(max_abs(a) == largest_of(a));
    CHECK(max_abs_difference(a, b) == largest_of(difference));
    for (std::size_t i = 0; i < count; i += 1 + count / 50) {
      const double before = std::exchange(a[i], -1e30);
      CHECK(max_abs(a) == 1e30);
      CHECK(max_abs_difference(a, b) == std::abs(-1e30 - b[i]));
      a[i] = -infinity;
      CHECK(max_abs(a) == infinity);
      a[i] = nan;
      CHECK(std::isnan(max_abs(a)));
      CHECK(std::isnan(max_abs_difference(a, b)));
      a[i] = before;
    }
  }
  CHECK(max_abs({}) == 0.0);
  CHECK(sum({}) == 0.0);
}
