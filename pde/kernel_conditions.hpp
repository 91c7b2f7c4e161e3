#pragma once

#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// The constant vectors c with (θM - S''(z))c = 0 for all z, and as many conditions. On waves that are constant in
/// space the step's matrix is θM - S'', θ = 2/h, so these are its kernel on an odd grid, whatever the solution: for
/// KdV, BBM and Camassa–Holm one (φ and its multiplier together), for the good Boussinesq equation none (equations,
/// "Traps"). The mean of each potential involved is held; the columns span the left kernel.
[[nodiscard]] KernelConditions step_conditions(const MultisymplecticSystem& system, double h);

/// The same of θM - L, L symmetric and a value of S''. Its kernel may be larger: where θM - S''(z) is singular at every
/// z though no constant vector is mapped to 0, as where a force of place and time drives a potential, all of that
/// kernel counts. Where L is singular by chance, it does not: no condition mends that.
[[nodiscard]] KernelConditions wave_conditions(const MultisymplecticSystem& system, const Eigen::MatrixXd& L, double h);

/// Finds the waves on which the linear part μM + D - L, D = Σ_a ik_a K_a, may be singular for every μ: those on which D
/// maps the kernel of θM - L into its image under M. Where D = sM there, the matrix is that of the constant, at μ + s:
/// s = 0 where no derivative sees the kernel, and -i c·k in a frame of velocity c.
class KernelWaves {
public:
  KernelWaves(const Eigen::MatrixXd& M, const Eigen::MatrixXd& kernel);
  /// True if D is such a matrix; false where there is no kernel.
  [[nodiscard]] bool has(const Eigen::MatrixXcd& D) const;

private:
  Eigen::MatrixXcd kernel_;
  Eigen::MatrixXd sizes_;
  Eigen::MatrixXcd off_range_;  ///< an orthonormal basis of what is normal to M·kernel, in columns
};

/// Null vectors common to rowsᵀ S''(z) columns at random z.
[[nodiscard]] Eigen::MatrixXd common_null_space(const MultisymplecticSystem& system, double theta,
                                                const Eigen::MatrixXd& rows, const Eigen::MatrixXd& columns);

/// As many of the rows of `basis`, those of `preferred` first, as make it a nonsingular square matrix.
[[nodiscard]] std::vector<int> independent_rows(const Eigen::MatrixXcd& basis, const std::vector<int>& preferred);

}  // namespace rubato
