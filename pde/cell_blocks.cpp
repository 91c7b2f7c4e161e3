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
    const std::size_t begin = cell / most * most, next = std::min(begin + most, cells);
    const std::size_t here = slab_->first_node() + cell - first;
    parts_.push_back({0, here, std::min(next, end) - cell, here, cell - begin, next - begin});
    cell += parts_.back().count;
  }
}

void SharedCellBlocks::in_turn(std::span<double> numbers, const std::function<void()>& add) const {
  pass_along(numbers, add);
  share(numbers);
}

void SharedCellBlocks::pass_along(std::span<double> numbers, const std::function<void()>& add) const {
  if (line_slab_ == nullptr) {
    add();
  } else {
    line_slab_->pass_along(numbers, add);
  }
}

void SharedCellBlocks::share(std::span<double> numbers) const {
  if (line_slab_ != nullptr) {
    line_slab_->broadcast(numbers, line_slab_->ranks() - 1);
  }
}

}  // namespace rubato
