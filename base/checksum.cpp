#include <rubato/base/checksum.hpp>

#include <array>

#include <rubato/base/little_endian.hpp>

namespace rubato {

namespace {

constexpr std::uint64_t polynomial = 0xC96C5795D7870F42;  // ECMA-182, bits reversed
constexpr std::size_t width = 8;                          // bytes taken at once
using Tables = std::array<std::array<std::uint64_t, 256>, width>;

/// tables[k][b]: the effect of byte b with k bytes behind it.
constexpr Tables make_tables() {
  Tables tables{};
  for (std::size_t byte = 0; byte < 256; ++byte) {
    std::uint64_t value = byte;
    for (int bit = 0; bit < 8; ++bit)
      value = (value >> 1) ^ ((value & 1) != 0 ? polynomial : 0);
    tables[0][byte] = value;
  }
  for (std::size_t k = 1; k < width; ++k)
    for (std::size_t byte = 0; byte < 256; ++byte)
      tables[k][byte] = (tables[k - 1][byte] >> 8) ^ tables[0][tables[k - 1][byte] & 0xFF];
  return tables;
}

constexpr Tables tables = make_tables();

// Polynomials modulo that one, the coefficient of 1 in the highest bit.
constexpr std::uint64_t one = std::uint64_t{1} << 63;

constexpr std::uint64_t product(std::uint64_t a, std::uint64_t b) {
  std::uint64_t sum = 0;
  for (; a != 0; a <<= 1) {
    sum ^= (a & one) != 0 ? b : 0;
    b = (b >> 1) ^ ((b & 1) != 0 ? polynomial : 0);
  }
  return sum;
}

/// x^(2^k).
constexpr auto squares = [] {
  std::array<std::uint64_t, 64> powers{};
  powers[0] = one >> 1;
  for (std::size_t k = 1; k < powers.size(); ++k)
    powers[k] = product(powers[k - 1], powers[k - 1]);
  return powers;
}();

}  // namespace

void Checksum::add(std::span<const std::byte> bytes) {
  const std::size_t count = bytes.size();
  std::uint64_t state = state_;
  for (; bytes.size() >= width; bytes = bytes.subspan(width)) {
    state ^= little_endian(bytes.data());
    std::uint64_t next = 0;
    for (std::size_t i = 0; i < width; ++i)
      next ^= tables[width - 1 - i][(state >> (8 * i)) & 0xFF];
    state = next;
  }
  for (const std::byte byte : bytes)
    state = (state >> 8) ^ tables[0][(state ^ std::to_integer<std::uint64_t>(byte)) & 0xFF];
  state_ = state;
  bytes_ += count;
}

void Checksum::append(const Checksum& other) {
  std::uint64_t shift = one;
  std::size_t k = 3;  // of bits
  for (std::uint64_t bytes = other.bytes_; bytes != 0; bytes >>= 1, ++k)
    if ((bytes & 1) != 0)
      shift = product(shift, squares.at(k));
  state_ = ~(product(shift, value()) ^ other.value());
  bytes_ += other.bytes_;
}

}  // namespace rubato
