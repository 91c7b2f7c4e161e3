#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace rubato {

/// Units of the components of a state, powers of 2, in which each row of J H_zz is about as large as its column
/// (Parlett and Reinsch 1969). Elimination chooses pivots by their size, and without such units may take H_qq, which a
/// free motion makes singular, for the large part of I - ½h J H_zz.
class ComponentUnits {
public:
  explicit ComponentUnits(std::size_t size) : unit_(size, 1.0), row_(size), column_(size) {}

  /// To begin with: 1 for the first half, coordinates, and a power of 2 for momenta.
  void begin(double of_momenta) {
    const auto half = static_cast<std::ptrdiff_t>(unit_.size() / 2);
    std::fill(unit_.begin(), unit_.begin() + half, 1.0);
    std::fill(unit_.begin() + half, unit_.end(), of_momenta);
    differ_ = of_momenta != 1.0;
  }
  /// Goes on from those of begin().
  /// \param for_each_entry calls its argument with row, column and value of all entries, at each of several sweeps
  /// \param most_uneven the binary digits that rows and columns may differ by at the end
  template <class ForEachEntry>
  void find(const ForEachEntry& for_each_entry, int most_uneven = most_uneven_of_pivots) {
    for (int sweep = 0; sweep < most_sweeps; ++sweep) {
      row_.assign(row_.size(), 0.0);
      column_.assign(column_.size(), 0.0);
      for_each_entry([this](auto row, auto column, double value) {
        const auto i = static_cast<std::size_t>(row), j = static_cast<std::size_t>(column);
        if (i != j) {
          const double size = std::abs(value) * unit_[j] / unit_[i];
          row_[i] += size;
          column_[j] += size;
        }
      });
      if (!are_uneven(most_uneven)) {
        return;
      }
      differ_ = true;
      for (std::size_t i = 0; i < unit_.size(); ++i) {
        // The fourth root: a component and its conjugate each take half of what makes both even.
        unit_[i] = std::ldexp(unit_[i], static_cast<int>(std::lround(0.25 * unevenness(i))));
      }
    }
  }
  /// False if all are 1.
  [[nodiscard]] bool differ() const { return differ_; }
  [[nodiscard]] const double* data() const { return unit_.data(); }
  /// Of a component.
  [[nodiscard]] double operator[](std::size_t i) const { return unit_[i]; }
  /// Of an entry: what it is multiplied by.
  [[nodiscard]] double of_entry(std::size_t row, std::size_t column) const { return unit_[column] / unit_[row]; }

private:
  static constexpr int most_sweeps = 32;
  /// As many digits are lost of a correction, which need not be accurate.
  static constexpr int most_uneven_of_pivots = 10;

  [[nodiscard]] int unevenness(std::size_t i) const {
    const double ratio = row_[i] / column_[i];
    return std::isnormal(ratio) ? std::ilogb(ratio) : 0;
  }
  [[nodiscard]] bool are_uneven(int most_uneven) const {
    for (std::size_t i = 0; i < unit_.size(); ++i) {
      if (std::abs(unevenness(i)) > most_uneven) {
        return true;
      }
    }
    return false;
  }

  std::vector<double> unit_, row_, column_;
  bool differ_ = false;
};

}  // namespace rubato
