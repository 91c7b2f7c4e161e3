#pragma once

#include <rubato/record/reader.hpp>

namespace rubato::record {

/// Of the record of a run (docs/records.md) the datasets that every run writes are there, with their types, and all
/// that lies along levels, steps, stored states or the grid is as long as these are. What reads such a record may rely
/// on it. Throws Error with the dataset.
void require_run(const Reader& reader);

}  // namespace rubato::record
