#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/grids/digit_sum.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/slab.hpp>

namespace rubato {

/// Where the batch evaluator's blocks of cells begin and end: pieces of at most 256 cells of one line along x.
/// A function of the grid alone, so that results do not depend on the number of threads.
struct CellBlocks {
  static constexpr std::size_t most = 256;
  std::size_t line = 0;      ///< cells in a line along x
  std::size_t lines = 0;     ///< n_y n_z
  std::size_t per_line = 0;  ///< blocks in a line
  explicit CellBlocks(const grids::Grid& grid)
      : line(grid.cells(0)), lines(grid.size() / line), per_line((line + most - 1) / most) {}
  [[nodiscard]] std::size_t count() const { return lines * per_line; }

  struct Block {
    std::size_t line = 0;
    std::size_t begin = 0, count = 0;  ///< cells of the line
    std::size_t offset = 0;            ///< of its first cell in an array of all
    /// Whether it is this rank's to tell what the block has in all: sums, and maxima of sums.
    bool is_told = true;
  };
  [[nodiscard]] Block operator[](std::size_t block) const {
    const std::size_t number = block / per_line, begin = block % per_line * most;
    return {number, begin, std::min(most, line - begin), number * line + begin};
  }
};

/// The same of a lattice that ranks share (grids::Slab). In a plane or in space blocks are those of the part, of which
/// a rank tells those in lines that it owns. Of a line they are the blocks of the whole line in which a rank has cells:
/// those that begin with a cell that it owns, whole, with some cells of the next rank; and of one that begins before,
/// and is told by the rank before, what it owns.
class SharedCellBlocks : public CellBlocks {
public:
  /// \param share_line false for a line that is shared in another way, and sees its part as a grid like any other
  explicit SharedCellBlocks(const grids::Grid& grid, bool share_line = true);
  [[nodiscard]] std::size_t count() const { return line_slab_ != nullptr ? parts_.size() : CellBlocks::count(); }
  [[nodiscard]] Block operator[](std::size_t block) const {
    if (line_slab_ != nullptr) {
      return parts_[block];
    }
    Block result = CellBlocks::operator[](block);
    result.is_told = slab_ == nullptr || (result.line >= first_line_ && result.line < end_line_);
    return result;
  }
  /// For what is made of blocks one after the other: calls add(), with a slab of a line at one rank after the other,
  /// where `numbers` go on from rank to rank (grids::Slab::in_turn).
  void in_turn(std::span<double> numbers, const std::function<void()>& add) const;
  /// What the blocks of all ranks come to, the same at every rank: sums[r] = Σ sum_of(block, r), and the largest
  /// largest[r] of largest_of(block, r) >= 0, NaN left out. Of one process, and of a line, sums are compensated, in the
  /// order of the blocks; in a plane or in space on ranks they are DigitSums, which have no order.
  template <class SumOf, class LargestOf>
  void total(std::span<double> sums, const SumOf& sum_of, std::span<double> largest, const LargestOf& largest_of) const;
  template <class SumOf>
  void total(std::span<double> sums, const SumOf& sum_of) const {
    total(sums, sum_of, {}, [](std::size_t, std::size_t) { return 0.0; });
  }
  /// How many cells and blocks all ranks have.
  ///@{
  [[nodiscard]] std::size_t whole_cells() const { return slab_ != nullptr ? slab_->whole().size() : line * lines; }
  [[nodiscard]] std::size_t whole_count() const {
    return slab_ != nullptr ? CellBlocks(slab_->whole()).count() : count();
  }
  ///@}
  /// Whether it is a line that ranks share, and blocks are those of the whole.
  [[nodiscard]] bool are_of_whole() const { return line_slab_ != nullptr; }

private:
  template <class LargestOf>
  void add_largest(std::span<double> largest, const LargestOf& largest_of, std::size_t block) const {
    for (std::size_t r = 0; r < largest.size(); ++r) {
      largest[r] = std::max(largest[r], largest_of(block, r));
    }
  }

  const grids::Slab* slab_ = nullptr;
  const grids::Slab* line_slab_ = nullptr;  ///< the same of a line
  std::size_t first_line_ = 0, end_line_ = 0;
  std::vector<Block> parts_;
  // Of total(): Σ, compensated, and maxima; and sums without an order.
  mutable std::vector<double> numbers_;
  mutable std::vector<grids::DigitSum> digits_;
};

template <class SumOf, class LargestOf>
void SharedCellBlocks::total(std::span<double> sums, const SumOf& sum_of, std::span<double> largest,
                             const LargestOf& largest_of) const {
  std::ranges::fill(largest, 0.0);
  if (slab_ != nullptr && line_slab_ == nullptr) {
    digits_.assign(sums.size(), grids::DigitSum());
    for (std::size_t block = 0; block < count(); ++block) {
      if (!(*this)[block].is_told) {
        continue;
      }
      for (std::size_t r = 0; r < sums.size(); ++r) {
        const double term = sum_of(block, r);
        digits_[r].add(std::span(&term, 1));
      }
      add_largest(largest, largest_of, block);
    }
    slab_->reduce(digits_, sums, largest);
    return;
  }
  numbers_.assign(2 * sums.size() + largest.size(), 0.0);
  const auto numbers = std::span(numbers_), maxima = numbers.subspan(2 * sums.size());
  const auto add = [&] {
    for (std::size_t block = 0; block < count(); ++block) {
      if (!(*this)[block].is_told) {
        continue;
      }
      for (std::size_t r = 0; r < sums.size(); ++r) {
        CompensatedSum sum(numbers[2 * r], numbers[2 * r + 1]);
        sum.add(sum_of(block, r));
        numbers[2 * r] = sum.high;
        numbers[2 * r + 1] = sum.low;
      }
      add_largest(maxima, largest_of, block);
    }
  };
  in_turn(numbers, std::ref(add));  // which a std::function holds without memory of its own
  for (std::size_t r = 0; r < sums.size(); ++r) {
    sums[r] = CompensatedSum(numbers[2 * r], numbers[2 * r + 1]).value();
  }
  std::ranges::copy(maxima, largest.begin());
}

}  // namespace rubato
