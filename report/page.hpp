#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>

namespace rubato::report {

/// What only the problem of a record shows, not its numbers: given by who can read problems.
struct Notes {
  /// Names of fields in the order in which they are drawn: the unknown of the equation first. Those left out come last.
  std::vector<std::string> fields;
  /// Those that are drawn only if PageOptions::field names them.
  std::vector<std::string> auxiliary = {};
  /// By dataset ("/laws/energy_max", "/laws/fields/energy", "/levels/energy", "/laws/NAME"): the size of what rounding
  /// alone leaves of the law. Pictures say where it lies, and colours end there.
  std::map<std::string, double> rounding;
};

struct PageOptions {
  /// The most bytes a page has: it is thinned as far as that needs, and no further (docs/output.md says how).
  std::size_t max_bytes = 5'000'000;
  /// Nothing is thinned, however large the page becomes.
  bool full = false;
  /// The field of a lattice that is drawn first, and in full where there is room; empty: the first of the notes.
  std::string field = {};
  /// Asked once for each record; none: fields in the order of the record, and no levels of rounding.
  std::function<Notes(const record::Reader&)> notes = {};
};

/// One self-contained page about a record (HTML, UTF-8): it opens from a file, asks the network for nothing, and says
/// on itself what was thinned and how.
/// \throws record::Error; std::invalid_argument, which names the least possible size, if `max_bytes` are too few
[[nodiscard]] std::string page(const record::Reader& reader, const PageOptions& options = {});

/// Writes a text as a file: whole or not at all. An existing file is replaced only if `overwrite` or if it is a page of
/// this library.
/// \throws record::AlreadyExists, record::Error
void write_page(const std::filesystem::path& file, const std::string& text, bool overwrite = false);

}  // namespace rubato::report
