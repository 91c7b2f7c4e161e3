#pragma once

#include <string>
#include <vector>

#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/stated_action.hpp>

namespace rubato {

/// The named fields whose row of the variation does not approach their row of M z_t + Σ K_a z_{x_a} - ∇S(z): of smooth
/// fields that solve nothing, with fields that the action does not name as their own rows give them, the difference of
/// the two does not fall as steps and cells are halved. Empty also where a field that it does not name has no such row.
[[nodiscard]] std::vector<std::string> inconsistent_rows(const MultisymplecticSystem& system,
                                                         const StatedAction& stated);

}  // namespace rubato
