#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include <catch2/catch.hpp>

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

TEST_CASE("undefined values leave a block undefined only if it has no others") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  BlockEnvelope blocks({2, 1}, {4, 2});
  blocks.add_row(std::vector{nan, nan, nan, 2.0});
  blocks.add_row(std::vector{nan, nan, 1.0, nan});
  CHECK(std::isnan(blocks.low()[0]));
  CHECK(std::isnan(blocks.high()[0]));
  CHECK(blocks.low()[1] == 1.0);
  CHECK(blocks.high()[1] == 2.0);
  CHECK_THROWS_AS(blocks.add_row(std::vector(4, 0.0)), std::invalid_argument);
}
