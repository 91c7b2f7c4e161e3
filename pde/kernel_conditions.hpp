#pragma once

#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// The constant vectors c with (θM - S''(z))c = 0 for all z, and as many conditions. On waves that are constant in
/// space the step's matrix is θM - S'', θ = 2/h, so these are its kernel on an odd grid, whatever the solution: for
/// KdV, BBM and Camassa–Holm one (φ and its multiplier together), for the good Boussinesq equation none (equations,
/// "Traps"). The mean of each potential involved is held; the columns span the left kernel.
[[nodiscard]] KernelConditions step_conditions(const MultisymplecticSystem& system, double h);

/// Null vectors common to rowsᵀ S''(z) columns at random z.
[[nodiscard]] Eigen::MatrixXd common_null_space(const MultisymplecticSystem& system, double theta,
                                                const Eigen::MatrixXd& rows, const Eigen::MatrixXd& columns);

/// As many of the rows of `basis`, those of `preferred` first, as make it a nonsingular square matrix.
[[nodiscard]] std::vector<int> independent_rows(const Eigen::MatrixXcd& basis, const std::vector<int>& preferred);

}  // namespace rubato
