#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/page.hpp>

namespace rubato::report {

/// Two records side by side.
struct Comparison {
  std::array<std::string, 2> files;
  std::array<std::string, 2> titles;
  std::array<figures::Statistics, 2> statistics;
  /// What both have a line for, or one of them: label, value in the first, value in the second ("" where it has none).
  std::vector<std::array<std::string, 3>> lines;
  /// Lines of the problem files that only one of them has, in order, comments and blank lines left out.
  std::array<std::vector<std::string>, 2> only_in;
};

/// Brings problem texts that say the same in different ways into the same form, so that only differences in meaning are
/// told. Without one, texts are compared as they are, but for comments and blanks.
using Canonical = std::function<std::string(const std::string&)>;

/// \throws std::invalid_argument if the records have neither a coordinate nor a field in common: nothing in them can be
/// compared. Otherwise whatever differs is told, not judged. record::Error
[[nodiscard]] Comparison compare(const record::Reader& a, const record::Reader& b, const Canonical& canonical = {});

/// The table a person reads: figures side by side, then the lines in which the problems differ.
[[nodiscard]] std::string to_table(const Comparison& comparison);

/// One JSON object: {"records": [{"file", "steps", "h": {"min", "max"}, …}, {…}], "problem_differences": [[…], […]]},
/// with the keys of `rubato run --json`.
[[nodiscard]] std::string to_json(const Comparison& comparison);

/// One page with the curves of both laid over each other (see page.hpp). \throws as compare()
[[nodiscard]] std::string comparison_page(const record::Reader& a, const record::Reader& b,
                                          const PageOptions& options = {}, const Canonical& canonical = {});

}  // namespace rubato::report
