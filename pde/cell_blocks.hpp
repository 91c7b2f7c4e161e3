#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/slab.hpp>

namespace rubato {

/// Where the batch evaluator's blocks of cells begin and end: pieces of at most 256 cells of one line along x, which
/// between walls has one cell less than nodes.
/// A function of the grid alone, so that results do not depend on the number of threads.
struct CellBlocks {
  static constexpr std::size_t most = 256;
  std::size_t line = 0;      ///< cells in a line along x
  std::size_t lines = 0;     ///< n_y n_z
  std::size_t per_line = 0;  ///< blocks in a line
  explicit CellBlocks(const grids::Grid& grid)
      : line(grid.axis(0).has_walls() ? grid.axis(0).cell_count() : grid.cells(0)),
        lines(grid.size() / grid.cells(0)),
        per_line((line + most - 1) / most) {}
  [[nodiscard]] std::size_t count() const { return lines * per_line; }

  struct Block {
    std::size_t line = 0;
    std::size_t begin = 0, count = 0;  ///< cells of the line
    std::size_t offset = 0;            ///< of its first cell in an array of all
    /// Of a piece of a block: the place of its first cell in the block, and how many cells that has.
    std::size_t place = 0, whole = 0;
    /// True if it is this rank's to show what the block has in all: sums, and maxima of sums.
    bool is_reported = true;
    [[nodiscard]] bool begins() const { return place == 0; }
    [[nodiscard]] bool ends() const { return place + count == whole; }
    [[nodiscard]] bool is_piece() const { return count < whole; }
  };
  [[nodiscard]] Block operator[](std::size_t block) const {
    const std::size_t number = block / per_line, begin = block % per_line * most;
    const std::size_t cells = std::min(most, line - begin);
    return {number, begin, cells, number * line + begin, 0, cells};
  }
};

/// The same of a lattice that ranks share (grids::Slab). In a plane or in space blocks are those of the part, of which
/// a rank shows those in lines that it owns. Of a line they are what a rank owns of the blocks of the whole line: the
/// first and the last may be pieces, whose sums go on from rank to rank in the order of their cells.
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
    result.is_reported = slab_ == nullptr || (result.line >= first_line_ && result.line < end_line_);
    return result;
  }
  /// For what is made of cells one after the other: calls add(), with a slab of a line at one rank after the other,
  /// where `numbers` go on from rank to rank (grids::Slab::in_turn).
  void in_turn(std::span<double> numbers, const std::function<void()>& add) const;
  /// What is made of blocks one after the other, of a line of all ranks: numbers that begin with 0, to which add(block,
  /// numbers) adds. Of a piece go_on(block, carried) is called before, which goes on from the `carried` numbers that
  /// the cells of the block before it left, 0 for the first. The last rank alone has what comes of it: see show(). It
  /// lives until the next call.
  template <class GoOn, class Add>
  std::span<double> add_up(std::size_t numbers, std::size_t carried, const GoOn& go_on, const Add& add) const;
  void share(std::span<double> numbers) const;  ///< the last rank's, to all
  /// What the blocks of all ranks come to, the same at every rank: sums[r] = Σ sum_of(block, r), and the largest
  /// largest[r] of largest_of(block, r) >= 0, NaN left out. Pieces are gone on from as in add_up(); sum_of() is asked
  /// where a block ends, largest_of() of each piece. Sums are compensated, in the order of the blocks; in a plane or in
  /// space each rank adds up its own.
  template <class GoOn, class SumOf, class LargestOf>
  void total(std::size_t carried, const GoOn& go_on, std::span<double> sums, const SumOf& sum_of,
             std::span<double> largest, const LargestOf& largest_of) const;
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
  void pass_along(std::span<double> numbers, const std::function<void()>& add) const;

  const grids::Slab* slab_ = nullptr;
  const grids::Slab* line_slab_ = nullptr;  ///< the same of a line
  std::size_t first_line_ = 0, end_line_ = 0;
  std::vector<Block> parts_;
  // What goes on from block to block, and from rank to rank; and sums of this rank.
  mutable std::vector<double> numbers_;
  mutable std::vector<CompensatedSum> sums_;
};

template <class GoOn, class Add>
std::span<double> SharedCellBlocks::add_up(std::size_t numbers, std::size_t carried, const GoOn& go_on,
                                           const Add& add) const {
  numbers_.assign(numbers + (are_of_whole() ? carried : 0), 0.0);
  const auto reported = std::span(numbers_).first(numbers), carry = std::span(numbers_).subspan(numbers);
  const auto add_all = [&] {
    for (std::size_t block = 0; block < count(); ++block) {
      const Block at = (*this)[block];
      if (at.is_piece()) {
        if (at.begins()) {
          std::ranges::fill(carry, 0.0);
        }
        go_on(block, carry);
      }
      if (at.is_reported) {
        add(block, reported);
      }
    }
  };
  pass_along(numbers_, std::ref(add_all));  // which a std::function holds without memory of its own
  return reported;
}

template <class GoOn, class SumOf, class LargestOf>
void SharedCellBlocks::total(std::size_t carried, const GoOn& go_on, std::span<double> sums, const SumOf& sum_of,
                             std::span<double> largest, const LargestOf& largest_of) const {
  const auto add_largest = [&largest_of](std::span<double> to, std::size_t block) {
    for (std::size_t r = 0; r < to.size(); ++r) {
      to[r] = std::max(to[r], largest_of(block, r));
    }
  };
  if (slab_ != nullptr && line_slab_ == nullptr) {
    std::ranges::fill(largest, 0.0);
    sums_.assign(sums.size(), CompensatedSum());
    for (std::size_t block = 0; block < count(); ++block) {
      if (!(*this)[block].is_reported) {
        continue;
      }
      for (std::size_t r = 0; r < sums.size(); ++r) {
        sums_[r].add(sum_of(block, r));
      }
      add_largest(largest, block);
    }
    slab_->reduce(sums_, sums, largest);
    return;
  }
  // Maxima, then sums: of these two numbers are added up, and one is reported.
  const std::size_t maxima = largest.size();
  const std::span<double> all =
      add_up(maxima + 2 * sums.size(), carried, go_on, [&](std::size_t block, std::span<double> numbers) {
        add_largest(numbers.first(maxima), block);
        for (std::size_t r = 0; (*this)[block].ends() && r < sums.size(); ++r) {
          const auto both = numbers.subspan(maxima + 2 * r, 2);
          CompensatedSum sum(both[0], both[1]);
          sum.add(sum_of(block, r));
          both[0] = sum.high;
          both[1] = sum.low;
        }
      });
  for (std::size_t r = 0; r < sums.size(); ++r) {
    all[maxima + r] = CompensatedSum(all[maxima + 2 * r], all[maxima + 2 * r + 1]).value();
  }
  const auto reported = all.first(maxima + sums.size());
  share(reported);
  std::ranges::copy(reported.first(maxima), largest.begin());
  std::ranges::copy(reported.subspan(maxima), sums.begin());
}

}  // namespace rubato
