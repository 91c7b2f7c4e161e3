#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <iterator>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/cell_sweep.hpp>

namespace rubato {

/// The waves on which every derivative of a grid vanishes: the constant and, where derivatives are spectral, the
/// sawtooths (-1)^i of directions with an even number of cells (∂ of the Nyquist mode is 0). What the kernel of a
/// linear system is on the constant, it is on each of them.
///
/// A direction y or z is free if the kernel's vectors may vary along it: each index along it is then a group of lines
/// of its own, and no sawtooth along it need be looked at. Of a slab's grid lines are those of the part, and waves
/// those of the whole lattice.
class StillWaves {
public:
  StillWaves(const grids::Grid& grid, Collocation collocation, const std::array<bool, 2>& free)
      : ny_(grid.cells(1)), free_(free), end_line_(grid.size() / grid.cells(0)) {
    const grids::Grid& whole = grids::whole_of(grid);
    if (const grids::Slab* const slab = grids::Slab::of(grid); slab != nullptr && grid.dimensions() > 1) {
      const auto across = static_cast<std::size_t>(grid.dimensions() - 1);
      const std::size_t plane = whole.stride(grid.dimensions() - 1);
      first_line_ = slab->first_node() / grid.cells(0);
      end_line_ = first_line_ + slab->owned() / grid.cells(0);
      first_plane_.at(across - 1) =
          (slab->number_of_first() + whole.size() - slab->first_node()) / plane % whole.cells(grid.dimensions() - 1);
      shared_ = free.at(across - 1) ? nullptr : slab;
    }
    members_ = whole.size() / ((free[0] ? whole.cells(1) : 1) * (free[1] ? whole.cells(2) : 1));
    for (int a = 0; collocation == Collocation::nodes && a < grid.dimensions(); ++a) {
      if (whole.cells(a) % 2 == 0 && !(a > 0 && free[static_cast<std::size_t>(a) - 1])) {
        for (std::size_t i = 0, count = patterns_.size(); i < count; ++i) {
          patterns_.push_back(patterns_[i] | 1U << static_cast<unsigned>(a));
        }
      }
    }
  }

  /// One bit for each direction in which the wave alternates; the first is the constant.
  [[nodiscard]] const std::vector<unsigned>& patterns() const { return patterns_; }
  [[nodiscard]] static bool alternates_along_x(unsigned pattern) { return (pattern & 1U) != 0; }

  /// The group of line j + n_y k of nodes along x.
  [[nodiscard]] std::size_t group_of(std::size_t line) const {
    const std::size_t j = line % ny_;
    const std::size_t k = line / ny_;
    return (free_[0] ? j : 0) + (free_[1] ? k * (free_[0] ? ny_ : 1) : 0);
  }
  /// How many nodes a group has, of all ranks.
  [[nodiscard]] std::size_t members() const { return members_; }
  /// Adds up what the ranks have over whose lines groups go: sums[group·numbers + i], of those of this rank.
  void add_ranks(std::span<double> sums, std::size_t numbers) const {
    if (shared_ == nullptr) {
      return;
    }
    const auto some = sums.first(numbers * (free_[0] ? ny_ : 1));  // the groups of a plane
    std::vector<CompensatedSum> of_ranks;
    std::ranges::transform(some, std::back_inserter(of_ranks), [](double sum) { return CompensatedSum(sum); });
    shared_->reduce(of_ranks, some, {});
  }
  [[nodiscard]] bool owns(std::size_t line) const { return line >= first_line_ && line < end_line_; }
  /// The wave at the first node of that line.
  [[nodiscard]] double sign_of(unsigned pattern, std::size_t line) const {
    const std::size_t flips = ((pattern & 2U) != 0 ? first_plane_[0] + line % ny_ : 0) +
                              ((pattern & 4U) != 0 ? first_plane_[1] + line / ny_ : 0);
    return flips % 2 == 0 ? 1.0 : -1.0;
  }

private:
  std::size_t ny_;
  std::array<bool, 2> free_;
  std::size_t first_line_ = 0, end_line_;     ///< owned
  std::array<std::size_t, 2> first_plane_{};  ///< along y and z, of the grid's first
  std::size_t members_ = 0;
  const grids::Slab* shared_ = nullptr;  ///< of the ranks over whose lines groups go; null for this one's alone
  std::vector<unsigned> patterns_{0};
};

}  // namespace rubato
