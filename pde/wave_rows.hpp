#pragma once

#include <algorithm>
#include <array>
#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/state.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/wave_loops.hpp>

namespace rubato {

/// One complex number for each wave of a grid (in the order of grids::Fourier) and row: real and imaginary parts apart,
/// as vector units like them.
struct WaveRows {
  grids::FieldSet re, im;

  WaveRows() = default;
  WaveRows(int rows, std::size_t waves) : re(rows, waves), im(rows, waves) {}
  [[nodiscard]] int rows() const { return re.fields(); }
  [[nodiscard]] std::size_t waves() const { return re.size(); }
};

/// Waves that are worked on at once: arrays of them stay in the cache.
inline constexpr std::size_t wave_block = 128;
/// The real and imaginary parts of such a block.
struct WaveBlock {
  alignas(64) double re[wave_block];
  alignas(64) double im[wave_block];
  void clear(std::size_t count) {
    std::fill_n(re, count, 0.0);
    std::fill_n(im, count, 0.0);
  }
};
/// Calls f(begin, end) for blocks of waves, eight of them by one thread: a few waves are not worth waking another.
template <typename F>
void for_each_wave_block(std::size_t waves, F&& f) {
  grids::for_each_block(waves, 8 * wave_block, [&](std::size_t begin, std::size_t end) {
    for (std::size_t first = begin; first < end; first += wave_block) {
      f(first, std::min(first + wave_block, end));
    }
  });
}

/// Sums that are the same for every number of threads: of what add(begin, end, sum) adds for pieces of `count` numbers.
template <typename Add>
CompensatedSum sum_of_pieces(std::size_t count, const Add& add) {
  const grids::ReductionBlocks pieces(count);
  if (pieces.blocks <= 1) {
    CompensatedSum sum;
    add(0, count, sum);
    return CompensatedSum(sum.value());
  }
  std::array<double, grids::ReductionBlocks::most> partial;  // each is set below, and most are never used
  grids::for_each_block(count, pieces.block, [&](std::size_t begin, std::size_t end) {
    CompensatedSum sum;
    add(begin, end, sum);
    partial[begin / pieces.block] = sum.value();
  });
  CompensatedSum sum;
  for (std::size_t b = 0; b < pieces.blocks; ++b) {
    sum.add(partial[b]);
  }
  return sum;
}

/// max |values| of rows of waves, which are no grid's: a slab has no say in it.
[[nodiscard]] double largest_of_rows(std::span<const double> values);

/// How many of `fields` grid functions are transformed at once: of few nodes, where a transform costs as much to begin
/// as to take, all.
[[nodiscard]] int transformed_at_once(const grids::Grid& grid, int fields);
/// Transforms grid functions into the first rows, as many at once as `fourier` takes; null pointers are left out.
void from_grid(std::span<const double* const> fields, grids::Fourier& fourier, WaveRows& rows);
/// Transforms rows number `which` into grid functions, as many at once.
void to_grid(const WaveRows& rows, std::span<const int> which, grids::Fourier& fourier,
             std::span<double* const> fields);

/// For a checkpoint, as grids::save_whole().
///@{
void save_waves(StateWriter& state, const grids::Fourier& fourier, const grids::FieldSet& rows);
void restore_waves(StateReader& state, const grids::Fourier& fourier, grids::FieldSet& rows);
///@}

/// The weight of each wave in Σ_nodes f g = Σ_waves weight Re(conj f̂ ĝ): half of the waves along x are kept.
[[nodiscard]] std::vector<double> parseval_weights(const grids::Fourier& fourier, const grids::Grid& grid);

}  // namespace rubato
