#include <rubato/grids/weights.hpp>

#include <algorithm>

namespace rubato::grids {

void weigh(const Grid& grid, std::size_t first, std::span<double> values) {
  const Axis& axis = grid.axis(0);
  const std::size_t n = axis.cells;
  // Along a line these have the same weight.
  std::size_t inside = 0, end = n;
  if (axis.left != End::periodic) {
    const std::ptrdiff_t begins = axis.place(0), right = static_cast<std::ptrdiff_t>(axis.cell_count());
    inside = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(1 - begins, 0, static_cast<std::ptrdiff_t>(n)));
    end = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(right - begins, static_cast<std::ptrdiff_t>(inside),
                                                              static_cast<std::ptrdiff_t>(n)));
  }
  for (std::size_t begin = 0; begin < values.size();) {
    const std::size_t at = (first + begin) % n, line = first + begin - at;
    const auto part = values.subspan(begin, std::min(n - at, values.size() - begin));
    const double weight = inside < end ? grid.weight(line + inside) : 0.0;
    for (std::size_t i = 0; i < part.size(); ++i) {
      part[i] *= at + i >= inside && at + i < end ? weight : grid.weight(line + at + i);
    }
    begin += part.size();
  }
}

}  // namespace rubato::grids
