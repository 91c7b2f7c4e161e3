#include <rubato/solve/cyclic_parts.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/core.h>

#include <rubato/solve/block_qr_reduction.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {

std::vector<std::size_t> cyclic_levels(int block, std::size_t cells) {
  const std::size_t per_chunk = tuning::cyclic_block::cells_per_chunk(block);
  std::vector<std::size_t> levels = {cells};
  while (levels.back() / per_chunk > 1) {
    levels.push_back(levels.back() / per_chunk);
  }
  return levels;
}

CyclicParts cyclic_parts(int block, std::size_t cells, int ranks) {
  const std::vector<std::size_t> levels = cyclic_levels(block, cells);
  const auto size = static_cast<std::size_t>(ranks);
  CyclicParts parts{.shared = 1, .first_cells = {}};
  if (levels.size() < 2 || levels[1] < size) {
    throw std::invalid_argument(
        fmt::format("{} ranks cannot share a line of {} cells: each has to have {} of them; start {}", ranks, cells,
                    tuning::cyclic_block::cells_per_chunk(block),
                    levels.size() < 2 ? "one" : fmt::format("{} at most", levels[1])));
  }
  while (parts.shared + 1 < levels.size() && levels[parts.shared + 1] >= tuning::cyclic_block::cells_of_rank * size) {
    ++parts.shared;
  }
  parts.first_cells.resize(parts.shared + 1);
  const std::size_t last = levels[parts.shared];
  for (std::size_t rank = 0; rank <= size; ++rank) {
    std::size_t cell = chunks::first_cell(last, size, rank);
    parts.first_cells[parts.shared].push_back(cell);
    for (std::size_t level = parts.shared; level-- > 0;) {
      cell = chunks::first_cell(levels[level], levels[level + 1], cell);
      parts.first_cells[level].push_back(cell);
    }
  }
  return parts;
}

}  // namespace rubato::solve
