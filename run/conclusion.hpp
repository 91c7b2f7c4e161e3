#pragma once

#include <rubato/record/reader.hpp>
#include <rubato/run/findings.hpp>
#include <rubato/run/run.hpp>

namespace rubato {

/// What a check of a record ends with: adds to the findings what only its checksum tells of (attributes, names of
/// coordinates, axes, another record's dataset), and tells all of them in the outcome, whose file is known.
void conclude(const record::Reader& reader, Findings& findings, Outcome& outcome);

}  // namespace rubato
