#pragma once

#include <array>
#include <complex>
#include <cstddef>

#include <rubato/grids/buffer.hpp>
#include <rubato/pde/wave_rows.hpp>

namespace rubato {

/// A complex matrix for each wave, rows × columns, eight waves in the lanes of a vector: for each block of eight waves
/// the columns one after the other, in these the rows, of which eight real and then eight imaginary parts.
class PackedMatrices {
public:
  static constexpr std::size_t lanes = 8;

  PackedMatrices() = default;
  PackedMatrices(int rows, int columns, std::size_t waves);

  [[nodiscard]] bool empty() const { return entries_.size() == 0; }
  void clear();
  /// max |entry| over all waves.
  [[nodiscard]] double largest(int row, int column) const;
  /// Adds value·(re + i im) to the entry on the waves [begin, begin + count), begin a multiple of `lanes`.
  void add(int row, int column, std::complex<double> value, const double* re, const double* im, std::size_t begin,
           std::size_t count);
  /// y = base + P x on the waves [begin, begin + count), begin a multiple of `lanes`; rows of x, y and base follow each
  /// other, and begin with wave 0. base may be y, or null for 0.
  void apply(const WaveRows& x, const WaveRows* base, std::size_t begin, std::size_t count, WaveRows& y) const {
    apply_to(0, rows_, x, base, 0, begin, count, y);
  }
  /// Rows [first, first + count_of_rows) of that, into those of y (and from those of base) that begin with `to`; of x
  /// those that begin with `from`.
  void apply_to(int first, int count_of_rows, const WaveRows& x, const WaveRows* base, int to, std::size_t begin,
                std::size_t count, WaveRows& y, int from = 0) const;

private:
  int rows_ = 0, columns_ = 0;
  grids::Buffer entries_;
};

/// y_i = Σ_j weights[i·columns + j] x_j, i < rows, for arrays of `count` numbers one after the other.
void mix(int rows, int columns, const double* weights, const double* x, std::size_t count, double* y);

/// Rows that are `stride` from one to the next.
template <typename Number>
struct Strided {
  Number* re;
  Number* im;
  std::size_t stride;
};
/// Those of waves from `begin` on, of rows that begin with number `row`.
///@{
[[nodiscard]] inline Strided<const double> rows_from(const WaveRows& rows, int row, std::size_t begin) {
  const std::size_t at = static_cast<std::size_t>(row) * rows.waves() + begin;
  return {rows.re.all().data() + at, rows.im.all().data() + at, rows.waves()};
}
[[nodiscard]] inline Strided<double> rows_from(WaveRows& rows, int row, std::size_t begin) {
  const std::size_t at = static_cast<std::size_t>(row) * rows.waves() + begin;
  return {rows.re.all().data() + at, rows.im.all().data() + at, rows.waves()};
}
///@}
/// y_i += Σ_j weights[i·columns + j] x_j, i < rows, `count` waves of each row; and y_i = that.
///@{
void add_mixed(int rows, int columns, const double* weights, Strided<const double> x, std::size_t count,
               Strided<double> y);
void add_mixed(int rows, int columns, const std::complex<double>* weights, Strided<const double> x, std::size_t count,
               Strided<double> y);
void mix(int rows, int columns, const double* weights, Strided<const double> x, std::size_t count, Strided<double> y);
void mix(int rows, int columns, const std::complex<double>* weights, Strided<const double> x, std::size_t count,
         Strided<double> y);
///@}
/// out -= value·x.
void subtract(double value, const double* x, std::size_t count, double* out);

/// out = max(|Re(x - y)|, |Im(x - y)|), of one row.
void measure_distance(Strided<const double> x, Strided<const double> y, std::size_t count, double* out);

/// Ways in which a RestForecast goes on.
inline constexpr std::size_t ways_onward = 3;

/// A field's rows for RestForecast, of several stages.
struct WaveForecast {
  std::array<Strided<const double>, 3> past;      ///< stages of the last step, and of those before it
  int known;                                      ///< of these, one at least
  std::array<const double*, ways_onward> off;     ///< how far each way was off
  std::array<Strided<double>, ways_onward> last;  ///< what each says of the last stage
  Strided<double> stages;                         ///< by the best way
};
/// \param onward what the polynomial through m stages is at those of the next step, by rows
/// \param judged whether `off` reports on all ways; else of the first alone
void foresee_waves(int m, const double* onward, const WaveForecast& forecast, bool judged, std::size_t count);

/// Of one stage, by polynomials through the last steps, which are taken to be equally long: so many for each way. How
/// far off each is shows in the last step, foreseen from those before it.
inline constexpr std::array<int, ways_onward> steps_of_way = {1, 4, 8};
struct StageForecast {
  std::array<Strided<const double>, 1 + steps_of_way.back()> past;
  int known;
  Strided<double> stage;
};
void foresee_steps(const StageForecast& forecast, std::size_t count);

/// The largest |y| and |y - last| of what was placed; NaN with a value that is not finite.
struct StageSizes {
  double moved = 0.0;
  double change = 0.0;
};
/// point = high + (low + y).
[[nodiscard]] StageSizes place_stage(const double* high, const double* low, const double* y, const double* last,
                                     std::size_t count, double* point);

}  // namespace rubato
