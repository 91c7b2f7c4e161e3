#pragma once

#include <map>
#include <string>

#include "audit/findings.hpp"
#include "audit/program.hpp"

namespace audit {

/// How much of a run's figures is rounding: bounds of what two evaluations of the same thing may differ by.
struct Roundings {
  long double energy = 0.0L, node_energy = 0.0L, gamma = 0.0L;
  std::map<std::string, long double> invariants, errors;
  long double scale = 0.0L;  ///< the largest sum of the magnitudes of the terms of H
};

/// What `run` and `check` report on one record, figure by figure. A sparse record keeps some of the steps only: there
/// `check` may see less than the run, and nothing else.
void compare_accounts(const Json& run, const Json& check, const Roundings& roundings, bool sparse,
                      Disagreements& findings);

/// Whether each number in the table is one of the JSON object, to the digits printed. `column` counts from 0: a table
/// of `compare` has one for each record.
void compare_table(const std::string& table, const Json& json, std::size_t column, Disagreements& findings);

/// Two records or two objects that have to be the same but for the time it took and the name of the file.
void same_account(const std::string& kind, const Json& first, const Json& second, Disagreements& findings);

}  // namespace audit
