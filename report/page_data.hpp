#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/report/budget.hpp>
#include <rubato/report/contents.hpp>
#include <rubato/report/packing.hpp>
#include <rubato/report/page.hpp>
#include <rubato/report/thinning.hpp>

/// The numbers of a page, as the JSON that its scripts read. Not part of the library's interface.
namespace rubato::report {

/// What a page shows of one record, and what is known of it.
struct Source {
  const record::Reader& reader;
  const Contents& contents;
  const figures::Statistics& summary;
  const Notes& notes;
};

/// The times of the levels that have a row, and of the stored ones, that users read: with time_scale physical ones.
///@{
[[nodiscard]] std::vector<double> level_times(const record::Reader& reader);
[[nodiscard]] std::vector<double> state_times(const record::Reader& reader);
///@}

/// "curves": what every record has per level and per step, its laws, and the errors of an orbit: [{"name", "group",
/// "initial", "count", "undefined", "rounding", "axis" or "x", "y"}, …]. Energies, totals and invariants are deviations
/// from "initial". "count" is the number of values, of which "undefined" are none; "axis" names one of "times" where
/// all are there. "rounding" is the size of what rounding leaves, where that is known.
/// "level_rows": {"rows", "levels"}: how many of the levels have a row in the record.
void write_curves(Json& json, const Source& source, const Resolution& resolution);

/// The times between which steps are off the law, those that touch as one.
[[nodiscard]] std::vector<std::pair<double, double>> off_law_spans(const record::Reader& reader);

/// "off_law": {"from", "to"}: the times between which steps are off the law; "off_law_count": how many of them.
void write_off_law(Json& json, const record::Reader& reader, const Resolution& resolution);

/// "sections": of each event with two quantities or more [{"name", "count", "columns": [{"name", "values"}]}].
void write_sections(Json& json, const Source& source, const Resolution& resolution);

/// A coordinate, a momentum or an exact solution: column `offset` of a dataset.
struct StateColumn {
  std::string name, group, path;
  std::size_t offset;
};
/// Those that a page shows of an orbit. Coordinates beyond the first 48 are left to the record; the page says so.
[[nodiscard]] std::vector<StateColumn> state_columns(const Contents& contents);

/// All of a dataset that has to have `rows` rows and a column number `column`. \throws record::Error
[[nodiscard]] std::vector<double> read_rows(const record::Reader& reader, const std::string& path, std::size_t rows,
                                            std::size_t column);

/// "states": an orbit's coordinates and momenta along the same selection of stored levels, and, where that is not all
/// of them, each against time by its own.
void write_states(Json& json, const Source& source, const Resolution& resolution);

/// "map_times" and "maps": a lattice's fields, errors and residual fields over space and time; "quantity_map_times" and
/// "quantity_maps": its node quantities.
void write_maps(Json& json, const Source& source, const Resolution& resolution);

/// How many curves write_curves() writes.
[[nodiscard]] std::size_t count_curves(const Contents& contents);

/// "title", "problem", "provenance" of one record; and with "summary".
void write_provenance(Json& json, const record::Reader& reader);
void write_description(Json& json, const Source& source);

}  // namespace rubato::report
