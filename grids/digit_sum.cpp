#include <rubato/grids/digit_sum.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/largest.hpp>

namespace rubato::grids {

namespace {

/// Σ of the digits of scale·x, in units of 1, 2^-28, 2^-56, 2^-84, 2^-112. Hypothesis: |scale·x| < 2^27.
/// Adding 1.5·2^52 units rounds to units (to an even number of them where two are as near), whatever was added before;
/// all else is exact, and sums of less than 2^26 digits are.
template <bool squared>
[[gnu::always_inline]] inline void add_digits_of(const double* values, std::size_t count, double scale, double* sums) {
  constexpr std::size_t lanes = 8;
  EightLanes sum_0 = {}, sum_1 = {}, sum_2 = {}, sum_3 = {}, sum_4 = {};
  const auto take = [&](const double* from, std::size_t some) __attribute__((always_inline)) {
    EightLanes rest = {};
    std::memcpy(&rest, from, some * sizeof(double));
    if constexpr (squared) {
      rest *= rest;
    }
    rest *= scale;
    const auto add_digit = [&rest](EightLanes & sum, double shift) __attribute__((always_inline)) {
      const EightLanes digit = (rest + shift) - shift;
      rest -= digit;
      sum += digit;
    };
    add_digit(sum_0, 0x1.8p52);
    add_digit(sum_1, 0x1.8p24);
    add_digit(sum_2, 0x1.8p-4);
    add_digit(sum_3, 0x1.8p-32);
    add_digit(sum_4, 0x1.8p-60);
  };
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    take(values + i, lanes);
  }
  if (i < count) {
    take(values + i, count - i);
  }
  const auto total = [](const EightLanes& sum) __attribute__((always_inline)) {
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7]));
  };
  sums[0] = total(sum_0);
  sums[1] = total(sum_1);
  sums[2] = total(sum_2);
  sums[3] = total(sum_3);
  sums[4] = total(sum_4);
}

RUBATO_WIDE_VECTORS void add_digits(const double* terms, std::size_t count, double scale, double* sums) {
  add_digits_of<false>(terms, count, scale, sums);
}
RUBATO_WIDE_VECTORS void add_digits_of_squares(const double* values, std::size_t count, double scale, double* sums) {
  add_digits_of<true>(values, count, scale, sums);
}

/// 2^exponent. Hypothesis: -1022 ≤ exponent ≤ 1023.
double power_of_two(int exponent) {
  return std::bit_cast<double>(static_cast<std::uint64_t>(exponent + 1023) << 52);
}

/// Digit d in units of the first.
constexpr std::array<double, DigitSum::digits> units = {1.0, 0x1p-28, 0x1p-56, 0x1p-84, 0x1p-112};
constexpr std::array<double, DigitSum::digits> inverse_units = {1.0, 0x1p28, 0x1p56, 0x1p84, 0x1p112};

double sum_of_undefined(double a, double b) {
  const double sum = a + b;
  return sum == sum ? sum : std::numeric_limits<double>::quiet_NaN();  // of one sign
}

}  // namespace

void DigitSum::raise(int top) {
  if (top <= top_) {
    return;
  }
  const int by = std::min(top - top_, digits);
  std::copy_backward(digits_.begin(), digits_.end() - by, digits_.end());
  std::fill_n(digits_.begin(), by, 0);
  top_ = top;
}

void DigitSum::add(std::span<const double> terms) {
  constexpr std::size_t exact = std::size_t{1} << 25;
  for (; terms.size() > exact; terms = terms.subspan(exact)) {
    add(terms.first(exact));
  }
  double poison = 0.0;
  const double largest = largest_magnitude(terms.data(), terms.size(), poison);
  if (poison != 0.0) {
    for (const double term : terms) {
      undefined_ = std::isfinite(term) ? undefined_ : sum_of_undefined(undefined_, term);
    }
    return;  // what else there is does not matter any more
  }
  add_finite<false>(terms, largest);
}

double DigitSum::add_squares(std::span<const double> values) {
  constexpr std::size_t cached = 2048;  // in the first level, as they are read twice
  double largest_of_all = 0.0;
  for (; !values.empty(); values = values.subspan(std::min(cached, values.size()))) {
    const std::span<const double> some = values.first(std::min(cached, values.size()));
    double poison = 0.0;
    const double largest = largest_magnitude(some.data(), some.size(), poison);
    if (poison != 0.0 || !std::isfinite(largest * largest)) {
      for (const double value : some) {
        undefined_ = std::isfinite(value * value) ? undefined_ : sum_of_undefined(undefined_, value * value);
      }
    } else {
      largest_of_all = std::max(largest_of_all, largest);
      add_finite<true>(some, largest * largest);
    }
  }
  return largest_of_all;
}

/// Hypothesis: no more than 2^25 terms, the largest of which this is.
template <bool squared>
void DigitSum::add_finite(std::span<const double> terms, double largest) {
  if (largest == 0.0) {
    return;
  }
  // largest < 2^exponent, or is smaller than all that matters here; and that is to be 2^(28 (top + 1) - 1) at most.
  const int exponent = static_cast<int>(std::bit_cast<std::uint64_t>(largest) >> 52) - 1022;
  raise(std::max(lowest, (exponent - lowest * width) / width + lowest));
  std::array<double, digits> sums{};
  const auto add_all = squared ? add_digits_of_squares : add_digits;
  add_all(terms.data(), terms.size(), power_of_two(-width * top_), sums.data());
  for (std::size_t d = 0; d < sums.size(); ++d) {
    digits_[d] += static_cast<std::int64_t>(sums[d] * inverse_units[d]);
  }
}

void DigitSum::add(const DigitSum& other) {
  undefined_ = sum_of_undefined(undefined_, other.undefined_);
  raise(other.top_);
  const auto behind = static_cast<std::size_t>(top_ - other.top_);
  for (std::size_t d = behind; d < digits_.size(); ++d) {
    digits_[d] += other.digits_[d - behind];
  }
}

double DigitSum::value() const {
  if (undefined_ != 0.0) {
    return undefined_;
  }
  CompensatedSum sum;  // in units of the first digit; exact but for the last bits of `low`
  for (std::size_t d = 0; d < digits_.size(); ++d) {
    const std::int64_t high = digits_[d] >> 32, low = digits_[d] - high * (std::int64_t{1} << 32);
    sum.add(static_cast<double>(high) * 0x1p32 * units[d]);
    sum.add(static_cast<double>(low) * units[d]);
  }
  return sum.value() * power_of_two(width * top_);
}

DigitSum::Packed DigitSum::packed() const {
  Packed numbers{undefined_ != 0.0 ? undefined_ : static_cast<double>(top_)};
  std::ranges::transform(digits_, numbers.begin() + 1, [](std::int64_t digit) { return std::bit_cast<double>(digit); });
  return numbers;
}

DigitSum DigitSum::unpacked(std::span<const double, digits + 1> numbers) {
  DigitSum sum;
  if (!std::isfinite(numbers[0])) {
    sum.undefined_ = numbers[0];
    return sum;
  }
  sum.top_ = static_cast<int>(numbers[0]);
  std::ranges::transform(numbers.subspan(1), sum.digits_.begin(),
                         [](double digit) { return std::bit_cast<std::int64_t>(digit); });
  return sum;
}

}  // namespace rubato::grids
