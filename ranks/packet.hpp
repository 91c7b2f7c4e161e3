#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace rubato::ranks {

/// Numbers, texts and arrays as the bytes of a message, in the order in which they are put in. Doubles keep every bit.
/// All ranks are processes of one program on machines of one kind.
class Packet {
public:
  Packet& number(std::uint64_t value) { return raw(&value, sizeof value); }
  Packet& text(std::string_view value) { return number(value.size()).raw(value.data(), value.size()); }
  Packet& numbers(std::span<const double> values) {
    return number(values.size()).raw(values.data(), values.size_bytes());
  }
  [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }

private:
  Packet& raw(const void* data, std::size_t size) {
    const auto* first = static_cast<const std::byte*>(data);
    bytes_.insert(bytes_.end(), first, first + size);
    return *this;
  }

  std::vector<std::byte> bytes_;
};

/// Takes them out again, in the same order. \throws std::runtime_error if there is less than is asked for
class PacketReader {
public:
  explicit PacketReader(std::span<const std::byte> bytes) : bytes_(bytes) {}
  std::uint64_t number() {
    std::uint64_t value = 0;
    raw(&value, 1, sizeof value);
    return value;
  }
  std::string text() {
    std::string value(count(1), '\0');
    raw(value.data(), value.size(), 1);
    return value;
  }
  std::vector<double> numbers() {
    std::vector<double> values(count(sizeof(double)));
    raw(values.data(), values.size(), sizeof(double));
    return values;
  }

private:
  /// How many of `size` bytes each follow.
  std::size_t count(std::size_t size) {
    const std::uint64_t count = number();
    if (count > bytes_.size() / size) {
      throw std::runtime_error("a message from another rank is shorter than it says");
    }
    return static_cast<std::size_t>(count);
  }
  void raw(void* into, std::size_t count, std::size_t size) {
    if (count * size > bytes_.size()) {
      throw std::runtime_error("a message from another rank is shorter than it says");
    }
    if (count > 0) {
      std::memcpy(into, bytes_.data(), count * size);
    }
    bytes_ = bytes_.subspan(count * size);
  }

  std::span<const std::byte> bytes_;
};

}  // namespace rubato::ranks
