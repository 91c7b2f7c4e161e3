#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace rubato::grids {

/// A sum that is the same bit by bit in whatever order, and in whatever parts, its terms are added: each term is cut
/// into digits of 28 bits at places that are the same for all numbers, and the digits of a place are added as whole
/// numbers. Kept are the five places from that of the largest term on, which is a property of the terms as well (J.
/// Demmel and H. D. Nguyen, Parallel reproducible summation, IEEE Trans. Computers 64, 2015: with bins so wide that no
/// term reaches beyond the first). Error: that of value(), one rounding of the sum, and n 2^-112 of the largest of n
/// terms. Hypothesis: n < 2^36.
class DigitSum {
public:
  static constexpr int width = 28, digits = 5;

  void add(std::span<const double> terms);
  /// The squares, each rounded, of so many values. \return the largest magnitude of these, if all squares are finite
  double add_squares(std::span<const double> values);
  void add(const DigitSum& other);
  /// The sum; with infinite terms that infinity, or NaN.
  [[nodiscard]] double value() const;

  /// All there is to a sum, as numbers that can be sent: of them only bits matter.
  ///@{
  using Packed = std::array<double, digits + 1>;
  [[nodiscard]] Packed packed() const;
  static DigitSum unpacked(std::span<const double, digits + 1> numbers);
  ///@}

private:
  /// All numbers are multiples of the last unit of this, and smaller than half of what would be above its first.
  static constexpr int lowest = -36;
  void raise(int top);
  template <bool squared>
  void add_finite(std::span<const double> values, double largest);

  int top_ = lowest;  ///< digit d counts 2^(28 (top - d)); all terms are smaller than half of 2^(28 (top + 1))
  std::array<std::int64_t, digits> digits_{};
  double undefined_ = 0.0;  ///< the sum of the terms that are not finite
};

}  // namespace rubato::grids
