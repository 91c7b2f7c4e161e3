#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace rubato {

/// What is reported on many values: their range, largest magnitude, root mean square, how far they stray from one of
/// them; and how many of them are no numbers at all. Everything that Rubato reports on maxima, means and deviations is
/// gathered here, so that a value that is not defined can be lost nowhere: it is counted, and takes no part in the
/// rest.
///
/// The extremes are enough for every deviation |v - r|, whichever r turns out to be the reference: rounding is
/// monotone, so that the largest of the rounded |v - r| is that of the least or of the greatest v.
struct Spread {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();
  double squares = 0.0;       ///< Σ v² of |v| < huge
  double huge_squares = 0.0;  ///< Σ (unit v)² of the others, whose squares might not be finite
  double defined = 0.0;       ///< the number of finite values; whole numbers below 2^53, as saved states hold doubles
  double undefined = 0.0;     ///< the number of the others, NaN and infinities

  static constexpr double huge = 0x1p480, unit = 0x1p-600;

  /// Of `defined` magnitudes whose largest and Σ v², a number, are known, and of `undefined` values beside them.
  [[nodiscard]] static Spread of_magnitudes(double largest, double squares, double defined, double undefined) {
    Spread spread{.squares = squares, .defined = defined, .undefined = undefined};
    if (defined > 0.0) {
      spread.min = spread.max = largest;
    }
    return spread;
  }
  /// Of magnitudes whose root mean square is known in place of Σ v².
  [[nodiscard]] static Spread of_magnitudes_with_rms(double largest, double rms, double defined, double undefined) {
    Spread spread = of_magnitudes(largest, 0.0, defined, undefined);
    spread.add_square(rms, defined);
    return spread;
  }

  void add(double value) {
    if (!std::isfinite(value)) {
      undefined += 1.0;
      return;
    }
    min = std::min(min, value);
    max = std::max(max, value);
    add_square(value, 1.0);
    defined += 1.0;
  }
  void add(const Spread& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
    squares += other.squares;
    huge_squares += other.huge_squares;
    defined += other.defined;
    undefined += other.undefined;
  }

  [[nodiscard]] bool any() const { return defined > 0.0; }
  [[nodiscard]] double count() const { return defined + undefined; }
  /// max |v|, max |v - from|, sqrt(Σ v²/n), of the defined values; 0 where there is none.
  ///@{
  [[nodiscard]] double largest() const { return farthest(0.0); }
  [[nodiscard]] double farthest(double from) const {
    return any() ? std::max(std::abs(min - from), std::abs(max - from)) : 0.0;
  }
  [[nodiscard]] double rms() const {
    if (!any()) {
      return 0.0;
    }
    if (huge_squares == 0.0) {
      return std::sqrt(squares / defined);
    }
    return std::sqrt((huge_squares + squares * unit * unit) / defined) / unit;
  }
  ///@}

  /// Shows every member to `visitor`, for saving and restoring.
  template <typename Self, typename Visitor>
  static void visit(Self& self, Visitor&& visitor) {
    visitor(self.min);
    visitor(self.max);
    visitor(self.squares);
    visitor(self.huge_squares);
    visitor(self.defined);
    visitor(self.undefined);
  }

private:
  void add_square(double value, double times) {
    if (std::abs(value) < huge) {
      squares += value * value * times;
    } else {
      huge_squares += (unit * value) * (unit * value) * times;
    }
  }
};

}  // namespace rubato
