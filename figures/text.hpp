#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rubato/figures/statistics.hpp>

namespace rubato::figures {

/// Builds one JSON object. A number that is not finite has no JSON form and is left out with its key.
class JsonObject {
public:
  JsonObject& number(std::string_view key, double value);
  JsonObject& count(std::string_view key, std::size_t value);
  JsonObject& text(std::string_view key, std::string_view value);
  /// Left out where it is not true.
  JsonObject& flag(std::string_view key, bool value);
  /// One without entries is left out too.
  JsonObject& object(std::string_view key, const JsonObject& value);
  /// An array of numbers, found under "key/1", "key/2" …; left out without any, or if one is not finite.
  JsonObject& numbers(std::string_view key, const std::vector<double>& values);
  /// An array of objects.
  JsonObject& objects(std::string_view key, const std::vector<JsonObject>& values);
  /// An array of texts; one without entries is left out.
  JsonObject& texts(std::string_view key, const std::vector<std::string>& texts);
  /// An array of arrays of texts.
  JsonObject& lists(std::string_view key, const std::vector<std::vector<std::string>>& lists);
  [[nodiscard]] std::string str() const { return "{" + body_ + "}"; }
  /// The number under a key, or under keys inside each other: "h/min".
  [[nodiscard]] std::optional<double> find(std::string_view path) const;

private:
  JsonObject& raw(std::string_view key, std::string_view value);
  std::string body_;
  std::vector<std::pair<std::string, double>> numbers_;  ///< all there are, with the keys on the way to them
};

/// what, verdict, value, finding, remedy.
[[nodiscard]] JsonObject json(const Reason& reason);

/// Adds every figure under its key: absent where it does not apply, never NaN; values that are not defined are counted
/// under "undefined".
void add_figures(JsonObject& object, const Statistics& statistics);

/// The kinds of lines in the table that a run prints.
enum class LineKind {
  steps,
  h,
  discrete_energy,
  energy_less_work,
  step_potential,
  node_energy,
  node_energy_in_fictitious_time,
  node_energy_less_work,
  gamma,
  off_law,
  step_condition,
  laws,
  residual,
  constraint,
  exponents,
  megno,
  symplecticity,
  sponge,
  total,
  invariant,
  event,
  ended_by,
  error,
  iterations,
  seam,
  verdict,
  time_taken,
  accuracy,
  record,
};
/// What stands in front of a line, with NAME for a name of the problem, and what the line means.
struct LineEntry {
  LineKind kind;
  std::string_view label, meaning;
};
/// All kinds, in the order of the table.
[[nodiscard]] std::span<const LineEntry> line_entries();
/// The label of a line. \param name in place of NAME
[[nodiscard]] std::string label_of(LineKind kind, std::string_view name = {});

/// A line of the table a person reads: what, its value, and a remark or nothing. Headlines are what to look at first.
struct Line {
  std::string label, value, remark;
  bool is_headline = false;
};
[[nodiscard]] std::vector<Line> lines_of(const Statistics& statistics);

}  // namespace rubato::figures
