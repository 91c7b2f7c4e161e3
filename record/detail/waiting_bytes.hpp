#pragma once

#include <cstddef>
#include <memory>
#include <span>

namespace rubato::record::detail {

/// Bytes one after the other that leave in the order in which they came.
///
/// They stand in memory that is set aside for as many as are expected, so that it need not be copied into more, and of
/// which the system is asked for several pages ahead: one at a time costs some microseconds each, more than all else
/// that is done with a page of a record. Behind them there is always room for a few bytes more.
class WaitingBytes {
public:
  /// How many bytes behind those that wait may be written to, and are lost when others come.
  static constexpr std::size_t room_behind = 8;

  /// \param expected how many wait at most, as a rule
  explicit WaitingBytes(std::size_t expected = 0) : expected_(expected) {}

  void append(std::span<const std::byte> bytes);
  /// `count` bytes without values behind those that are there. \return where they are
  [[nodiscard]] std::byte* append(std::size_t count);
  void drop_front(std::size_t count);
  /// Leaves the first `count` alone.
  void keep_front(std::size_t count) { size_ = count; }

  [[nodiscard]] const std::byte* data() const { return bytes_.get(); }
  [[nodiscard]] std::byte* data() { return bytes_.get(); }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }

private:
  std::size_t expected_;
  std::size_t size_ = 0, capacity_ = 0;
  std::size_t asked_for_ = 0;  ///< bytes whose pages are there
  std::unique_ptr<std::byte[]> bytes_;
};

}  // namespace rubato::record::detail
