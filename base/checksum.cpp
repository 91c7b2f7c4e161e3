#include <rubato/base/checksum.hpp>

#include <array>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

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

/// x^n.
constexpr std::uint64_t power(std::uint64_t n) {
  std::uint64_t result = one;
  for (std::size_t k = 0; n != 0; n >>= 1, ++k)
    if ((n & 1) != 0)
      result = product(result, squares.at(k));
  return result;
}

#if defined(__x86_64__)

/// Products of polynomials by the processor's own instruction, which gives them times x, as bits are reversed.
class Folding {
public:
  static constexpr std::size_t block = 64;  ///< bytes that are folded at a time

  [[nodiscard]] static bool is_supported() {
    static const bool supported = __builtin_cpu_supports("pclmul") != 0;
    return supported;
  }

  /// Bytes whose remainder is that of all whole blocks of `bytes` behind what left `state`: each 16 bytes are
  /// multiplied by the power of x that takes them to where they meet those 64 bytes later (V. Gopal et al., "Fast CRC
  /// Computation for Generic Polynomials Using PCLMULQDQ Instruction", Intel, 2009). One block at least.
  __attribute__((target("pclmul"))) static std::array<std::byte, 16> fold(std::uint64_t state,
                                                                          std::span<const std::byte> bytes) {
    constexpr std::uint64_t four[] = {power(575), power(511)}, single[] = {power(191), power(127)};
    const __m128i four_on = load(reinterpret_cast<const std::byte*>(four));
    const __m128i one_on = load(reinterpret_cast<const std::byte*>(single));
    const std::byte* from = bytes.data();
    __m128i sum[4] = {load(from), load(from + 16), load(from + 32), load(from + 48)};
    sum[0] = _mm_xor_si128(sum[0], _mm_set_epi64x(0, static_cast<long long>(state)));
    const std::byte* const end = from + bytes.size() / block * block;
    for (from += block; from != end; from += block) {
      for (int i = 0; i < 4; ++i) {
        sum[i] = _mm_xor_si128(moved(sum[i], four_on), load(from + 16 * i));
      }
    }
    for (int i = 1; i < 4; ++i) {
      sum[i] = _mm_xor_si128(moved(sum[i - 1], one_on), sum[i]);
    }
    std::array<std::byte, 16> rest;
    _mm_storeu_si128(reinterpret_cast<__m128i*>(rest.data()), sum[3]);
    return rest;
  }

  static constexpr std::size_t wide_block = 256;  ///< the same with vectors of 64 bytes

  [[nodiscard]] static bool is_wide() {
    static const bool wide = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("vpclmulqdq") != 0;
    return wide;
  }

  /// Bytes that may stand, behind what leaves 0, for all whole wide blocks of `bytes` behind what left `state`. One
  /// block at least.
  __attribute__((target("avx512f,vpclmulqdq"))) static std::array<std::byte, wide_block> fold_wide(
      std::uint64_t state, std::span<const std::byte> bytes) {
    constexpr auto low = static_cast<long long>(power(2111)), high = static_cast<long long>(power(2047));
    const __m512i powers = _mm512_set_epi64(high, low, high, low, high, low, high, low);
    const std::byte* from = bytes.data();
    __m512i sum[4];
    for (int i = 0; i < 4; ++i) {
      sum[i] = _mm512_loadu_si512(from + 64 * i);
    }
    sum[0] = _mm512_xor_si512(sum[0], _mm512_set_epi64(0, 0, 0, 0, 0, 0, 0, static_cast<long long>(state)));
    const std::byte* const end = from + bytes.size() / wide_block * wide_block;
    for (from += wide_block; from != end; from += wide_block) {
      for (int i = 0; i < 4; ++i) {
        const __m512i moved = _mm512_xor_si512(_mm512_clmulepi64_epi128(sum[i], powers, 0x00),
                                               _mm512_clmulepi64_epi128(sum[i], powers, 0x11));
        sum[i] = _mm512_xor_si512(moved, _mm512_loadu_si512(from + 64 * i));
      }
    }
    std::array<std::byte, wide_block> rest;
    for (std::size_t i = 0; i < 4; ++i) {
      _mm512_storeu_si512(rest.data() + 64 * i, sum[i]);
    }
    return rest;
  }

private:
  __attribute__((target("pclmul"))) static __m128i load(const std::byte* from) {
    return _mm_loadu_si128(reinterpret_cast<const __m128i*>(from));
  }
  /// The first eight bytes by one power, the others by the other.
  __attribute__((target("pclmul"))) static __m128i moved(__m128i bytes, __m128i powers) {
    return _mm_xor_si128(_mm_clmulepi64_si128(bytes, powers, 0x00), _mm_clmulepi64_si128(bytes, powers, 0x11));
  }
};

#endif

/// By tables, eight bytes at a time. \return the state after them
std::uint64_t by_tables(std::uint64_t state, std::span<const std::byte> bytes) {
  for (; bytes.size() >= width; bytes = bytes.subspan(width)) {
    state ^= little_endian(bytes.data());
    std::uint64_t next = 0;
    for (std::size_t i = 0; i < width; ++i)
      next ^= tables[width - 1 - i][(state >> (8 * i)) & 0xFF];
    state = next;
  }
  for (const std::byte byte : bytes)
    state = (state >> 8) ^ tables[0][(state ^ std::to_integer<std::uint64_t>(byte)) & 0xFF];
  return state;
}

}  // namespace

void Checksum::add(std::span<const std::byte> bytes) {
  bytes_ += bytes.size();
#if defined(__x86_64__)
  if (bytes.size() >= 2 * Folding::wide_block && Folding::is_supported() && Folding::is_wide()) {
    const auto rest = Folding::fold_wide(state_, bytes);
    state_ = by_tables(0, Folding::fold(0, rest));
    bytes = bytes.last(bytes.size() % Folding::wide_block);
  }
  if (bytes.size() >= Folding::block && Folding::is_supported()) {
    state_ = by_tables(0, Folding::fold(state_, bytes));
    bytes = bytes.last(bytes.size() % Folding::block);
  }
#endif
  state_ = by_tables(state_, bytes);
}

void Checksum::append(const Checksum& other) {
  // Rows of a dataset are of one length.
  thread_local std::uint64_t last_bytes = 0, last_shift = one;
  if (other.bytes_ != last_bytes) {
    last_shift = one;
    std::size_t k = 3;  // of bits
    for (std::uint64_t bytes = other.bytes_; bytes != 0; bytes >>= 1, ++k)
      if ((bytes & 1) != 0)
        last_shift = product(last_shift, squares.at(k));
    last_bytes = other.bytes_;
  }
  state_ = ~(product(last_shift, value()) ^ other.value());
  bytes_ += other.bytes_;
}

}  // namespace rubato
