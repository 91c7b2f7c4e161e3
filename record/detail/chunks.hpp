#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record::detail {

/// The 32 bits of Fletcher's checksum as HDF5's filter makes them: with the numbers w_0, …, w_{n-1} of two bytes each,
/// the higher one first, Σ w_i in the lower half and Σ (n - i) w_i in the higher, both modulo 2^16 - 1 and 0 written as
/// 2^16 - 1 unless all w are 0. To a single last byte belongs a lower one that is 0.
/// \param copy where as many bytes are copied to on the way, if anywhere
[[nodiscard]] std::uint32_t fletcher32(std::span<const std::byte> bytes, std::byte* copy = nullptr);

/// Writes whole chunks of a dataset of which Fletcher's checksum is the only filter, without the copies that HDF5 makes
/// of them in its cache and for its filter.
class ChunkWriter {
public:
  /// Nothing if the dataset has other filters, or if its chunks are no pieces of its rows as they lie one after
  /// another.
  [[nodiscard]] static std::optional<ChunkWriter> of(hid_t dataset, Type type);

  /// How many bytes a chunk has of the rows if one begins `place` bytes behind the begin of all rows, or 0.
  [[nodiscard]] std::size_t bytes_at(std::size_t place) const;

  /// The chunk that begins there, within the extent of the dataset.
  /// \param bytes bytes_at(place), as they are stored
  void write(std::size_t place, std::span<const std::byte> bytes);

private:
  ChunkWriter(hid_t dataset, std::vector<hsize_t> shape, const std::vector<hsize_t>& sizes, std::size_t value_bytes);

  hid_t dataset_;
  std::vector<hsize_t> shape_;
  std::size_t row_bytes_, plane_bytes_;  ///< of a row, and of a place along its slowest dimension
  std::size_t rows_, block_bytes_;       ///< what is in a chunk: some rows, or a part of one
  std::vector<std::byte> stored_;
};

}  // namespace rubato::record::detail
