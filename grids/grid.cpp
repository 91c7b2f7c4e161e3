#include <rubato/grids/grid.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/core.h>

#include <rubato/base/memory.hpp>

namespace rubato::grids {
namespace {

void check(const std::vector<Axis>& axes) {
  if (axes.empty() || axes.size() > 3) {
    throw std::invalid_argument(fmt::format("a grid has 1 to 3 axes, not {}", axes.size()));
  }
  double total = 1.0;
  for (std::size_t a = 0; a < axes.size(); ++a) {
    const Axis& axis = axes[a];
    if (!std::isfinite(axis.from) || !std::isfinite(axis.to) || !std::isfinite(axis.to - axis.from)) {
      throw std::invalid_argument(
          fmt::format("axis {}: the ends must be finite, not from = {}, to = {}", axis.name, axis.from, axis.to));
    }
    if (!(axis.from < axis.to)) {
      throw std::invalid_argument(
          fmt::format("axis {}: from = {} must be less than to = {}", axis.name, axis.from, axis.to));
    }
    if (axis.cells < 3 && axis.of == 0) {
      throw std::invalid_argument(fmt::format("axis {}: at least 3 cells are needed, not {}", axis.name, axis.cells));
    }
    if ((axis.left != End::periodic) != (axis.right != End::periodic)) {
      throw std::invalid_argument(fmt::format("axis {}: a wall at one end needs one at the other", axis.name));
    }
    if (axis.has_walls() && axis.whole_cells() < 4) {
      throw std::invalid_argument(fmt::format("axis {}: at least 3 cells are needed between walls", axis.name));
    }
    if (!(axis.from + axis.spacing() > axis.from)) {
      throw std::invalid_argument(fmt::format("axis {}: {} cells from {} to {} are closer than rounding", axis.name,
                                              axis.cells, axis.from, axis.to));
    }
    for (std::size_t b = 0; b < a; ++b) {
      if (axes[b].name == axis.name) {
        throw std::invalid_argument(fmt::format("two axes are named {}", axis.name));
      }
    }
    total *= static_cast<double>(axis.cells);
  }
  require_memory(total * static_cast<double>(sizeof(double)), fmt::format("a grid of {:.6g} nodes", total));
}

}  // namespace

std::ptrdiff_t Axis::place(std::size_t i) const {
  const auto at = static_cast<std::ptrdiff_t>(first + i) - static_cast<std::ptrdiff_t>(ghosts);
  if (of == 0) {
    return at;
  }
  const auto all = static_cast<std::ptrdiff_t>(of);
  if (left == End::periodic) {
    return at % all;
  }
  // A part that goes on beyond an end of the whole has more nodes within than beyond it.
  const bool begins_beyond = first + cells > of && 2 * (of - first) < cells;
  return begins_beyond ? at - all : at;
}

double Axis::folded(double place) const {
  if (mirrored == 0) {
    return place;
  }
  const double back = 2.0 * static_cast<double>(mirrored);
  const double rest = std::fmod(std::abs(place), back);
  return std::min(rest, back - rest);
}

Grid::Grid(std::vector<Axis> axes) : axes_(std::move(axes)) {
  check(axes_);
  for (int a = 0; a < 3; ++a) {
    strides_[a] = size_;
    size_ *= cells(a);
  }
}

double Grid::cell_volume() const {
  double volume = 1.0;
  for (const Axis& axis : axes_) {
    volume *= axis.spacing();
  }
  return volume;
}

double Grid::volume() const {
  std::size_t cells = 1;
  for (const Axis& axis : axes_) {
    cells *= axis.cell_count();
  }
  return cell_volume() * static_cast<double>(cells);
}

bool Grid::has_walls() const {
  return std::ranges::any_of(axes_, &Axis::has_walls);
}

bool Grid::has_ghosts() const {
  return std::ranges::any_of(axes_, [](const Axis& axis) { return axis.ghosts > 0; });
}

double Axis::weight(std::size_t i) const {
  if (left == End::periodic) {
    return 1.0;
  }
  const std::ptrdiff_t at = place(i), last = static_cast<std::ptrdiff_t>(cell_count());
  return at < 0 || at > last ? 0.0 : at == 0 || at == last ? 0.5 : 1.0;
}

double Grid::weight(std::size_t node) const {
  const auto at = place(node);
  double weight = 1.0;
  for (std::size_t a = 0; a < axes_.size(); ++a) {
    weight *= axes_[a].weight(at[a]);
  }
  return weight;
}

}  // namespace rubato::grids
