#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/grid.hpp>

namespace rubato::solve {

/// The inverse of a system with constant coefficients on a periodic grid: block-diagonal in Fourier space, one complex
/// matrix of fields × fields for each wave. As the preconditioner of a system with variable coefficients (S'' frozen at
/// its mean) it leaves a spectrum in which GMRES needs few iterations whatever the grid; as the inverse of a linear
/// problem's matrix it is exact. On the grid of this thread's slab it is that of the whole lattice, all ranks taking
/// part (grids::Fourier): of right-hand sides owned nodes are read, of results ghosts are left alone.
class FourierPreconditioner {
public:
  using Complex = std::complex<double>;

  /// Fills the matrix (row by row) of the wave with indices k, from the symbols of grids/fourier.hpp. The matrix of -k
  /// must be the conjugate of that of k, as it is for every real operator. Called by several threads at once.
  using Symbol = std::function<void(const std::array<std::ptrdiff_t, 3>& k, Complex* matrix)>;

  /// Memory: 2 fields doubles per node, and half of one for each real or imaginary part of the inverse that is not 0 on
  /// all waves, about. Throws std::invalid_argument unless 1 <= fields <= 16.
  FourierPreconditioner(const grids::Grid& grid, int fields);

  /// Inverts the matrix of every wave once. A matrix that is singular to rounding (pivots below 1e-13 of the largest)
  /// gets its pseudo-inverse, so that the constant of a potential, say, is left alone; `deficient_waves` counts them.
  /// Status::undefined if an entry is not finite.
  ///
  /// Where rows or columns are of sizes so different that pivots do not show (4/h² of a short step beside coefficients
  /// of order 1), a matrix that seems singular is judged again after rows and columns were multiplied by powers of two,
  /// the same for all waves, that make the largest of each about 1. What is singular then has its pseudo-inverse, as it
  /// is. \param sizes the largest terms, over all waves, that each entry is the sum of, row by row: terms that cancel
  /// count, so that a row of rounding is not made a row; empty: judged as matrices are
  /// \param averages what the matrix of a wave is `symbol` times, one factor for each axis and k, k < 0 at k + n: a
  /// phase that would make entries complex; none: 1
  Status factor(const Symbol& symbol, std::span<const double> sizes = {},
                std::span<const std::vector<Complex>> averages = {});
  [[nodiscard]] std::size_t deficient_waves() const { return deficient_; }

  /// out = (constant-coefficient matrix)⁻¹ in: `fields` arrays of grid values one after the other, as in
  /// grids::FieldSet. in and out may be the same. Hypothesis: the last `factor` succeeded.
  void operator()(const double* in, double* out);

  /// The same in parts, for a right-hand side of which only some rows change, or a solution of which only some fields
  /// are wanted: half a transform less for each that is left out.
  ///
  /// Keeps the transform of a right-hand side, one array for each row, for solve().
  void take(std::span<const double* const> rhs);
  /// out[j] = field fields[j] of (matrix)⁻¹ (what was taken - values[i] in row rows[i]). Hypothesis: different rows,
  /// different fields.
  void solve(std::span<const int> rows, std::span<const double* const> values, std::span<const int> fields,
             std::span<double* const> out);
  /// The same, all fields, in the memory of what was taken, which is lost.
  void solve_all(std::span<const int> rows, std::span<const double* const> values, std::span<double* const> out);
  /// out[j] = field fields[j] of (matrix)⁻¹ (values[i] in row rows[i], 0 in the others).
  void respond(std::span<const int> rows, std::span<const double* const> values, std::span<const int> fields,
               std::span<double* const> out);

private:
  void find_averages(std::span<const std::vector<Complex>> averages);
  void multiply(bool with_taken, double factor, std::span<const int> rows, std::span<const int> fields,
                grids::Fourier& to);

  int fields_;
  std::size_t size_;
  grids::Fourier taken_;
  grids::Fourier work_;
  /// The real part of entry (row, column) on all modes at 2 (column fields + row), the imaginary one behind it; those
  /// that are 0 on all of them have no array.
  std::vector<grids::Buffer> parts_;
  std::vector<Complex> along_row_;  ///< 1/average of the waves of a row along x, and across of each row, if any
  std::vector<Complex> of_rows_;
  std::size_t deficient_ = 0;
  std::vector<int> all_;
  std::vector<const double*> in_;
  std::vector<double*> out_;
};

}  // namespace rubato::solve
