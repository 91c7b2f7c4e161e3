#pragma once

#include <filesystem>
#include <vector>

#include <rubato/record/reader.hpp>

namespace rubato::report {

/// Writes a record as text for spreadsheets and other programs, into a folder that is made if there is none:
///
///     levels.csv        level, t, gamma, node_energy, each invariant, total_NAME of each density
///     steps.csv         step, h, energy, iterations, off_law, step_condition, NAME_max and NAME_rms of each residual
///     states.csv        of an orbit: level, t, each coordinate and momentum, exact_NAME
///     field_NAME.csv    of a lattice, one file for each field, exact_NAME.csv and residual_NAME.csv likewise: one row
///                       of coordinates for each axis of the grid, then a row for each stored level; the first column
///                       names the axis, or holds t
///     output.csv        where there are output times: t, each coordinate and momentum, each quantity that is a number;
///                       on a lattice output_NAME.csv of fields and output_quantity_NAME.csv, as field_NAME.csv
///     events_NAME.csv   of each event: t, direction, stops, each coordinate, momentum and quantity at its crossings;
///     of an
///                       ensemble before them the number of the member
///     members.csv       of an ensemble, in place of these: one row for each member, its values and figures by their
///                       paths in the record, of an orbit its last state
///
/// Numbers have as many digits as it takes to read the same number back; what is not finite is written nan or inf.
/// Answers the files written. \throws record::AlreadyExists if one of them exists and `overwrite` is false;
/// record::Error
std::vector<std::filesystem::path> export_csv(const record::Reader& reader, const std::filesystem::path& folder,
                                              bool overwrite = false);

}  // namespace rubato::report
