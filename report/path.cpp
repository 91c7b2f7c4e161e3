#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <rubato/report/thinning.hpp>

namespace rubato::report {

namespace {

/// Lines as near as this, in units of a column's range, look like the path: five pixels in a picture of 500.
constexpr double enough = 0.01;
constexpr std::size_t pieces = 8;
/// What every point weighs besides its bend, as a part of the mean: long straight parts get some points, too.
constexpr double evenness = 0.01;

class Thinner {
public:
  explicit Thinner(const Path& path) : path_(path) {
    for (std::size_t c = 0; c < path.columns.size(); ++c) {
      double low = std::numeric_limits<double>::infinity(), high = -low;
      for (std::size_t k = 0; k < path.size; ++k) {
        low = std::min(low, value(c, k));
        high = std::max(high, value(c, k));
      }
      const double range = high - low;
      scales_.push_back(range > 0.0 && std::isfinite(range) ? 1.0 / range : 0.0);
    }
    weigh();
  }

  /// At most `points` points of first, …, last, with both of these.
  [[nodiscard]] std::vector<std::size_t> select(std::size_t first, std::size_t last, std::size_t points) const {
    std::vector<std::size_t> kept{first};
    const double density = density_of(first, last, static_cast<double>(points - 2));
    double due = 0.0;
    for (std::size_t k = first + 1; k < last; ++k) {
      due += std::min(1.0, density * weights_[k]);
      if (due >= 1.0) {
        kept.push_back(k);
        due -= 1.0;
      }
    }
    if (last > first) {
      kept.push_back(last);
    }
    return kept;
  }

  /// The largest distance of a point from the line that passes over it.
  [[nodiscard]] double deviation(const std::vector<std::size_t>& kept) const {
    double largest = 0.0;
    for (std::size_t i = 0; i + 1 < kept.size(); ++i) {
      for (std::size_t k = kept[i] + 1; k < kept[i + 1]; ++k) {
        largest = std::max(largest, squared_distance(kept[i], kept[i + 1], k));
      }
    }
    return std::sqrt(largest);
  }

private:
  [[nodiscard]] double value(std::size_t column, std::size_t k) const {
    return path_.columns[column][k * path_.strides[column]];
  }
  [[nodiscard]] double difference(std::size_t column, std::size_t a, std::size_t b) const {
    const double change = (value(column, a) - value(column, b)) * scales_[column];
    return std::isfinite(change) ? change : 0.0;
  }

  void weigh() {
    weights_.assign(path_.size, 0.0);
    double sum = 0.0;
    for (std::size_t k = 1; k + 1 < path_.size; ++k) {
      double bend = 0.0;
      for (std::size_t c = 0; c < scales_.size(); ++c) {
        const double second = difference(c, k + 1, k) - difference(c, k, k - 1);
        bend += second * second;
      }
      weights_[k] = std::sqrt(std::sqrt(bend));
      sum += weights_[k];
    }
    const double floor = sum > 0.0 ? evenness * sum / static_cast<double>(path_.size) : 1.0;
    std::ranges::for_each(weights_, [floor](double& weight) { weight += floor; });
  }

  /// c with Σ min(1, c w) = points, over the inner points.
  [[nodiscard]] double density_of(std::size_t first, std::size_t last, double points) const {
    double density = 0.0;
    for (int round = 0; round < 50; ++round) {
      double free = 0.0, taken = 0.0;
      for (std::size_t k = first + 1; k < last; ++k) {
        const bool is_taken = density * weights_[k] >= 1.0;
        taken += is_taken ? 1.0 : 0.0;
        free += is_taken ? 0.0 : weights_[k];
      }
      const double next = free > 0.0 ? (points - taken) / free : density;
      if (next <= density * (1.0 + 1e-9)) {
        break;
      }
      density = next;
    }
    return density;
  }

  [[nodiscard]] double squared_distance(std::size_t a, std::size_t b, std::size_t k) const {
    double length = 0.0, along = 0.0, whole = 0.0;
    for (std::size_t c = 0; c < scales_.size(); ++c) {
      const double line = difference(c, b, a), from = difference(c, k, a);
      length += line * line;
      along += line * from;
      whole += from * from;
    }
    const double part = length > 0.0 ? std::clamp(along / length, 0.0, 1.0) : 0.0;
    return std::max(0.0, whole - 2.0 * part * along + part * part * length);
  }

  const Path& path_;
  std::vector<double> scales_, weights_;
};

}  // namespace

PathSelection thin_path(const Path& path, std::size_t points) {
  PathSelection selection{.kept = {}, .starts = {0}};
  if (path.size <= points) {
    selection.kept.resize(path.size);
    std::iota(selection.kept.begin(), selection.kept.end(), std::size_t{0});
    return selection;
  }
  const Thinner thinner(path);
  selection.kept = thinner.select(0, path.size - 1, points);
  selection.deviation = thinner.deviation(selection.kept);
  if (selection.deviation <= enough) {
    return selection;
  }
  // Pieces of as many points as there is room for need no thinning; longer ones may do with it.
  const std::size_t room = points / pieces;
  PathSelection best;
  for (std::size_t length = room; length * pieces < path.size; length *= 2) {
    PathSelection next;
    for (std::size_t piece = 0; piece < pieces; ++piece) {
      const std::size_t first = piece * (path.size - length) / (pieces - 1);
      const std::vector<std::size_t> kept = thinner.select(first, first + length - 1, room);
      next.deviation = std::max(next.deviation, thinner.deviation(kept));
      next.starts.push_back(next.kept.size());
      next.kept.insert(next.kept.end(), kept.begin(), kept.end());
    }
    if (!best.kept.empty() && next.deviation > enough) {
      break;
    }
    best = std::move(next);
  }
  return best;
}

}  // namespace rubato::report
