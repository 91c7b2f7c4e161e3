// Interpolation by waves between grids of one box.

#include <catch2/catch.hpp>

#include <cmath>
#include <vector>

#include <rubato/grids/resample.hpp>

using namespace rubato;
using namespace rubato::grids;

namespace {

/// Waves up to 2 along x and 1 along y, which 5 and 3 nodes resolve.
std::vector<double> smooth(const Grid& grid) {
  std::vector<double> values(grid.size());
  for (std::size_t node = 0; node < grid.size(); ++node) {
    const auto place = grid.place(node);
    const double x = 2.0 * std::acos(-1.0) * (grid.axis(0).node(place[0]) - grid.axis(0).from) / grid.axis(0).length();
    const double y = grid.dimensions() > 1 ? 2.0 * std::acos(-1.0) * (grid.axis(1).node(place[1]) + 1.0) / 3.0 : 0.4;
    values[node] = 0.3 + std::sin(2.0 * x + 0.1) + 0.5 * std::cos(x) * std::sin(y) - 0.25 * std::cos(y);
  }
  return values;
}

double difference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]));
  }
  return largest;
}

}  // namespace

TEST_CASE("resampled functions that a grid resolves are exact on every other, finer or coarser") {
  for (const std::size_t n : {5U, 6U, 9U, 16U}) {
    for (const std::size_t m : {3U, 4U, 5U, 6U, 7U, 16U, 33U}) {
      const Grid from({{"x", -1.0, 4.0, n}}), to({{"x", -1.0, 4.0, m}});
      INFO(n << " to " << m);
      CHECK(difference(resampled(smooth(from), from, to), smooth(to)) <
            1e-14);  // some ten roundings of numbers below 2
    }
  }
  const Grid from({{"x", 0.0, 1.0, 7}, {"y", -1.0, 2.0, 4}}), to({{"x", 0.0, 1.0, 12}, {"y", -1.0, 2.0, 9}});
  CHECK(difference(resampled(smooth(from), from, to), smooth(to)) < 1e-14);
  // The twin: four nodes do not resolve the second wave.
  const Grid coarse({{"x", -1.0, 4.0, 4}}), fine({{"x", -1.0, 4.0, 16}});
  CHECK(difference(resampled(smooth(coarse), coarse, fine), smooth(fine)) > 0.01);
}

TEST_CASE("the same grid gives the same values bit by bit, and another box is refused") {
  const Grid grid({{"x", 0.0, 2.0, 9}});
  CHECK(resampled(smooth(grid), grid, grid) == smooth(grid));
  const Grid other({{"x", 0.0, 2.5, 9}});
  CHECK_THROWS_AS(resampled(smooth(grid), grid, other), std::invalid_argument);
}
