#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

namespace rubato::grids {

/// What an end of an axis is: where the next period begins, or a wall.
enum class End {
  periodic,
  fixed,  ///< values are held
  free    ///< values vary, and the boundary term of the variation vanishes
};

/// One direction. Periodic: nodes from + i Δx for i = 0 … cells-1, Δx = (to - from)/cells, and node `cells` is node 0.
/// Between walls: both ends are nodes, so that `cells` nodes have one cell less between them.
struct Axis {
  std::string name;
  double from = 0.0;
  double to = 1.0;
  std::size_t cells = 0;  ///< nodes
  /// Of a part of an axis: how many cells the whole has, and the number there of the first; 0 and 0 for a whole axis.
  std::size_t of = 0, first = 0;
  End left = End::periodic, right = End::periodic;  ///< both are walls, or none is
  /// Of a ring that repeats the space between walls in their mirrors: nodes between the walls, their distance included;
  /// 0 for others. Coordinates are those of the node or cell that is mirrored.
  std::size_t mirrored = 0;
  /// Of a ring with two walls in it: so many nodes beyond each wall are ghosts, which repeat the nodes within in a
  /// mirror. `from` and `to` are the walls, of which `left` and `right` are the kinds.
  std::size_t ghosts = 0;

  /// True if all nodes are between walls, those on the walls included.
  [[nodiscard]] bool has_walls() const { return left != End::periodic && ghosts == 0; }
  /// The nodes of the whole axis, and how many cells there are between its ends.
  ///@{
  [[nodiscard]] std::size_t whole_cells() const { return of == 0 ? cells : of; }
  [[nodiscard]] std::size_t cell_count() const {
    return whole_cells() - (left == End::periodic ? 0 : 1 + 2 * ghosts);  // both walls are nodes
  }
  ///@}
  /// How many cells node i is from that at `from`. Of an axis with walls, with ghosts or without, places beyond them
  /// are below 0 or above cell_count(), those of a part as well.
  [[nodiscard]] std::ptrdiff_t place(std::size_t i) const;
  /// Of an axis with walls: whether node i is beyond one, or on one, or on that one.
  ///@{
  [[nodiscard]] bool is_ghost(std::size_t i) const {
    return ghosts > 0 && (place(i) < 0 || place(i) > static_cast<std::ptrdiff_t>(cell_count()));
  }
  [[nodiscard]] bool is_on_wall(std::size_t i, bool is_right) const {
    return left != End::periodic && place(i) == (is_right ? static_cast<std::ptrdiff_t>(cell_count()) : 0);
  }
  [[nodiscard]] bool is_on_wall(std::size_t i) const { return is_on_wall(i, false) || is_on_wall(i, true); }
  ///@}
  /// The part of its cell that node i has in sums: one half on a wall, 0 of a ghost.
  [[nodiscard]] double weight(std::size_t i) const;
  [[nodiscard]] double length() const { return to - from; }
  [[nodiscard]] double spacing() const { return (to - from) / static_cast<double>(cell_count()); }
  [[nodiscard]] double node(std::size_t i) const { return from + folded(number(i)) * spacing(); }
  /// The upper end of cell i: that of the last one is `to`.
  [[nodiscard]] double upper(std::size_t i) const { return from + folded(number(i) + 1.0) * spacing(); }
  /// The middle of cell i, between nodes i and i + 1.
  [[nodiscard]] double centre(std::size_t i) const { return from + folded(number(i) + 0.5) * spacing(); }

private:
  [[nodiscard]] double number(std::size_t i) const { return static_cast<double>(place(i)); }
  [[nodiscard]] double folded(double place) const;
};

/// A grid in 1 to 3 dimensions, each direction periodic or between walls. Nodes are numbered with the first axis
/// fastest: node (i, j, k) of axes x, y, z is i + n_x (j + n_y k), so that an array of nodes is [z][y][x] in C order. A
/// periodic grid has as many cells as nodes; cell (i, j, k) has the node (i, j, k) as its lower corner and carries its
/// number.
class Grid {
public:
  /// Throws std::invalid_argument (naming axis and values) unless there are 1 to 3 axes with different names, from < to
  /// finite, at least 3 cells each (but of a part of an axis), and one field of all nodes fits into the memory
  /// that is available.
  explicit Grid(std::vector<Axis> axes);

  [[nodiscard]] int dimensions() const { return static_cast<int>(axes_.size()); }
  [[nodiscard]] const Axis& axis(int a) const { return axes_[a]; }
  [[nodiscard]] const std::vector<Axis>& axes() const { return axes_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  /// Cells along axis a; 1 for an axis beyond the last.
  [[nodiscard]] std::size_t cells(int a) const { return a < dimensions() ? axes_[a].cells : 1; }
  /// How far apart neighbours along axis a are in an array of nodes.
  [[nodiscard]] std::size_t stride(int a) const { return strides_[a]; }
  [[nodiscard]] double spacing(int a) const { return axes_[a].spacing(); }
  /// Δx Δy Δz.
  [[nodiscard]] double cell_volume() const;
  /// That of all cells.
  [[nodiscard]] double volume() const;
  [[nodiscard]] bool has_walls() const;
  [[nodiscard]] bool has_ghosts() const;
  /// The product of those along each axis.
  [[nodiscard]] double weight(std::size_t node) const;

  [[nodiscard]] std::size_t index(std::size_t i, std::size_t j = 0, std::size_t k = 0) const {
    return i + j * strides_[1] + k * strides_[2];
  }
  /// The place of a node along each axis.
  [[nodiscard]] std::array<std::size_t, 3> place(std::size_t node) const {
    return {node % cells(0), node / strides_[1] % cells(1), node / strides_[2]};
  }

private:
  std::vector<Axis> axes_;
  std::array<std::size_t, 3> strides_{};
  std::size_t size_ = 1;
};

/// Nodes that follow each other: [begin, end).
struct NodeRange {
  std::size_t begin = 0, end = 0;
};
/// The nodes of which is_meant(node) is true, in their order.
template <class IsMeant>
[[nodiscard]] std::vector<NodeRange> ranges_where(const Grid& grid, const IsMeant& is_meant) {
  std::vector<NodeRange> ranges;
  for (std::size_t node = 0; node < grid.size(); ++node) {
    if (!is_meant(node)) {
      continue;
    }
    if (!ranges.empty() && ranges.back().end == node) {
      ++ranges.back().end;
    } else {
      ranges.push_back({node, node + 1});
    }
  }
  return ranges;
}

}  // namespace rubato::grids
