#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/report/contents.hpp>
#include <rubato/report/packing.hpp>
#include <rubato/report/page.hpp>
#include <rubato/report/summary.hpp>
#include <rubato/report/thinning.hpp>

/// The numbers of a page, as the JSON that its scripts read. Not part of the library's interface.
namespace rubato::report {

/// How finely a page shows what it shows.
struct Resolution {
  std::size_t curve_buckets;  ///< of each curve
  std::size_t state_buckets;  ///< of an orbit's states, shared by its coordinates
  std::size_t map_bytes;      ///< of all maps together, before base 64
};

/// "curves": what every record has per level and per step, and its laws: [{"name", "group", "initial", "count", "x",
/// "y"}, …]. Energies, totals and invariants are deviations from their first value, "initial". "count" is the number of
/// points of which the envelope was taken.
void write_curves(Json& json, const record::Reader& reader, const Contents& contents, const Resolution& resolution);

/// "bridges": [[t, t], …], the times between which steps were bridging.
void write_bridges(Json& json, const record::Reader& reader);

/// "states": an orbit's coordinates and momenta along the same selection of stored levels.
void write_states(Json& json, const record::Reader& reader, const Contents& contents, const Resolution& resolution);

/// "maps": a lattice's fields, errors and residual fields over space and time.
void write_maps(Json& json, const record::Reader& reader, const Contents& contents, const Resolution& resolution);

/// How many curves write_curves() writes.
[[nodiscard]] std::size_t count_curves(const Contents& contents);

/// "title", "summary", "problem", "provenance" of one record.
void write_description(Json& json, const record::Reader& reader, const Contents& contents);

}  // namespace rubato::report
