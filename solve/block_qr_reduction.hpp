#pragma once

// Internal to the cyclic block solver: what one chunk of cells does, for several chunks at once, one in each SIMD lane.

#include <cstddef>
#include <span>

#include <rubato/solve/cyclic_block.hpp>

namespace rubato::solve::chunks {

/// Sizes of one cyclic system. A cell's record holds, all blocks column by column:
/// L, R (d × d), X = [B | r] (d × extras), C of its first node and C left on its last node (k × d each, by field), and
/// its share of the border equations [D | s] (k × extras).
struct Shape {
  int d = 0;        ///< block
  int borders = 0;  ///< k
  int columns = 0;  ///< right-hand sides

  [[nodiscard]] int extras() const { return borders + columns; }
  [[nodiscard]] int right() const { return d * d; }
  [[nodiscard]] int extra() const { return 2 * d * d; }
  [[nodiscard]] int first_row() const { return extra() + d * extras(); }
  [[nodiscard]] int last_row() const { return first_row() + borders * d; }
  [[nodiscard]] int share() const { return last_row() + borders * d; }
  [[nodiscard]] int record() const { return share() + borders * extras(); }
  /// What the way back needs of one eliminated node: U, G, R (d × d) and X (d × extras).
  [[nodiscard]] int slot() const { return d * (3 * d + extras()); }
};

/// The first cell of a chunk: chunks differ by at most one cell; the longer ones come first.
[[nodiscard]] inline std::size_t first_cell(std::size_t cells, std::size_t chunks, std::size_t chunk) {
  const std::size_t longer = cells % chunks;
  return chunk * (cells / chunks) + (chunk < longer ? chunk : longer);
}

/// What one of several ranks has of a system: some chunks, in arrays that begin with the first of them.
struct Part {
  std::size_t first_chunk = 0;
  std::size_t chunks = 0;
  std::size_t first_cell = 0;
  const double* before = nullptr;  ///< the record before the first, where there are records
};

/// The system of one level: the user's (matrix != nullptr) or stored records.
struct System {
  Shape shape;
  std::size_t cells = 0;
  std::size_t chunks = 0;
  const CyclicBidiagonal* matrix = nullptr;
  const CyclicBorder* border = nullptr;
  std::span<const double* const> rhs;
  const double* records = nullptr;
  const Part* part = nullptr;  ///< null: all of it is here

  /// In the arrays that are here.
  [[nodiscard]] std::size_t first_cell(std::size_t chunk) const {
    return chunks::first_cell(cells, chunks, chunk) - (part == nullptr ? 0 : part->first_cell);
  }
  /// The chunks that are here.
  ///@{
  [[nodiscard]] std::size_t first_chunk() const { return part == nullptr ? 0 : part->first_chunk; }
  [[nodiscard]] std::size_t end_chunk() const { return part == nullptr ? chunks : part->first_chunk + part->chunks; }
  ///@}
};

/// Where pass two finds the solution at the chunks' first nodes, and where it puts that of all nodes: either the user's
/// arrays or an array of nodes × columns × d.
struct Solution {
  const double* separators = nullptr;  ///< chunks × columns × d; of a part that of the chunk behind it as well
  const double* border = nullptr;      ///< columns × k
  std::span<double* const> fields;
  double* nodes = nullptr;
};

/// Doubles of workspace for chunks of at most `cells_per_chunk` cells, for any kernel; to be aligned to 64 bytes.
inline std::size_t workspace_size(const Shape& shape, std::size_t cells_per_chunk) {
  constexpr std::size_t widest = 8;
  return widest * (3 * static_cast<std::size_t>(shape.record()) + cells_per_chunk * shape.slot() +
                   4 * static_cast<std::size_t>(shape.d + 1) * shape.extras());
}

/// The two passes over a group of `lanes` chunks that begins with chunk `first` (base/lanes.hpp). A chunk's results do
/// not depend on the chunks beside it, nor on their number.
///@{
/// Eliminates the interior nodes; the records of the reduced cells go to reduced[chunk · record], a part's chunks
/// counted from its first.
void reduce(int lanes, const System& system, std::size_t first, double* workspace, double* reduced);
/// Repeats that and computes the interior nodes from the chunk's ends.
void expand(int lanes, const System& system, std::size_t first, double* workspace, const Solution& solution);
///@}

}  // namespace rubato::solve::chunks
