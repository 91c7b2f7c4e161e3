#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/report/packing.hpp>

/// What a page shows of an ensemble, as the JSON that its scripts read. Not part of the library's interface.
namespace rubato::report {

/// True if the record is one of many runs.
[[nodiscard]] bool is_ensemble(const record::Reader& reader);

/// One array over the members.
struct MemberColumn {
  std::string name, group, label, path;
  std::size_t offset = 0;
};
/// What members were given ("given"), then how they ended and their figures ("figure"), and the last states of orbits
/// ("last").
[[nodiscard]] std::vector<MemberColumn> member_columns(const record::Reader& reader);
/// \throws record::Error where it is not as long as there are members
[[nodiscard]] std::vector<double> read_column(const record::Reader& reader, const MemberColumn& column);

/// "summary": the lines of the ensemble's table.
void write_ensemble_summary(Json& json, const record::Reader& reader);

/// "members": {"count", "columns": [{"name", "group", "label", "words", "values"}]}: what members were given, how they
/// ended, their figures, and where orbits ended; "paths": [{"name", "values"}] of orbits at output times, whole
/// members, "path_members": {"count", "shown"}, or null; "sections" as those of a run, with the members. No array has
/// more than `most_rows` numbers: of more members every n-th is there, and of crossings every n-th. \throws
/// record::Error where the columns are not as long as each other
void write_ensemble(Json& json, const record::Reader& reader, std::size_t most_rows);

/// How many arrays write_ensemble() writes.
[[nodiscard]] std::size_t count_ensemble_columns(const record::Reader& reader);

}  // namespace rubato::report
