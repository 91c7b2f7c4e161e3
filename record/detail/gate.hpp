#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record::detail {

/// Every reader of a record comes through here before it reads a value. First the mark at the file's end shows whether
/// its bytes are those that were written; if they are not, the dataset that is damaged is looked for without reading
/// any text (HDF5 keeps texts where it has no checksums of its own to stop it). Then, since anybody may have written
/// the file, its structure is looked at as a whole: only groups and datasets of the types of records, joined by hard
/// links, each object once; every dataset with its data in the file itself, behind known filters, and with no more of
/// it than so many bytes can hold; attributes of the shape that is declared for them; the dimensions of growing
/// datasets named after scales in the same group that are as long; a checkpoint that is as it was written; the
/// attributes and the list of datasets of its seal. Throws Failure with the dataset or attribute.
///
/// \param descriptor of the same file
/// \returns intact, or unknown: then another program may have written to it, and what it holds is to be compared
///          with the seal
Integrity admit(hid_t file, int descriptor);

/// The names of a dataset's dimensions, as many as there are.
[[nodiscard]] std::vector<std::string> dimension_names(hid_t dataset, const std::string& path);

}  // namespace rubato::record::detail
