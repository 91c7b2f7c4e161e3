#pragma once

#include <functional>
#include <string>

#include "audit/levels_judge.hpp"

namespace audit {

/// One problem, and who judges its record.
struct Case {
  std::string problem;  ///< the text of the problem file
  LevelRules rules;
  int max_steps = 0;
  bool automatic = false;  ///< the first step is chosen by trial runs, which know the end
  /// The same problem with a constant added to H, or to the integral of S.
  std::function<std::string(double constant)> shifted;
  std::function<Roundings(const Stored& record, const Json& reported, Disagreements& findings)> judge;
};

/// Runs a problem through the program's commands and judges all that they say.
void audit_case(const std::string& program, const Case& which, Disagreements& findings);

}  // namespace audit
