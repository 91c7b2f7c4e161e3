#pragma once

#include <string>

#include <rubato/formula/expression.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// The dispersion relation of waves e^{i(k·x - ωt)} c about z = 0,
///
///     det(-iωM + iΣ k_a K_a - S''(0)) = 0,
///
/// a polynomial with real coefficients, since the matrix is Hermitian. Fields without an equation of motion leave
/// factors that are no waves; of these only powers of ω and k are taken out.
struct DispersionRelation {
  /// Equal where waves are: the terms with the highest power of ω, and all others on the other side. Their variables
  /// are omega, k (in more dimensions k_x, k_y, k_z).
  formula::Expression left, right;
};

/// \throws std::invalid_argument where S'' is not defined at 0 or the determinant vanishes for all waves
[[nodiscard]] DispersionRelation dispersion_relation(const MultisymplecticSystem& system, formula::Graph& graph);

}  // namespace rubato
