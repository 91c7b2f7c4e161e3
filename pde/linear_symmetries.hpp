#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// The linear symmetries z -> exp(sB) z of an equation: all B with BᵀM + MB = 0, BᵀK_a + K_a B = 0 and ∇S(z)·Bz = 0
/// for every z. These are linear equations for the entries of B, the last at random z; rounding decides at 1e-10. The
/// z have sizes at which no term of S is lost beside the others, and B is found in these units.
class LinearSymmetries {
public:
  explicit LinearSymmetries(const MultisymplecticSystem& system);

  /// A basis of those whose span with `known` is all; in reduced echelon form, row by row.
  [[nodiscard]] std::vector<Eigen::MatrixXd> beside(const std::vector<Eigen::MatrixXd>& known) const;
  /// True if B is no combination of `known`.
  [[nodiscard]] static bool is_beside(const Eigen::MatrixXd& B, const std::vector<Eigen::MatrixXd>& known);
  /// The one that turns the phase of ψ = z_p + i z_q: of ψ -> exp(is) ψ. Nothing if there is none.
  [[nodiscard]] std::optional<Eigen::MatrixXd> phase(int p, int q) const;

private:
  /// A column of basis_ as B.
  [[nodiscard]] Eigen::MatrixXd in_fields(const Eigen::VectorXd& column) const;

  Eigen::Index fields_;
  Eigen::VectorXd units_;  ///< of the fields, powers of 2
  Eigen::MatrixXd basis_;  ///< columns are matrices U⁻¹BU, row by row
};

}  // namespace rubato
