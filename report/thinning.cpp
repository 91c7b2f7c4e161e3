#include <rubato/report/thinning.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/base/limits.hpp>

namespace rubato::report {

std::vector<std::size_t> envelope(std::span<const double> y, std::size_t buckets) {
  if (buckets == 0) {
    throw std::invalid_argument("envelope: there must be at least one bucket");
  }
  std::vector<std::size_t> kept;
  if (y.size() <= 2 * buckets) {
    kept.resize(y.size());
    std::iota(kept.begin(), kept.end(), std::size_t{0});
    return kept;
  }
  const Partition partition(y.size(), buckets);
  for (std::size_t part = 0; part < partition.parts(); ++part) {
    const std::size_t none = y.size();
    std::size_t smallest = none, largest = none, undefined = none;
    for (std::size_t i = partition.begin(part); i < partition.end(part); ++i) {
      if (!std::isfinite(y[i])) {
        undefined = std::min(undefined, i);
        continue;
      }
      if (smallest == none || y[i] < y[smallest]) {
        smallest = i;
      }
      if (largest == none || y[i] > y[largest]) {
        largest = i;
      }
    }
    std::vector<std::size_t> here{smallest, largest, undefined};
    if (part == 0) {
      here.push_back(0);
    }
    if (part + 1 == partition.parts()) {
      here.push_back(y.size() - 1);
    }
    std::erase(here, none);
    std::ranges::sort(here);
    kept.insert(kept.end(), here.begin(), std::unique(here.begin(), here.end()));
  }
  return kept;
}

std::vector<std::size_t> envelope_within(std::span<const double> y, std::size_t points) {
  if (y.size() <= points) {
    return envelope(y, y.size() + 1);
  }
  const bool has_gaps = !all_finite(y);
  return envelope(y, (points - 2) / (has_gaps ? 3 : 2));  // with both ends
}

std::vector<std::size_t> merge(std::span<const std::size_t> a, std::span<const std::size_t> b) {
  std::vector<std::size_t> both;
  std::ranges::set_union(a, b, std::back_inserter(both));
  return both;
}

std::vector<double> pick(std::span<const double> values, std::span<const std::size_t> indices, std::size_t stride,
                         std::size_t offset) {
  std::vector<double> picked;
  picked.reserve(indices.size());
  for (const std::size_t index : indices) {
    picked.push_back(values[index * stride + offset]);
  }
  return picked;
}

Partition::Partition(std::size_t places, std::size_t most_parts)
    : places_(places), parts_(std::min(places, most_parts)) {
  if (parts_ == 0) {
    throw std::invalid_argument(fmt::format("Partition: {} places in {} parts", places, most_parts));
  }
}

BlockEnvelope::BlockEnvelope(const Partition& rows, const Partition& columns)
    : rows_(rows),
      columns_(columns),
      low_(rows.parts() * columns.parts(), infinity),
      high_(rows.parts() * columns.parts(), -infinity) {}

void BlockEnvelope::add_row(std::span<const double> values) {
  if (values.size() != columns_.places() || next_row_ == rows_.places()) {
    throw std::invalid_argument(fmt::format("BlockEnvelope: row {} of {} values, but the matrix is {} by {}", next_row_,
                                            values.size(), rows_.places(), columns_.places()));
  }
  const std::size_t part = rows_.part_of(next_row_);
  for (std::size_t column = 0; column < columns_.parts(); ++column) {
    double& low = low_[part * columns_.parts() + column];
    double& high = high_[part * columns_.parts() + column];
    for (std::size_t i = columns_.begin(column); i < columns_.end(column); ++i) {
      const double value = values[i];
      if (!std::isfinite(value)) {
        low = high = std::numeric_limits<double>::quiet_NaN();  // with which no comparison below is true any more
      }
      low = value < low ? value : low;
      high = value > high ? value : high;
    }
  }
  close_row();
}

void BlockEnvelope::skip_row() {
  close_row();
}

void BlockEnvelope::close_row() {
  const std::size_t part = rows_.part_of(next_row_++);
  if (next_row_ != rows_.end(part)) {
    return;
  }
  for (std::size_t i = part * columns_.parts(); i < (part + 1) * columns_.parts(); ++i) {
    if (low_[i] > high_[i]) {
      low_[i] = high_[i] = std::numeric_limits<double>::quiet_NaN();
    }
  }
}

}  // namespace rubato::report
