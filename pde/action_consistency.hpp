#pragma once

#include <string>
#include <vector>

#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/stated_action.hpp>

namespace rubato {

/// Whether the variation of a stated action is that of the equation.
struct ActionConsistency {
  /// False where a field that the action does not name has no rows that give it, or a row is not defined at the fields
  /// of the test.
  bool is_tested = false;
  /// The named fields whose row of the variation does not approach their row of M z_t + Σ K_a z_{x_a} - ∇S(z): of
  /// smooth fields that solve nothing, with fields that the action does not name as rows of the equation give them, the
  /// difference of the two does not fall as steps and cells are halved.
  std::vector<std::string> wrong;
  double off = 0.0;  ///< the largest such difference, relative to the terms of the row
};
[[nodiscard]] ActionConsistency consistency_of(const MultisymplecticSystem& system, const StatedAction& stated);

}  // namespace rubato
