#pragma once

#include <vector>

#include "audit/bounded.hpp"

namespace audit {

/// What two levels and the step between them say: theory, sections 2, 4, 7 and 8, written out once more.
struct OrbitStep {
  /// What the step leaves of its equation: d = Jδ - ∇Φ_s(w, h), or z_{k+1} less where a map leads. Empty for a
  /// Lagrangian that has no such form.
  std::vector<Bounded> defect;
  /// ∂A/∂z_0 and ∂A/∂z_1 for (3.3), the same for every Lagrangian.
  std::vector<Bounded> first, second;
  Bounded energy;  ///< E = -∂A/∂h, without a step potential
};

}  // namespace audit
