#pragma once

#include <map>
#include <string>
#include <vector>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record::detail {

/// Name of the attribute of the root that seals a record: one line "CHECKSUM KIND NAME" for each of its other
/// attributes, for each path of a dataset, and for the checkpoint. A dataset's checksum (CRC-64/XZ) is of its values
/// and of what says how to read them: type, sizes, description, the names of its dimensions and the scales attached to
/// them. It stands under the path, away from the dataset: one that is put in another's place brings nothing along that
/// would speak for it. The mark at the end of a file is gone as soon as another program writes to it; the seal stays.
/// Records of earlier versions have none.
inline constexpr const char* seal_attribute = "checksums";

/// Writes it, when all else is written.
///
/// \param values by path, of the growing datasets, row after row as they were appended; the others are read
void write_seal(hid_t file, const std::map<std::string, Checksum>& values);

/// Throws Failure, with the name, unless a sealed record has the attributes and exactly the datasets that it was
/// written with, whatever is in them.
void compare_list(hid_t file);

/// What is not what was written: names of attributes of the root, paths of datasets, "/checkpoint". Empty if the record
/// has no seal. Reads all values.
[[nodiscard]] std::vector<std::string> altered_names(hid_t file);

/// Throws Failure with the first of them.
void require_unaltered(hid_t file);

}  // namespace rubato::record::detail
