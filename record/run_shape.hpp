#pragma once

#include <string>

#include <rubato/record/reader.hpp>

namespace rubato::record {

/// Of the record of a run (docs/records.md) the datasets that every run writes are there, with their types, and all
/// that lies along levels, steps, stored states or the grid is as long as these are. What reads such a record may rely
/// on it. Throws Error with the dataset.
void require_run(const Reader& reader);

/// True if an earlier version wrote the record: its steps cannot be taken again, nor its run be continued.
[[nodiscard]] bool is_of_earlier_version(const Reader& reader);

/// \throws Error if the run of the record cannot be continued, since an earlier version wrote it
void refuse_earlier_version(const Reader& reader, bool is_earlier);

/// Returns the path of the flags of the steps off the law.
[[nodiscard]] std::string off_law_path(const Reader& reader);

}  // namespace rubato::record
