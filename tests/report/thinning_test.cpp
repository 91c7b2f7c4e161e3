#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include <catch2/catch.hpp>

#include <rubato/report/budget.hpp>
#include <rubato/report/thinning.hpp>

using namespace rubato::report;

namespace {

using Indices = std::vector<std::size_t>;

std::vector<double> noise(std::size_t size) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::vector<double> values(size);
  std::ranges::generate(values, [&] { return normal(random); });
  return values;
}

/// Whether the selection has the extremes of every bucket, and both ends.
bool keeps_extremes(std::span<const double> y, const Indices& kept, std::size_t buckets) {
  const Partition partition(y.size(), buckets);
  bool all = !kept.empty() && kept.front() == 0 && kept.back() == y.size() - 1 && std::ranges::is_sorted(kept);
  for (std::size_t part = 0; part < partition.parts(); ++part) {
    const auto [low, high] =
        std::ranges::minmax(y.subspan(partition.begin(part), partition.end(part) - partition.begin(part)));
    double kept_low = INFINITY, kept_high = -INFINITY;
    for (const std::size_t i : kept) {
      if (i >= partition.begin(part) && i < partition.end(part)) {
        kept_low = std::min(kept_low, y[i]);
        kept_high = std::max(kept_high, y[i]);
      }
    }
    all = all && kept_low == low && kept_high == high;
  }
  return all;
}

/// Every n-th point and the last: what the envelope is there to be better than.
Indices decimate(std::size_t size, std::size_t count) {
  Indices kept;
  for (std::size_t i = 0; i < size; i += size / count) {
    kept.push_back(i);
  }
  if (kept.back() != size - 1) {
    kept.push_back(size - 1);
  }
  return kept;
}

}  // namespace

TEST_CASE("an envelope keeps the extremes of every bucket") {
  const auto size = GENERATE(std::size_t{5001}, std::size_t{20000}, std::size_t{99991});
  const auto buckets = GENERATE(std::size_t{1}, std::size_t{7}, std::size_t{1000});
  const std::vector<double> y = noise(size);
  const Indices kept = envelope(y, buckets);
  CHECK(keeps_extremes(y, kept, buckets));
  CHECK(kept.size() <= 2 * buckets + 2);
  CHECK_FALSE(keeps_extremes(y, decimate(size, 2 * buckets), buckets));
}

TEST_CASE("a spike of one point survives the envelope, and not plain decimation") {
  std::vector<double> y(100000, 1.0);
  y[77777] = -3.0;
  const auto has_spike = [](const Indices& kept) { return std::ranges::binary_search(kept, std::size_t{77777}); };
  CHECK(has_spike(envelope(y, 500)));
  CHECK_FALSE(has_spike(decimate(y.size(), 1000)));
}

TEST_CASE("short curves are not thinned, and gaps stay gaps") {
  const std::vector<double> few = noise(40);
  CHECK(envelope(few, 20).size() == 40);
  CHECK(envelope(few, 19).size() < 40);
  CHECK(envelope({}, 10).empty());
  CHECK_THROWS_AS(envelope(few, 0), std::invalid_argument);

  std::vector<double> y = noise(10000);
  y[1234] = std::numeric_limits<double>::quiet_NaN();
  y[5678] = std::numeric_limits<double>::infinity();
  const Indices kept = envelope(y, 100);
  CHECK(std::ranges::binary_search(kept, std::size_t{1234}));
  CHECK(std::ranges::binary_search(kept, std::size_t{5678}));
  CHECK(std::ranges::count_if(kept, [&](std::size_t i) { return !std::isfinite(y[i]); }) == 2);
}

TEST_CASE("a partition covers every place once") {
  const auto [places, parts] = GENERATE(table<std::size_t, std::size_t>({{1, 1}, {10, 3}, {4001, 350}, {7, 20}}));
  const Partition partition(places, parts);
  CHECK(partition.parts() == std::min(places, parts));
  CHECK(partition.begin(0) == 0);
  CHECK(partition.end(partition.parts() - 1) == places);
  for (std::size_t place = 0; place < places; ++place) {
    const std::size_t part = partition.part_of(place);
    CHECK((partition.begin(part) <= place && place < partition.end(part)));
  }
  CHECK_THROWS_AS(Partition(5, 0), std::invalid_argument);
}

TEST_CASE("blocks keep the extremes of a matrix") {
  constexpr std::size_t rows = 200, columns = 401;
  std::vector<double> matrix = noise(rows * columns);
  matrix[123 * columns + 45] = 1000.0;
  matrix[60 * columns + 400] = -1000.0;
  BlockEnvelope blocks({rows, 17}, {columns, 23});
  for (std::size_t row = 0; row < rows; ++row) {
    blocks.add_row(std::span(matrix).subspan(row * columns, columns));
  }
  const auto at = [&](std::size_t row, std::size_t column) {
    return blocks.rows().part_of(row) * 23 + blocks.columns().part_of(column);
  };
  CHECK(blocks.high()[at(123, 45)] == 1000.0);
  CHECK(blocks.low()[at(60, 400)] == -1000.0);
  bool encloses = true, attained = true;
  std::vector<double> low(blocks.low().size(), INFINITY), mean(blocks.low().size(), 0.0);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      const double value = matrix[row * columns + column];
      const std::size_t block = at(row, column);
      encloses = encloses && blocks.low()[block] <= value && value <= blocks.high()[block];
      low[block] = std::min(low[block], value);
      mean[block] += value / (200.0 / 17 * 401 / 23);
    }
  }
  attained = low == blocks.low();
  CHECK(encloses);
  CHECK(attained);
  // Means of blocks, which look smoother, hide the spike among some 200 values.
  CHECK(std::ranges::max(mean) < 100.0);
}

TEST_CASE("an undefined value leaves its block undefined, and skipped rows do not") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  BlockEnvelope blocks({3, 1}, {6, 3});
  blocks.skip_row();
  blocks.add_row(std::vector{1.0, 2.0, nan, 2.0, 3.0, 4.0});
  blocks.add_row(std::vector{0.5, 1.0, 1.0, 5.0, 3.0, std::numeric_limits<double>::infinity()});
  CHECK(blocks.low()[0] == 0.5);
  CHECK(blocks.high()[0] == 2.0);
  CHECK(std::isnan(blocks.low()[1]));
  CHECK(std::isnan(blocks.high()[1]));
  CHECK(std::isnan(blocks.high()[2]));
  CHECK_THROWS_AS(blocks.add_row(std::vector(6, 0.0)), std::invalid_argument);
  BlockEnvelope nothing({1, 1}, {2, 1});
  nothing.skip_row();
  CHECK(std::isnan(nothing.low()[0]));
}

TEST_CASE("an envelope stays within its points") {
  std::vector<double> y = noise(10000);
  for (const std::size_t points : {5U, 40U, 999U, 9999U}) {
    CHECK(envelope_within(y, points).size() <= points);
    CHECK(envelope_within(y, points).size() * 10 >= points * 6);
  }
  for (std::size_t i = 0; i < y.size(); i += 3) {
    y[i] = std::numeric_limits<double>::quiet_NaN();
  }
  CHECK(envelope_within(y, 999).size() <= 999);
  CHECK(envelope(y, 999 / 2).size() > 999);
  CHECK(envelope_within(y, 10000).size() == 10000);
}

namespace {

/// x and y after each other, and the path through them.
struct Plane {
  std::vector<double> x, y;
  [[nodiscard]] Path path() const { return {.size = x.size(), .columns = {x.data(), y.data()}, .strides = {1, 1}}; }
};

/// An eccentric ellipse, passed through at its own pace some times: slow and straight here, fast and bent there.
Plane ellipse(std::size_t size, double turns) {
  Plane plane;
  for (std::size_t k = 0; k < size; ++k) {
    const double mean = 2.0 * 3.14159265358979 * turns * static_cast<double>(k) / static_cast<double>(size);
    double angle = mean;
    for (int i = 0; i < 60; ++i) {
      angle = mean + 0.8 * std::sin(angle);
    }
    plane.x.push_back(std::cos(angle));
    plane.y.push_back(0.6 * std::sin(angle));
  }
  return plane;
}

/// The largest distance of a point from the line drawn over it, in units of the ranges 2 and 1.2: by trying many places
/// along the line.
double distance_from_lines(const Plane& plane, const Indices& kept) {
  double largest = 0.0;
  for (std::size_t i = 0; i + 1 < kept.size(); ++i) {
    for (std::size_t k = kept[i] + 1; k < kept[i + 1]; ++k) {
      double nearest = INFINITY;
      for (int s = 0; s <= 200; ++s) {
        const double part = s / 200.0;
        const double x = plane.x[kept[i]] + part * (plane.x[kept[i + 1]] - plane.x[kept[i]]) - plane.x[k];
        const double y = plane.y[kept[i]] + part * (plane.y[kept[i + 1]] - plane.y[kept[i]]) - plane.y[k];
        nearest = std::min(nearest, std::hypot(x / 2.0, y / 1.2));
      }
      largest = std::max(largest, nearest);
    }
  }
  return largest;
}

}  // namespace

TEST_CASE("a thinned path keeps its shape, and says how well") {
  const Plane plane = ellipse(20000, 5.0);
  const PathSelection selection = thin_path(plane.path(), 400);
  CHECK(selection.kept.size() <= 400);
  CHECK(selection.kept.size() > 300);
  CHECK(selection.kept.front() == 0);
  CHECK(selection.kept.back() == 19999);
  CHECK(selection.starts == Indices{0});
  const double measured = distance_from_lines(plane, selection.kept);
  // The places tried are a 200th of a line apart, and a line is no longer than a twentieth of the range.
  CHECK(std::abs(measured - selection.deviation) < 0.05 / 200);
  // 80 chords of an ellipse with equal errors: (2π)²/(8·80²) = 7.7e-4 of its half axes, 3.9e-4 of its range.
  CHECK(measured < 1e-3);
  // Points taken evenly in time are wrong by more.
  CHECK(distance_from_lines(plane, decimate(20000, 400)) > 3.0 * measured);
}

TEST_CASE("a path too long for one line is drawn in pieces that keep its shape") {
  const Plane plane = ellipse(50000, 2000.0);  // 25 points a turn: a thousand for all make half a point a turn
  const PathSelection selection = thin_path(plane.path(), 1000);
  CHECK(selection.kept.size() <= 1000);
  REQUIRE(selection.starts.size() == 8);
  CHECK(selection.kept.front() == 0);
  CHECK(selection.kept.back() == 49999);
  double measured = 0.0;
  for (std::size_t i = 0; i < 8; ++i) {
    const std::size_t end = i + 1 < 8 ? selection.starts[i + 1] : selection.kept.size();
    const Indices piece(selection.kept.begin() + static_cast<std::ptrdiff_t>(selection.starts[i]),
                        selection.kept.begin() + static_cast<std::ptrdiff_t>(end));
    measured = std::max(measured, distance_from_lines(plane, piece));
  }
  CHECK(measured < 0.01 + 1.0 / 200);
  CHECK(distance_from_lines(plane, decimate(50000, 1000)) > 0.2);  // lines across the ellipse
}

TEST_CASE("a path with room for all its points has them all") {
  const Plane plane = ellipse(100, 1.0);
  const PathSelection selection = thin_path(plane.path(), 100);
  CHECK(selection.kept.size() == 100);
  CHECK(selection.deviation == 0.0);
  const Plane still{std::vector(1000, 2.0), std::vector(1000, 3.0)};
  CHECK(thin_path(still.path(), 50).kept.size() <= 50);
  CHECK(thin_path(still.path(), 50).deviation == 0.0);
}

TEST_CASE("bytes are shared by need") {
  const std::vector<Demand> demands{{10, 100, 1.0}, {10, 1000, 1.0}, {10, 5000, 3.0}};
  CHECK(share(10000, demands) == std::vector<std::size_t>{100, 1000, 5000});
  CHECK(share(30, demands) == std::vector<std::size_t>{10, 10, 10});
  const std::vector<std::size_t> shares = share(2100, demands);
  CHECK(shares[0] == 100);  // all it needs, and the rest is shared one to three
  CHECK(shares[1] == Approx(500).margin(2));
  CHECK(shares[2] == Approx(1500).margin(2));
  CHECK(shares[0] + shares[1] + shares[2] <= 2100);
}
