#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

namespace rubato {

/// A running digest of the rows of a dataset, as the doubles that a reader makes of them: any one number altered gives
/// another. It is no protection against intent, which could renew it.
class Digest {
public:
  Digest() = default;
  Digest(std::int64_t rows, std::int64_t value) : rows_(rows), value_(static_cast<std::uint64_t>(value)) {}

  template <typename Number>
  void add_row(std::span<const Number> row) {
    add_part(row, true);
  }
  /// A row in parts.
  template <typename Number>
  void add_part(std::span<const Number> part, bool is_last) {
    for (const Number number : part) {
      mix(std::bit_cast<std::uint64_t>(static_cast<double>(number)));
    }
    rows_ += is_last ? 1 : 0;
  }
  [[nodiscard]] std::int64_t rows() const { return rows_; }
  [[nodiscard]] std::int64_t value() const { return static_cast<std::int64_t>(value_); }
  friend bool operator==(const Digest&, const Digest&) = default;

private:
  void mix(std::uint64_t word) {
    constexpr std::uint64_t odd = 0x9E3779B97F4A7C15;  // 2^64 over the golden ratio
    value_ = (value_ ^ word) * odd;
    value_ ^= value_ >> 32;
  }
  std::int64_t rows_ = 0;
  std::uint64_t value_ = 0;
};

}  // namespace rubato
