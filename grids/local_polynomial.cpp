#include <rubato/grids/local_polynomial.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace rubato::grids {

namespace {

/// Twice as many make errors of smooth values smaller and those of rounding, near walls, a thousand times larger.
constexpr std::size_t most_nodes = 10;

}  // namespace

LocalWeights local_weights(const Axis& axis, double x, bool of_derivative) {
  const std::size_t count = std::min(most_nodes, axis.cells);
  const double place = (x - axis.from) / axis.spacing();
  const auto middle = std::llround(place - 0.5 * static_cast<double>(count - 1));
  const auto last = static_cast<long long>(axis.cells - count);
  LocalWeights weights{static_cast<std::size_t>(std::clamp(middle, 0LL, last)), std::vector<double>(count, 0.0)};
  // Fornberg's recurrence for the value and the first derivative, nodes taken in one after the other.
  std::vector<std::array<double, 2>> c(count, {0.0, 0.0});
  const double z = place - static_cast<double>(weights.first);
  c[0][0] = 1.0;
  double c1 = 1.0;
  for (std::size_t n = 1; n < count; ++n) {
    const double before = static_cast<double>(n - 1) - z, here = static_cast<double>(n) - z;
    double c2 = 1.0;
    for (std::size_t j = 0; j < n; ++j) {
      const double c3 = static_cast<double>(n) - static_cast<double>(j);
      c2 *= c3;
      if (j + 1 == n) {
        c[n][1] = c1 * (c[n - 1][0] - before * c[n - 1][1]) / c2;
        c[n][0] = -c1 * before * c[n - 1][0] / c2;
      }
      c[j][1] = (here * c[j][1] - c[j][0]) / c3;
      c[j][0] *= here / c3;
    }
    c1 = c2;
  }
  for (std::size_t j = 0; j < count; ++j) {
    weights.of[j] = of_derivative ? c[j][1] / axis.spacing() : c[j][0];
  }
  return weights;
}

void local_derivative(const Grid& grid, int axis, const double* in, double* out) {
  const std::size_t n = grid.cells(axis), stride = grid.stride(axis);
  std::vector<LocalWeights> weights;
  for (std::size_t i = 0; i < n; ++i) {
    weights.push_back(local_weights(grid.axis(axis), grid.axis(axis).node(i), true));
  }
  std::vector<double> line(n);
  for (std::size_t number = 0; number < grid.size() / n; ++number) {
    const std::size_t first = number % stride + number / stride * stride * n;
    for (std::size_t i = 0; i < n; ++i) {
      line[i] = in[first + i * stride];
    }
    for (std::size_t i = 0; i < n; ++i) {
      double sum = 0.0;
      for (std::size_t j = 0; j < weights[i].of.size(); ++j) {
        sum += weights[i].of[j] * line[weights[i].first + j];
      }
      out[first + i * stride] = sum;
    }
  }
}

}  // namespace rubato::grids
