#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace rubato::record::detail {

/// Bytes one after the other that leave in the order in which they came.
///
/// They stand in memory that is set aside for as many as are expected, so that it need not be copied into more, and of
/// which the system is asked for several pages ahead: one at a time costs some microseconds each, more than all else
/// that is done with a page of a record.
class WaitingBytes {
public:
  /// \param expected how many wait at most, as a rule
  explicit WaitingBytes(std::size_t expected = 0) : expected_(expected) {}

  void append(std::span<const std::byte> bytes);
  /// `count` bytes without values behind those that are there. \return where they are
  [[nodiscard]] std::byte* append(std::size_t count);
  void drop_front(std::size_t count);
  /// Leaves the first `count` alone.
  void keep_front(std::size_t count) { bytes_.resize(count); }

  [[nodiscard]] const std::byte* data() const { return bytes_.data(); }
  [[nodiscard]] std::size_t size() const { return bytes_.size(); }
  [[nodiscard]] bool empty() const { return bytes_.empty(); }

private:
  void make_room(std::size_t count);

  std::size_t expected_;
  std::size_t asked_for_ = 0;  ///< bytes of bytes_' capacity whose pages are there
  std::vector<std::byte> bytes_;
};

}  // namespace rubato::record::detail
