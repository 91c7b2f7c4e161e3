#include <rubato/base/checksum.hpp>

#include <array>

#include <isa-l/crc64.h>

namespace rubato {

namespace {

constexpr std::uint64_t polynomial = 0xC96C5795D7870F42;  // ECMA-182, bits reversed

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

/// Clears the upper halves of vector registers. ISA-L leaves them in use, which makes each later SSE instruction wait
/// for the one before: formulas take a third longer.
#if defined(__x86_64__)
[[gnu::target("avx")]] void clear_upper_halves() {
  __builtin_ia32_vzeroupper();
}
const bool has_upper_halves = __builtin_cpu_supports("avx") != 0;
#else
void clear_upper_halves() {}
constexpr bool has_upper_halves = false;
#endif

}  // namespace

void Checksum::add(std::span<const std::byte> bytes) {
  value_ = crc64_ecma_refl(value_, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  bytes_ += bytes.size();
  if (has_upper_halves) {
    clear_upper_halves();
  }
}

void Checksum::append(const Checksum& other) {
  std::uint64_t shift = one;  // x^(8 · bytes of the other)
  for (std::size_t k = 3; (other.bytes_ << 3) >> k != 0; ++k)
    if (((other.bytes_ << 3) >> k & 1) != 0)
      shift = product(shift, squares.at(k));
  value_ = product(shift, value_) ^ other.value_;
  bytes_ += other.bytes_;
}

}  // namespace rubato
