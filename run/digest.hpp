#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include <rubato/base/checksum.hpp>

namespace rubato {

/// A running digest of the rows of a dataset, as the doubles that a reader makes of them: any one number altered gives
/// another. It is no protection against intent, which could renew it. Of a row that lies in parts in several places it
/// is put together out of theirs.
class Digest {
public:
  /// Where records have them, in their checkpoint. (Those of versions before it, "digests", were of another kind.)
  static constexpr const char* array = "row_digests";

  Digest() = default;
  Digest(std::int64_t rows, std::int64_t value) : rows_(rows), checksum_(static_cast<std::uint64_t>(value)) {}

  template <typename Number>
  void add_row(std::span<const Number> row) {
    add_part(row, true);
  }
  /// A row in parts.
  template <typename Number>
  void add_part(std::span<const Number> part, bool is_last) {
    if constexpr (std::is_same_v<Number, double>) {
      checksum_.add(std::as_bytes(part));
    } else {
      for (const Number number : part) {
        const auto value = static_cast<double>(number);
        checksum_.add(std::as_bytes(std::span(&value, 1)));
      }
    }
    rows_ += is_last ? 1 : 0;
  }
  /// A row of doubles with this checksum.
  void add_row(const Checksum& row) {
    checksum_.append(row);
    ++rows_;
  }
  [[nodiscard]] std::int64_t rows() const { return rows_; }
  [[nodiscard]] std::int64_t value() const { return static_cast<std::int64_t>(checksum_.value()); }
  friend bool operator==(const Digest& one, const Digest& other) {
    return one.rows() == other.rows() && one.value() == other.value();
  }

private:
  std::int64_t rows_ = 0;
  Checksum checksum_;
};

}  // namespace rubato
