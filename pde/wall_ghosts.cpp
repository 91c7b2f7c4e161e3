#include <rubato/pde/wall_ghosts.hpp>

namespace rubato {

WallGhosts::WallGhosts(const FieldMirrors& mirrors, const grids::Grid& grid)
    : mirrors_(mirrors),
      grid_(grid),
      ranges_(grids::ranges_where(grid, [&](std::size_t node) { return grid.weight(node) < 1.0; })) {}

void WallGhosts::renew(int field, std::span<double> values) const {
  for (int a = 0; a < grid_.dimensions(); ++a) {
    const grids::Axis& axis = grid_.axis(a);
    if (axis.ghosts == 0) {
      continue;
    }
    const std::ptrdiff_t first = axis.place(0), end = first + static_cast<std::ptrdiff_t>(axis.cells);
    const auto last = static_cast<std::ptrdiff_t>(axis.cell_count());
    const auto block = static_cast<std::ptrdiff_t>(grid_.stride(a));
    const int shift = mirrors_.offset(a, field);
    // Places are counted from the left wall; `at` is the wall's.
    const auto mirror = [&](double* line, std::ptrdiff_t from, std::ptrdiff_t to, std::ptrdiff_t at, bool is_even) {
      const double* const source = line + (from - first) * block;
      const double* const held = line + (at - first) * block;
      double* const target = line + (to - first) * block;
      for (std::ptrdiff_t i = 0; i < block; ++i) {
        target[i] = is_even ? source[i] : shift == 0 ? 2.0 * held[i] - source[i] : -source[i];
      }
    };
    const bool left_even = mirrors_.sign(a, field, axis.left) > 0, right_even = mirrors_.sign(a, field, axis.right) > 0;
    const std::size_t line = grid_.stride(a) * axis.cells;
    for (std::size_t begin = 0; begin < values.size(); begin += line) {
      double* const at = values.data() + begin;
      // A value at a node, half a cell after it or before it has its mirror image so many places further.
      for (std::ptrdiff_t to = shift < 0 ? 0 : -1; to >= first; --to) {
        mirror(at, -shift - to, to, 0, left_even);
      }
      for (std::ptrdiff_t to = shift > 0 ? last : last + 1; to < end; ++to) {
        mirror(at, 2 * last - shift - to, to, last, right_even);
      }
    }
  }
}

}  // namespace rubato
