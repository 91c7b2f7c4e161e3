// Sums and maxima of arrays, in vectors, beside the templates that they are instances of.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
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

TEST_CASE("A sum is exact to one rounding, whatever the order and the parts of its terms", "[reductions]") {
  constexpr double infinity = std::numeric_limits<double>::infinity(), most = std::numeric_limits<double>::max();
  std::vector<double> v = uneven_values(3000);
  std::vector<double> by_size = v;
  std::ranges::sort(by_size, {}, [](double x) { return std::abs(x); });
  const auto exact = static_cast<double>(std::accumulate(by_size.begin(), by_size.end(), 0.0L));
  std::mt19937_64 random(7);
  std::size_t plain_sums_that_differ = 0;
  for (int shuffle = 0; shuffle < 50; ++shuffle) {
    std::ranges::shuffle(v, random);
    LaneSum lanes;
    rubato::CompensatedSum parts;
    for (std::size_t begin = 0; begin < v.size();) {
      const std::size_t count = std::min(v.size() - begin, random() % 700);
      LaneSum part;
      part.add(std::span(v).subspan(begin, count));
      parts.add(part.total());
      lanes.add(std::span(v).subspan(begin, count));
      begin += count;
    }
    // One rounding of the sum, and one of the extended sum that it is compared with.
    CHECK(parts.value() == Approx(exact).epsilon(2.3e-16).margin(0.0));
    CHECK(lanes.total().value() == Approx(exact).epsilon(2.3e-16).margin(0.0));
    const double plain = std::accumulate(v.begin(), v.end(), 0.0);
    plain_sums_that_differ += std::abs(plain - exact) > 2.3e-16 * std::abs(exact);
  }
  CHECK(plain_sums_that_differ > 25);  // the twin: in most orders a plain sum is off by more

  CHECK(sum(std::vector<double>{1.0, 0x1p-105, -1.0}) == 0x1p-105);
  CHECK(sum(std::vector<double>(100000, 0.1)) == 10000.0);
  CHECK(sum(std::vector<double>{most, most}) == infinity);
  CHECK(sum(std::vector<double>{infinity, 1.0}) == infinity);
  CHECK(std::isnan(sum(std::vector<double>{infinity, -infinity})));
}

TEST_CASE("Sums of squares are those of the squares, bit by bit, whatever the sizes", "[reductions]") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  std::mt19937_64 random(11);
  for (const std::size_t count :
       {std::size_t{0}, std::size_t{1}, std::size_t{7}, std::size_t{100}, std::size_t{2049}, std::size_t{70000}}) {
    for (const int range : {1, 40, 1000}) {
      std::vector<double> values(count), squares(count);
      for (std::size_t i = 0; i < count; ++i) {
        values[i] = std::ldexp(std::uniform_real_distribution<double>(-1.0, 1.0)(random),
                               static_cast<int>(random() % static_cast<unsigned>(range)) - range / 2);
        squares[i] = values[i] * values[i];
      }
      CAPTURE(count, range);
      LaneSum sum, of_squares;
      sum.add_squares(values);
      of_squares.add(squares);
      CHECK(sum.total().value() == of_squares.total().value());
      const rubato::Spread spread = magnitudes(values);
      CHECK(spread.largest() == largest_of(values));
      CHECK(spread.squares == rubato::grids::sum(squares));
      if (count > 0) {
        // The twin: one value that is the largest by far.
        values[count / 2] = 2.0 * spread.largest();
        CHECK(magnitudes(values).squares != spread.squares);
        for (const double bad : {infinity, -infinity, nan, 1e200}) {
          values[count / 2] = bad;
          LaneSum undefined;
          undefined.add_squares(values);
          CHECK_FALSE(std::isfinite(undefined.total().value()));
        }
      }
    }
  }
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
