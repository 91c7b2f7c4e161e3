#pragma once

#include <string>

#include <rubato/record/reader.hpp>

namespace rubato::record {

/// Of the record of a run (docs/records.md) the datasets that every run writes are there, with their types, and all
/// that lies along levels, steps, stored states or the grid is as long as these are. What reads such a record may rely
/// on it. Throws Error with the dataset.
void require_run(const Reader& reader);

/// What a checkpoint's states are made of, a number in the record: to be raised when a scheme saves what earlier
/// versions did not, and cannot do without it.
///@{
inline constexpr const char* state_version_name = "state_version";
inline constexpr double state_version = 2.0;
///@}

/// True if another version wrote the record, of other states: its steps cannot be taken again, nor its run be
/// continued.
[[nodiscard]] bool is_of_earlier_version(const Reader& reader);

/// \throws Error if it is
void refuse_earlier_version(const Reader& reader);

/// Returns the path of the flags of the steps off the law.
[[nodiscard]] std::string off_law_path(const Reader& reader);

}  // namespace rubato::record
