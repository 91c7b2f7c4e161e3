#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/wide_vectors.hpp>

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

/// Transforms grid functions into the first rows.
void from_grid(std::span<const double* const> fields, grids::Fourier& fourier, WaveRows& rows);
/// Transforms rows number `which` into grid functions.
void to_grid(const WaveRows& rows, std::span<const int> which, grids::Fourier& fourier,
             std::span<double* const> fields);

/// out += value·in on `count` waves.
void add(std::complex<double> value, const double* re, const double* im, std::size_t count, double* out_re,
         double* out_im);
/// out += x·y.
void add_product(const double* x_re, const double* x_im, const double* y_re, const double* y_im, std::size_t count,
                 double* out_re, double* out_im);

/// The weight of each wave in Σ_nodes f g = Σ_waves weight Re(conj f̂ ĝ): half of the waves along x are kept.
[[nodiscard]] std::vector<double> parseval_weights(const grids::Fourier& fourier, const grids::Grid& grid);

}  // namespace rubato
