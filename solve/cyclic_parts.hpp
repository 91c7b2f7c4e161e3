#pragma once

#include <cstddef>
#include <vector>

namespace rubato::solve {

/// How many cells there are at each level of CyclicBlockSolver's elimination, the user's first; the last level is one
/// chunk.
[[nodiscard]] std::vector<std::size_t> cyclic_levels(int block, std::size_t cells);

/// The parts of ranks that share a cyclic system: so many consecutive chunks of the first `shared` levels, which each
/// rank eliminates on its own. What is left of them all is one system, that of level `shared`.
struct CyclicParts {
  std::size_t shared = 0;
  /// [level][rank] of levels 0 … shared: the first cell of a rank's part, and behind the last rank's how many there
  /// are.
  std::vector<std::vector<std::size_t>> first_cells;
};

/// Parts of as many levels as leave every rank sixteen cells of the last of them, so that parts differ by a sixteenth
/// at most; of one level where that cannot be. \throws std::invalid_argument if there are fewer chunks than ranks
[[nodiscard]] CyclicParts cyclic_parts(int block, std::size_t cells, int ranks);

}  // namespace rubato::solve
