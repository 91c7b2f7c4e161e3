// A build with MPI, and with an HDF5 that was built with it.

#include <vector>

#include <sys/vfs.h>
#include <unistd.h>

#include <rubato/record/detail/hdf5.hpp>
#include <rubato/record/together.hpp>

namespace rubato::record {

namespace {

detail::Handle open_together(const ranks::Communicator& ranks, const std::filesystem::path& file) {
  const std::string doing = "opening the file with all ranks";
  const detail::Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, doing);
  detail::check(H5Pset_fapl_mpio(access, *static_cast<const MPI_Comm*>(ranks.mpi()), MPI_INFO_NULL), doing);
  // What all ranks read alike one of them reads, and what they change alike is written in few pieces.
  detail::check(H5Pset_all_coll_metadata_ops(access, true), doing);
  detail::check(H5Pset_coll_metadata_write(access, true), doing);
  return {H5Fopen(file.c_str(), H5F_ACC_RDWR, access), H5Fclose, doing};
}

}  // namespace

bool can_write_together(const ranks::Communicator& ranks, const std::filesystem::path& file) {
  constexpr auto nfs = 0x6969;  // NFS_SUPER_MAGIC of <linux/magic.h>
  struct statfs system {};
  return ranks.size() > 1 && ranks.mpi() != nullptr && ::access(file.c_str(), R_OK | W_OK) == 0 &&
         ::statfs(file.c_str(), &system) == 0 && system.f_type != nfs;
}

void write_together(const ranks::Communicator& ranks, const std::filesystem::path& file,
                    std::span<const RowPart> parts) {
  detail::with_file(file, [&] {
    detail::Handle opened = open_together(ranks, file);
    const detail::Handle transfer(H5Pcreate(H5P_DATASET_XFER), H5Pclose, "writing rows");
    detail::check(H5Pset_dxpl_mpio(transfer, H5FD_MPIO_COLLECTIVE), "writing rows");
    try {
      for (const RowPart& part : parts) {
        const detail::Handle dataset = detail::open_dataset(opened, part.dataset);
        detail::write_part(dataset, H5T_NATIVE_DOUBLE, part.row, part.first * detail::plane_of(detail::extent(dataset)),
                           part.values.size(), part.values.data(), transfer);
      }
    } catch (...) {
      opened.release();  // closing it is for all ranks, and others may never come so far
      throw;
    }
    opened.close("writing the working file");
  });
}

}  // namespace rubato::record
