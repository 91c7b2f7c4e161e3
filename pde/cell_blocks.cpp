#include <rubato/pde/cell_blocks.hpp>

namespace rubato {

SharedCellBlocks::SharedCellBlocks(const grids::Grid& grid, bool share_line)
    : CellBlocks(grid), slab_(grids::Slab::of(grid)) {
  if (slab_ == nullptr) {
    return;
  }
  if (grid.dimensions() > 1) {
    first_line_ = slab_->first_node() / line;
    end_line_ = first_line_ + slab_->owned() / line;
    return;
  }
  if (!share_line) {
    slab_ = nullptr;
    return;
  }
  line_slab_ = slab_;
  const std::size_t first = slab_->number_of_first(), end = first + slab_->owned(), cells = whole_cells();
  for (std::size_t cell = first; cell < end;) {
    const std::size_t next = std::min(cell / most * most + most, cells);
    const bool is_told = cell % most == 0;
    const std::size_t here = slab_->first_node() + cell - first;
    parts_.push_back({0, here, (is_told ? next : std::min(next, end)) - cell, here, is_told});
    cell = next;
  }
}

void SharedCellBlocks::in_turn(std::span<double> numbers, const std::function<void()>& add) const {
  if (line_slab_ == nullptr) {
    add();
  } else {
    line_slab_->in_turn(numbers, add);
  }
}

}  // namespace rubato
