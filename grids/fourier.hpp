#pragma once

#include <complex>
#include <memory>
#include <span>

#include <rubato/grids/grid.hpp>

namespace rubato::grids {

class Transposition;

/// θ = 2π k / n of wave index k, and the symbols of the operators on e^{iθj}.
///@{
[[nodiscard]] double wave_angle(std::ptrdiff_t k, std::size_t n);
/// A: (1 + e^{iθ})/2.
[[nodiscard]] std::complex<double> average_symbol(double theta);
/// D: (e^{iθ} - 1)/Δx.
[[nodiscard]] std::complex<double> difference_symbol(double theta, double spacing);
/// ∂: i 2π k / length, and 0 for the Nyquist mode 2|k| = n, whose derivative no real grid function represents.
[[nodiscard]] std::complex<double> derivative_symbol(std::ptrdiff_t k, const Axis& axis);
///@}

/// True if n has no prime factor beyond 7: transforms of other lengths take longer.
[[nodiscard]] bool has_small_factors(std::size_t n);

/// The least odd number from `least` on that has no prime factor beyond 7: a good number of cells where an even one
/// will not do, for transforms whose lengths have larger ones take longer.
[[nodiscard]] std::size_t good_odd_count(std::size_t least);

/// Discrete Fourier transforms of `fields` real grid functions at once, û(k) = Σ_j u_j e^{-iθ·j}, and back.
///
/// Half of the modes along x are kept, k_x = 0 … n_x/2; those of y and z run 0 … n-1 and stand for k - n beyond n/2.
/// Plans are made once, with FFTW_ESTIMATE: measured plans differ from run to run and with them the last bits, and a
/// resumed run must go on bit by bit. Each one-dimensional transform is done by one thread, different ones by different
/// threads, so that results do not depend on their number. FFTW's planner is not thread-safe and is guarded by a lock.
class Fourier {
public:
  using Complex = std::complex<double>;

  /// Throws std::bad_alloc. Takes about fields · size doubles.
  ///
  /// On the grid of this thread's slab (of two or three dimensions) transforms are those of the whole lattice, all
  /// ranks taking part: each has some of the modes, and its owned nodes, of which ghosts are left alone. What
  /// neighbours in a row are transformed with depends on the number of ranks, and so does rounding. The slab has to
  /// outlive this.
  Fourier(const Grid& grid, int fields);
  ~Fourier();
  Fourier(Fourier&&) noexcept;
  Fourier& operator=(Fourier&&) noexcept;

  [[nodiscard]] int fields() const;
  /// Modes kept: (n_x/2 + 1) n_y n_z.
  [[nodiscard]] std::size_t modes() const;
  /// Those with the same k_y and k_z follow each other in numbers, and for each field in memory too.
  [[nodiscard]] std::size_t row_length() const;
  /// Signed wave indices (k_x, k_y, k_z) of a mode, |2 k_a| <= n_a.
  [[nodiscard]] std::array<std::ptrdiff_t, 3> wave(std::size_t mode) const;
  /// The coefficient of a field at a mode, to read after `forward` and to change before `inverse`.
  [[nodiscard]] Complex& at(int field, std::size_t mode);
  [[nodiscard]] const Complex& at(int field, std::size_t mode) const;

  /// Which modes this rank has; null for all.
  [[nodiscard]] const Transposition* transposition() const;

  /// Transforms one array of grid values for each field, or for the first few.
  void forward(std::span<const double* const> values);
  /// The inverse, with the factor 1/size, of all fields or the first few; their coefficients are lost.
  void inverse(std::span<double* const> values);

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

/// Spectral derivatives: exact for every trigonometric polynomial that the grid resolves; the Nyquist mode of an even
/// number of cells is given derivative zero. Plans and threads as in `Fourier`.
///
/// On the grid of this thread's slab derivatives are those of the whole lattice: along planes each rank takes those of
/// its part, ghosts and all; across planes all ranks take part, each with some of the lines (grids/columns.hpp), and of
/// the results ghosts are left alone. Each line is differentiated as it is on one rank: the bits are the same for every
/// number of ranks. The slab has to outlive this.
class SpectralDerivative {
public:
  explicit SpectralDerivative(const Grid& grid);
  ~SpectralDerivative();
  SpectralDerivative(SpectralDerivative&&) noexcept;
  SpectralDerivative& operator=(SpectralDerivative&&) noexcept;

  /// out[f] = ∂_axis in[f] for each field; in[f] and out[f] may be the same.
  void operator()(int axis, std::span<const double* const> in, std::span<double* const> out) const;
  void operator()(int axis, const double* in, double* out) const;

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato::grids
