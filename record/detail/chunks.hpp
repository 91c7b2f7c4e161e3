#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record::detail {

/// The 32 bits of Fletcher's checksum as HDF5's filter makes them: with the numbers w_0, …, w_{n-1} of two bytes each,
/// the higher one first, Σ w_i in the lower half and Σ (n - i) w_i in the higher, both modulo 2^16 - 1 and 0 written as
/// 2^16 - 1 unless all w are 0. To a single last byte belongs a lower one that is 0.
[[nodiscard]] std::uint32_t fletcher32(std::span<const std::byte> bytes);

/// Writes whole chunks of a dataset of which Fletcher's checksum is the only filter, without the copies that HDF5 makes
/// of them in its cache and for its filter.
class ChunkWriter {
public:
  /// Nothing if the dataset has other filters, or if its chunks are no pieces of its rows as they lie one after
  /// another.
  [[nodiscard]] static std::optional<ChunkWriter> of(hid_t dataset, Type type);

  /// How many bytes a chunk has of the rows if one begins `place` bytes behind the begin of all rows, or 0.
  [[nodiscard]] std::size_t bytes_at(std::size_t place) const;

  /// Bytes behind those of a chunk that write() needs.
  static constexpr std::size_t room_behind = sizeof(std::uint32_t);

  /// The chunk that begins there, within the extent of the dataset.
  /// \param bytes bytes_at(place), as they are stored; as many as `room_behind` behind them are written to, and are as
  /// before in the end
  /// \param sum becomes the checksum of all that is stored, if it is wanted: begun as that of nothing, or as that of
  /// `bytes` where it is known
  void write(std::size_t place, std::span<std::byte> bytes, Checksum* sum = nullptr);

  /// Where in the file the chunk is that begins there, if it has as many bytes as this checksum is of.
  [[nodiscard]] std::optional<KnownPiece> find(std::size_t place, const Checksum& stored) const;

private:
  ChunkWriter(hid_t dataset, std::vector<hsize_t> shape, const std::vector<hsize_t>& sizes, std::size_t value_bytes);

  [[nodiscard]] std::vector<hsize_t> first_of(std::size_t place) const;

  hid_t dataset_;
  std::vector<hsize_t> shape_;
  std::size_t row_bytes_, plane_bytes_;  ///< of a row, and of a place along its slowest dimension
  std::size_t rows_, block_bytes_;       ///< what is in a chunk: some rows, or a part of one
  std::vector<std::byte> padded_;        ///< a chunk that ends beyond the edge of a row
};

}  // namespace rubato::record::detail
