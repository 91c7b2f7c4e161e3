// A build whose HDF5 knows nothing of MPI: rows come to rank 0.

#include <stdexcept>

#include <rubato/record/together.hpp>

namespace rubato::record {

bool can_write_together(const ranks::Communicator& /*ranks*/, const std::filesystem::path& /*file*/) {
  return false;
}

void write_together(const ranks::Communicator& /*ranks*/, const std::filesystem::path& /*file*/,
                    std::span<const RowPart> /*parts*/) {
  throw std::logic_error("record: this HDF5 was built without MPI");
}

}  // namespace rubato::record
