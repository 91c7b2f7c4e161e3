#include <rubato/grids/point_interpolation.hpp>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

namespace rubato::grids {

namespace {

/// Dirichlet's kernel of n nodes at every node's distance from x, in units of the spacing: 1 at the node itself.
std::vector<double> kernel(const Axis& axis, double x) {
  const auto n = static_cast<double>(axis.cells);
  const double place = (x - axis.from) / (axis.to - axis.from) * n;
  const double nearest = std::round(place);
  const double off = place - nearest;  // the node nearest to x is this far away
  std::vector<double> weights(axis.cells);
  for (std::size_t j = 0; j < axis.cells; ++j) {
    const double nodes = static_cast<double>(j) - nearest;
    if (off == 0.0) {
      weights[j] = std::fmod(nodes, n) == 0.0 ? 1.0 : 0.0;
      continue;
    }
    // sin(π(off - nodes)) without the rounding of a large argument
    const double sign = std::fmod(std::abs(nodes), 2.0) == 0.0 ? 1.0 : -1.0;
    const double angle = std::numbers::pi * (off - nodes) / n;
    const double wave = sign * std::sin(std::numbers::pi * off) / n;
    weights[j] = axis.cells % 2 == 0 ? wave / std::tan(angle) : wave / std::sin(angle);
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
    weights_.push_back(kernel(grid.axis(a), coordinates_[static_cast<std::size_t>(a)]));
  }
}

double PointInterpolation::operator()(std::span<const double> values) const {
  // x is fastest: each direction in turn is summed away.
  std::vector<double> rest(values.begin(), values.end());
  for (const std::vector<double>& weights : weights_) {
    std::vector<double> sums(rest.size() / weights.size(), 0.0);
    for (std::size_t i = 0; i < rest.size(); ++i) {
      sums[i / weights.size()] += weights[i % weights.size()] * rest[i];
    }
    rest = std::move(sums);
  }
  return rest.front();
}

}  // namespace rubato::grids
