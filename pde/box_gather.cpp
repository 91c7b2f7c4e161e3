#include <rubato/pde/box_gather.hpp>

#include <array>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/pde/cell_blocks.hpp>

namespace rubato {

namespace {

using Line = std::array<double, CellBlocks::most + 1>;

/// Nodes begin … begin + count of a line (count + 1 of them), the last one cyclically.
template <typename Use>
void for_each_node(std::size_t begin, std::size_t count, std::size_t n, Use&& use) {
  const std::size_t inner = begin + count == n ? count : count + 1;
  for (std::size_t i = 0; i < inner; ++i) {
    use(i, begin + i);
  }
  if (inner == count) {
    use(count, 0);
  }
}

/// Means and differences, as far as wanted, of nodes and of the nodes after them.
RUBATO_WIDE_VECTORS void combine(const double* nodes, std::size_t count, double inverse_spacing, double* mean,
                                 double* difference) {
  if (mean != nullptr) {
    for (std::size_t i = 0; i < count; ++i) {
      mean[i] = 0.5 * (nodes[i] + nodes[i + 1]);
    }
  }
  if (difference != nullptr) {
    for (std::size_t i = 0; i < count; ++i) {
      difference[i] = (nodes[i + 1] - nodes[i]) * inverse_spacing;
    }
  }
}

/// The two lines of nodes beside a line of cells, and what makes of them the line's nodes across y.
RUBATO_WIDE_VECTORS void combine_lines(const double* r0, const double* r1, std::size_t begin, std::size_t count,
                                       std::size_t n, double scale, double* mean, double* difference) {
  for_each_node(begin, count, n, [=](std::size_t i, std::size_t node) { mean[i] = 0.5 * (r0[node] + r1[node]); });
  for_each_node(begin, count, n,
                [=](std::size_t i, std::size_t node) { difference[i] = (r1[node] - r0[node]) * scale; });
}

}  // namespace

BoxGather::BoxGather(const grids::Grid& grid) : dimensions_(grid.dimensions()) {
  for (int a = 0; a < 3; ++a) {
    n_[a] = grid.cells(a);
    stride_[a] = a < dimensions_ ? grid.stride(a) : 0;
    inverse_spacing_[a] = a < dimensions_ ? 1.0 / grid.spacing(a) : 0.0;
  }
}

void BoxGather::operator()(const double* field, std::size_t line, std::size_t begin, std::size_t count, double* mean,
                           double* const* difference) const {
  const std::size_t j = line % n_[1];
  const std::size_t k = line / n_[1];
  const double* r00 = field + j * stride_[1] + k * stride_[2];
  const double* r10 = field + (j + 1 == n_[1] ? 0 : j + 1) * stride_[1] + k * stride_[2];
  if (dimensions_ == 1) {
    const bool at_seam = begin + count == n_[0];
    const std::size_t inner = at_seam ? count - 1 : count;
    combine(r00 + begin, inner, inverse_spacing_[0], mean, difference[0]);
    if (at_seam) {
      const double nodes[2] = {r00[n_[0] - 1], r00[0]};
      combine(nodes, 1, inverse_spacing_[0], mean != nullptr ? mean + inner : nullptr,
              difference[0] != nullptr ? difference[0] + inner : nullptr);
    }
    return;
  }
  Line a, b, c;
  if (dimensions_ == 2) {
    combine_lines(r00, r10, begin, count, n_[0], inverse_spacing_[1], a.data(), b.data());
  } else {
    const std::size_t k_next = k + 1 == n_[2] ? 0 : k + 1;
    const double* r01 = field + j * stride_[1] + k_next * stride_[2];
    const double* r11 = field + (j + 1 == n_[1] ? 0 : j + 1) * stride_[1] + k_next * stride_[2];
    const double scale_y = 0.5 * inverse_spacing_[1];
    const double scale_z = 0.5 * inverse_spacing_[2];
    for_each_node(begin, count, n_[0], [&](std::size_t i, std::size_t node) {
      a[i] = 0.25 * ((r00[node] + r10[node]) + (r01[node] + r11[node]));
      b[i] = ((r10[node] - r00[node]) + (r11[node] - r01[node])) * scale_y;
      c[i] = ((r01[node] - r00[node]) + (r11[node] - r10[node])) * scale_z;
    });
  }
  combine(a.data(), count, inverse_spacing_[0], mean, difference[0]);
  combine(b.data(), count, 0.0, difference[1], nullptr);
  if (dimensions_ > 2) {
    combine(c.data(), count, 0.0, difference[2], nullptr);
  }
}

}  // namespace rubato
