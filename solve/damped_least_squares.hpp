#pragma once

#include <cstddef>
#include <optional>

#include <Eigen/SparseCore>

#include <rubato/base/status.hpp>
#include <rubato/solve/sparse_factors.hpp>

namespace rubato::solve {

/// Solves min ‖Jx + r‖² + s²‖x‖² for sparse J of any shape and rank, by LU factorisation of
///
///     [[s I, J], [Jᵀ, -s I]] (y, x) = (-r, 0),
///
/// whose condition is that of J, not its square. With s = 0 and J square and regular x is Newton's correction. Where J
/// has a null space, x has no component in it: the correction of least norm, as s → 0. A component along a singular
/// vector with the value σ comes out smaller by the factor σ²/(σ² + s²).
class DampedLeastSquares {
public:
  /// \param damping s > 0
  /// \return Status::ill_conditioned where the factorisation fails, undefined where an entry is not finite
  Status factor(const Eigen::SparseMatrix<double>& J, double damping);
  /// With the J that was factored last. \return Status::ill_conditioned where x is not finite
  Status solve(const Eigen::VectorXd& r, Eigen::VectorXd& x);
  /// X = (JᵀJ + s²)⁻¹B s, likewise.
  Status solve_normal(const Eigen::MatrixXd& B, Eigen::MatrixXd& X);

private:
  SparseFactors factors_;
};

/// The number of eigenvalues of a sparse symmetric matrix below `shift`, by Sylvester's law of inertia from the signs
/// of D in LDLᵀ. Returns nothing if the factorisation meets a pivot of 0: take another shift.
/// \param matrix its lower triangle is read
[[nodiscard]] std::optional<std::size_t> eigenvalues_below(const Eigen::SparseMatrix<double>& matrix, double shift);

}  // namespace rubato::solve
