#pragma once

#include <rubato/record/reader.hpp>
#include <rubato/run/disagreements.hpp>
#include <rubato/run/run.hpp>

namespace rubato {

/// What a check of a record ends with: adds to the findings what only its checksum reports on (attributes, names of
/// coordinates, axes, another record's dataset), and shows all of them in the outcome, whose file is known.
void conclude(const record::Reader& reader, Disagreements& findings, Outcome& outcome);

}  // namespace rubato
