#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>

namespace rubato::report {

struct PageOptions {
  /// The page is kept below this many bytes by thinning (see thinning.hpp), but never below what its text needs.
  std::size_t max_bytes = 5'000'000;
  /// Nothing is thinned, however large the page becomes.
  bool full = false;
};

/// One self-contained page about a record (HTML, UTF-8): it opens from a file, asks the network for nothing, and says
/// on itself what was thinned and how.
/// \throws record::Error
[[nodiscard]] std::string page(const record::Reader& reader, const PageOptions& options = {});

/// Writes a text as a file: whole or not at all. An existing file is replaced only if `overwrite` or if it is a page of
/// this library.
/// \throws record::AlreadyExists, record::Error
void write_page(const std::filesystem::path& file, const std::string& text, bool overwrite = false);

}  // namespace rubato::report
