#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include <rubato/figures/members.hpp>
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
/// reported. Without one, texts are compared as they are, but for comments and blanks.
using Canonical = std::function<std::string(const std::string&)>;

/// \throws std::invalid_argument if the records have neither a coordinate nor a field in common: nothing in them can be
/// compared. Otherwise whatever differs is reported, not judged. record::Error
[[nodiscard]] Comparison compare(const record::Reader& a, const record::Reader& b, const Canonical& canonical = {});

/// The table a person reads: figures side by side, then the lines in which the problems differ.
[[nodiscard]] std::string to_table(const Comparison& comparison);

/// One JSON object: {"records": [{"file", "steps", "h": {"min", "max"}, …}, {…}], "problem_differences": [[…], […]]},
/// with the keys of `rubato run --json`.
[[nodiscard]] std::string to_json(const Comparison& comparison);

/// Two records of ensembles: figures side by side, and members with the same number that were given the same one by
/// one.
struct EnsembleComparison {
  struct Column {
    std::string name, label;                      ///< of a figure, or of a coordinate or momentum at the end
    std::array<figures::Distribution, 2> values;  ///< over all members of each
    std::size_t same = 0;                         ///< members with the same number in both, or with none in both
    double farthest = 0.0;                        ///< the largest difference; infinite where only one has a number
    std::size_t member = 0;                       ///< where that is
    std::array<double, 2> there{};                ///< the two values
  };

  std::array<std::string, 2> files;
  std::array<std::string, 2> titles;
  std::array<std::size_t, 2> members{}, ended_early{};
  std::size_t alike = 0;  ///< members that were given the same in both
  std::vector<Column> columns;
  std::array<std::vector<std::string>, 2> only_in;  ///< as of a Comparison
};
/// \throws std::invalid_argument if only one is an ensemble, or one is of orbits and the other of lattices, or the
/// records have no figure in common; record::Error
[[nodiscard]] EnsembleComparison compare_ensembles(const record::Reader& a, const record::Reader& b,
                                                   const Canonical& canonical = {});
[[nodiscard]] std::string to_table(const EnsembleComparison& comparison);
/// {"records": [{"file", "members", "ended_early"}, …], "members_alike", "figures": [{"name", "records": [{"min",
/// "max", "mean", "worst"}, …], "same", "farthest", "member", "there": [{"value"}, …]}, …], "problem_differences"}
[[nodiscard]] std::string to_json(const EnsembleComparison& comparison);

/// Lines of the problems of two records that only one of them has, in order, comments and blank lines left out.
[[nodiscard]] std::array<std::vector<std::string>, 2> problem_differences(const record::Reader& a,
                                                                          const record::Reader& b,
                                                                          const Canonical& canonical);
/// Parts of the tables: rows of a label and two values under the titles, and the lines in which the problems differ.
///@{
[[nodiscard]] std::string table_side_by_side(const std::array<std::string, 2>& titles,
                                             const std::array<std::string, 2>& files,
                                             const std::vector<std::array<std::string, 3>>& lines);
[[nodiscard]] std::string told_differences(const std::array<std::string, 2>& files,
                                           const std::array<std::vector<std::string>, 2>& only_in);
///@}

/// One page with the curves of both laid over each other (see page.hpp). \throws as compare()
[[nodiscard]] std::string comparison_page(const record::Reader& a, const record::Reader& b,
                                          const PageOptions& options = {}, const Canonical& canonical = {});

}  // namespace rubato::report
