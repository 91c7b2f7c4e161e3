#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>

#include <rubato/ranks/communicator.hpp>
#include <rubato/record/layout.hpp>

/// Rows that the ranks of a job write into one working file together, each the part that it has, with one collective
/// write for each dataset. They are rows so long that each fills chunks by itself; all else is for Writer, at rank 0.
/// The chunks of such datasets get their places in the file before.
namespace rubato::record {

/// True if rows of this dataset are so long: of 128 KiB at least, in a chunk or several.
[[nodiscard]] bool is_long(const Layout& layout, const Dataset& dataset);

/// True if this rank can write this file with others: HDF5 was built with MPI, the job has more ranks than one, and the
/// file is there, on a file system that keeps what several processes write apart (not NFS). All of them have to say so.
[[nodiscard]] bool can_write_together(const ranks::Communicator& ranks, const std::filesystem::path& file);

/// What a rank has of a row: the values from one place along the slowest dimension to another.
struct RowPart {
  std::string dataset;
  std::size_t row = 0;
  std::size_t first = 0;  ///< place along the slowest dimension
  std::span<const double> values;
};

/// Writes rows for which Writer::make_room() has made room, each of which is whole with the parts of all ranks. All of
/// them call it with the same datasets and rows in the same order, and nobody else has the file open. The file is
/// closed again when it returns. Throws Error; other ranks may then wait for this one for ever, so that it has to end
/// the job.
void write_together(const ranks::Communicator& ranks, const std::filesystem::path& file,
                    std::span<const RowPart> parts);

}  // namespace rubato::record
