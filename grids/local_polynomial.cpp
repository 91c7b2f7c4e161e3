#include <rubato/grids/local_polynomial.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <rubato/grids/slab.hpp>

namespace rubato::grids {

namespace {

/// Twice as many make errors of smooth values smaller and those of rounding, near walls, a thousand times larger.
constexpr std::size_t most_nodes = 10;

/// The nodes near a place, which is counted in nodes.
struct NearNodes {
  std::size_t first = 0, count = 0;

  NearNodes(const Axis& axis, double place) : count(std::min(most_nodes, axis.whole_cells())) {
    const auto middle = std::llround(place - 0.5 * static_cast<double>(count - 1));
    first = static_cast<std::size_t>(std::clamp(middle, 0LL, static_cast<long long>(axis.whole_cells() - count)));
  }
};

/// Weights of the value and of the derivative at z of nodes 0, 1, … count-1: Fornberg's recurrence, nodes taken in one
/// after the other.
std::array<std::array<double, 2>, most_nodes> weights_of_both(std::size_t count, double z) {
  std::array<std::array<double, 2>, most_nodes> c{};
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
  return c;
}

}  // namespace

LocalWeights local_weights(const Axis& axis, double x, bool of_derivative) {
  const double place = (x - axis.from) / axis.spacing();
  const NearNodes near(axis, place);
  const auto both = weights_of_both(near.count, place - static_cast<double>(near.first));
  LocalWeights weights{near.first, std::vector<double>(near.count)};
  for (std::size_t j = 0; j < near.count; ++j) {
    weights.of[j] = of_derivative ? both[j][1] / axis.spacing() : both[j][0];
  }
  return weights;
}

void local_derivative(const Grid& grid, int axis, const double* in, double* out) {
  const Slab* const slab = Slab::of(grid);
  const std::size_t n = grid.cells(axis), stride = grid.stride(axis), all = grid.axis(axis).whole_cells();
  const double spacing = grid.spacing(axis);
  // Nodes with as many before them, of those that are near, have the same weights.
  std::array<std::array<double, most_nodes>, most_nodes> weights{};
  const std::size_t near = std::min(most_nodes, all);
  for (std::size_t at = 0; at < near; ++at) {
    const auto both = weights_of_both(near, static_cast<double>(at));
    std::ranges::transform(both, weights[at].begin(), [spacing](const auto& one) { return one[1] / spacing; });
  }
  // Along the axis that ranks share, with the nodes of neighbours that are near: node i of a line is i + before there.
  std::size_t first = 0, before = 0;
  FieldSet wide;
  if (slab != nullptr && axis + 1 == grid.dimensions()) {
    before = most_nodes;
    const Slab more = slab->with_ghosts({before, before});
    wide = FieldSet(1, more.size());
    std::copy_n(in, grid.size(), wide.field(0).begin() + static_cast<std::ptrdiff_t>(more.first_node()));
    more.refresh(wide);
    in = std::as_const(wide).field(0).data();
    first = slab->first_plane(slab->rank());
  }
  const std::size_t read = n + 2 * before;
  std::vector<double> line(read);
  for (std::size_t number = 0; number < grid.size() / n; ++number) {
    const std::size_t within = number % stride, block = number / stride * stride;
    for (std::size_t i = 0; i < read; ++i) {
      line[i] = in[block * read + within + i * stride];
    }
    for (std::size_t i = 0; i < n; ++i) {
      const NearNodes nodes(grid.axis(axis), static_cast<double>(first + i));
      double sum = 0.0;
      for (std::size_t j = 0; j < nodes.count; ++j) {
        sum += weights[first + i - nodes.first][j] * line[nodes.first + j + before - first];
      }
      out[block * n + within + i * stride] = sum;
    }
  }
}

}  // namespace rubato::grids
