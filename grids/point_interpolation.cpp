#include <rubato/grids/point_interpolation.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/grids/local_polynomial.hpp>
#include <rubato/grids/slab.hpp>

namespace rubato::grids {

namespace {

/// Dirichlet's kernel of n nodes at every node's distance from x, in units of the spacing: 1 at the node itself.
std::vector<double> kernel(const Axis& axis, double x) {
  const std::size_t cells = axis.whole_cells();
  const auto n = static_cast<double>(cells);
  const double place = (x - axis.from) / (axis.to - axis.from) * n;
  const double nearest = std::round(place);
  const double off = place - nearest;  // the node nearest to x is this far away
  std::vector<double> weights(cells);
  for (std::size_t j = 0; j < cells; ++j) {
    const double nodes = static_cast<double>(j) - nearest;
    if (off == 0.0) {
      weights[j] = std::fmod(nodes, n) == 0.0 ? 1.0 : 0.0;
      continue;
    }
    // sin(π(off - nodes)) without the rounding of a large argument
    const double sign = std::fmod(std::abs(nodes), 2.0) == 0.0 ? 1.0 : -1.0;
    const double angle = std::numbers::pi * (off - nodes) / n;
    const double wave = sign * std::sin(std::numbers::pi * off) / n;
    weights[j] = cells % 2 == 0 ? wave / std::tan(angle) : wave / std::sin(angle);
  }
  return weights;
}

}  // namespace

PointInterpolation::PointInterpolation(const Grid& grid, std::vector<double> coordinates)
    : coordinates_(std::move(coordinates)) {
  if (coordinates_.size() != static_cast<std::size_t>(grid.dimensions())) {
    throw std::invalid_argument(
        fmt::format("a point with {} coordinates on a grid of {} directions", coordinates_.size(), grid.dimensions()));
  }
  for (int a = 0; a < grid.dimensions(); ++a) {
    const Axis& axis = grid.axis(a);
    const double x = coordinates_[static_cast<std::size_t>(a)];
    if (axis.has_walls()) {
      const LocalWeights near = local_weights(axis, x);
      std::vector<double>& weights = weights_.emplace_back(axis.whole_cells(), 0.0);
      std::ranges::copy(near.of, weights.begin() + static_cast<std::ptrdiff_t>(near.first));
    } else {
      weights_.push_back(kernel(axis, x));
    }
  }
}

double PointInterpolation::operator()(std::span<const double> values) const {
  // x is fastest: each direction in turn is summed away, the last one from rank to rank.
  const Slab* const slab = Slab::of(values.size());
  if (slab != nullptr) {
    values = values.subspan(slab->first_node(), slab->owned());
  }
  std::vector<double> rest(values.begin(), values.end());
  for (std::size_t a = 0; a + 1 < weights_.size(); ++a) {
    const std::vector<double>& weights = weights_[a];
    std::vector<double> sums(rest.size() / weights.size(), 0.0);
    for (std::size_t i = 0; i < rest.size(); ++i) {
      sums[i / weights.size()] += weights[i % weights.size()] * rest[i];
    }
    rest = std::move(sums);
  }
  double sum = 0.0;
  const double* const weights = weights_.back().data() + (slab == nullptr ? 0 : slab->first_plane(slab->rank()));
  const auto add = [&] {
    for (std::size_t i = 0; i < rest.size(); ++i) {
      sum += weights[i] * rest[i];
    }
  };
  if (slab != nullptr) {
    slab->in_turn(std::span(&sum, 1), add);
  } else {
    add();
  }
  return sum;
}

}  // namespace rubato::grids
