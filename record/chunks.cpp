#include <rubato/record/detail/chunks.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/record/detail/structure.hpp>

namespace rubato::record::detail {

namespace {

constexpr std::uint64_t modulus = 0xFFFF;

/// Modulo 2^16 - 1 a number of two bytes is 256 times the one with its bytes in the other order.
constexpr std::uint64_t turn = std::endian::native == std::endian::little ? 256 : 1;

/// 16 numbers of two bytes, and as many sums, which stay in registers.
constexpr std::size_t lanes = 16;
using Numbers [[gnu::vector_size(2 * lanes)]] = std::uint16_t;
using LaneSums [[gnu::vector_size(4 * lanes)]] = std::uint32_t;
static_assert(sizeof(Numbers) == 2 * lanes && sizeof(LaneSums) == 4 * lanes);

/// Of number r of each lane, r = 0, …, R - 1, the sum and the one with weights R - r.
RUBATO_WIDE_VECTORS void add_in_lanes(const std::byte* bytes, std::size_t rounds, std::uint32_t* sums,
                                      std::uint32_t* weighted) {
  LaneSums sum = {}, weighted_sum = {};
  for (std::size_t r = 0; r < rounds; ++r) {
    Numbers numbers;
    std::memcpy(&numbers, bytes + r * sizeof numbers, sizeof numbers);
    sum += __builtin_convertvector(numbers, LaneSums);
    weighted_sum += sum;
  }
  std::memcpy(sums, &sum, sizeof sum);
  std::memcpy(weighted, &weighted_sum, sizeof weighted_sum);
}

/// Σ w_i and Σ (n - i) w_i of numbers of two bytes as the processor has them.
class Sums {
public:
  void add(std::uint16_t number) {
    sum_ += number;
    weighted_ += sum_;
    reduce();
  }

  /// 16 sums side by side: number i = 16 r + l of n = 16 R has the weight n - i = 16 (R - r) - l.
  void add_side_by_side(const std::byte* bytes, std::size_t rounds) {
    std::array<std::uint32_t, lanes> sums, weighted;
    add_in_lanes(bytes, rounds, sums.data(), weighted.data());
    weighted_ += lanes * rounds * sum_;
    for (std::size_t l = 0; l < lanes; ++l) {
      weighted_ += std::uint64_t{lanes} * weighted[l] - l * sums[l];
      sum_ += sums[l];
    }
    reduce();
  }

  [[nodiscard]] std::uint32_t value() const {
    const auto half = [&](std::uint64_t sum) {
      const std::uint64_t turned = sum * turn % modulus;
      return static_cast<std::uint32_t>(turned == 0 && !all_zero_ ? modulus : turned);
    };
    return half(weighted_) << 16 | half(sum_);
  }

  /// The weighted sum of a lane, of 2^16 r (r + 1)/2 at most, fits into 32 bits.
  static constexpr std::size_t most_rounds = 256;

private:
  void reduce() {
    all_zero_ = all_zero_ && sum_ == 0;
    sum_ %= modulus;
    weighted_ %= modulus;
  }

  std::uint64_t sum_ = 0, weighted_ = 0;
  bool all_zero_ = true;
};

}  // namespace

std::uint32_t fletcher32(std::span<const std::byte> bytes) {
  constexpr std::size_t round_bytes = 2 * lanes;
  Sums sums;
  for (std::size_t rounds; (rounds = std::min(Sums::most_rounds, bytes.size() / round_bytes)) > 0;) {
    sums.add_side_by_side(bytes.data(), rounds);
    bytes = bytes.subspan(rounds * round_bytes);
  }
  for (; !bytes.empty(); bytes = bytes.subspan(std::min<std::size_t>(2, bytes.size()))) {
    std::uint16_t number = 0;
    std::memcpy(&number, bytes.data(), std::min(sizeof number, bytes.size()));
    sums.add(number);
  }
  return sums.value();
}

std::optional<ChunkWriter> ChunkWriter::of(hid_t dataset, Type type) {
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose, "looking at a dataset");
  const Handle stored(H5Dget_type(dataset), H5Tclose, "looking at a dataset");
  if (H5Pget_layout(properties) != H5D_CHUNKED || H5Pget_nfilters(properties) != 1 ||
      H5Tequal(stored, memory_type(type)) <= 0)
    return std::nullopt;
  unsigned flags = 0;
  std::size_t parameters = 0;
  if (H5Pget_filter2(properties, 0, &flags, &parameters, nullptr, 0, nullptr, nullptr) != H5Z_FILTER_FLETCHER32)
    return std::nullopt;
  const std::vector<hsize_t> sizes = extent(dataset);
  std::vector<hsize_t> shape = chunk_of(dataset);
  const bool has_whole_planes = sizes.size() < 3 || std::equal(sizes.begin() + 2, sizes.end(), shape.begin() + 2);
  const bool has_whole_rows = sizes.size() < 2 || shape[1] == sizes[1];
  if (!has_whole_planes || (!has_whole_rows && shape[0] > 1))
    return std::nullopt;
  return ChunkWriter(dataset, std::move(shape), sizes, size_of(type));
}

ChunkWriter::ChunkWriter(hid_t dataset, std::vector<hsize_t> shape, const std::vector<hsize_t>& sizes,
                         std::size_t value_bytes)
    : dataset_(dataset),
      shape_(std::move(shape)),
      row_bytes_(value_bytes),
      plane_bytes_(value_bytes * plane_of(sizes)),
      rows_(shape_.front()) {
  for (std::size_t i = 1; i < sizes.size(); ++i)
    row_bytes_ *= sizes[i];
  block_bytes_ = shape_.size() < 2 ? row_bytes_ : plane_bytes_ * shape_[1];
}

std::size_t ChunkWriter::bytes_at(std::size_t place) const {
  if (block_bytes_ == row_bytes_)
    return place % (rows_ * row_bytes_) == 0 ? rows_ * row_bytes_ : 0;
  const std::size_t begin = place % row_bytes_;
  return begin % block_bytes_ == 0 ? std::min(block_bytes_, row_bytes_ - begin) : 0;
}

std::vector<hsize_t> ChunkWriter::first_of(std::size_t place) const {
  std::vector<hsize_t> first(shape_.size(), 0);
  first[0] = place / row_bytes_;
  if (first.size() > 1)
    first[1] = place % row_bytes_ / plane_bytes_;
  return first;
}

void ChunkWriter::write(std::size_t place, std::span<std::byte> bytes, Checksum* sum) {
  const std::size_t size = rows_ * block_bytes_;
  if (bytes.size() < size) {  // the last of a row
    padded_.assign(size + room_behind, std::byte{0});
    std::ranges::copy(bytes, padded_.begin());
    if (sum != nullptr && sum->bytes() > 0)
      sum->add(std::span(padded_).subspan(bytes.size(), size - bytes.size()));
    bytes = std::span(padded_).first(size);
  }
  // The filter's sum follows the bytes: its place is borrowed from what stands there.
  const std::span<std::byte> behind(bytes.data() + size, room_behind);
  std::array<std::byte, room_behind> borrowed;
  std::ranges::copy(behind, borrowed.begin());
  const std::uint32_t filtered = fletcher32(bytes);
  std::memcpy(behind.data(), &filtered, sizeof filtered);
  if (sum != nullptr) {
    if (sum->bytes() == 0)
      sum->add(bytes);
    sum->add(behind);
  }
  const std::vector<hsize_t> first = first_of(place);
  const herr_t status = H5Dwrite_chunk(dataset_, H5P_DEFAULT, 0, first.data(), size + room_behind, bytes.data());
  std::ranges::copy(borrowed, behind.begin());
  check(status, "writing rows");
}

std::optional<KnownPiece> ChunkWriter::find(std::size_t place, const Checksum& stored) const {
  const std::vector<hsize_t> first = first_of(place);
  unsigned skipped = 0;
  haddr_t address = HADDR_UNDEF;
  hsize_t size = 0;
  check(H5Dget_chunk_info_by_coord(dataset_, first.data(), &skipped, &address, &size), "looking for a chunk");
  if (address == HADDR_UNDEF || size != stored.bytes())
    return std::nullopt;
  return KnownPiece{address, stored};
}

}  // namespace rubato::record::detail
