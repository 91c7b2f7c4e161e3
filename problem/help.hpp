#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace rubato {

/// What `rubato help TOPIC` prints, made of the tables that the parser of formulas and the reader of problem files go
/// by, so that it cannot be out of date: "formulas" has the functions, operators and names of a formula, "problem"
/// every table and key of a problem file, "scheme" and other names of tables those of one table, "table" the lines of
/// the table that a run prints. \throws std::invalid_argument, with the nearest topic, for another one
[[nodiscard]] std::string help_text(std::string_view topic);
/// Its topics.
[[nodiscard]] const std::vector<std::string>& help_topics();

}  // namespace rubato
