#pragma once

#include <random>
#include <vector>

#include <Eigen/Core>

namespace rubato {

class MultisymplecticSystem;

/// What the matrices and S of M z_t + Σ K_a z_{x_a} = ∇S(z) say about its fields; derived from them alone.
///
/// Rows of the equation in ker M are constraints in space only: nᵀ(Σ K_a z_{x_a} - ∇S(z)) = 0 for n in ker M (M is
/// skew, so left and right kernel agree). The part of z in ker M has no equation of motion. Where "generic" is said,
/// ranks are those at random wave numbers and random values of the fields.
struct FieldStructure {
  /// A basis of ker M as columns, in reduced echelon form: unit vectors wherever the kernel allows.
  Eigen::MatrixXd kernel;
  /// True if the unit vector of the field lies in ker M: only space derivatives of the field occur.
  std::vector<bool> algebraic;
  /// True if no constraint of a single level determines the field (w of KdV; p and w of BBM): it exists at midpoints
  /// only, where the step determines it.
  std::vector<bool> multiplier;
  /// Fields that a level determines, by a constraint which is not linear in z (p of the good Boussinesq equation): the
  /// mean of two levels' values is not the value at the midpoint, which therefore is kept apart.
  std::vector<bool> nonlinear;
  /// True if S does not depend on the field: z + c e_f is a solution with z, and f may be m·x + periodic.
  std::vector<bool> potential;
  /// Constant vectors b with b·∇S = 0 for all z, as columns in reduced echelon form: (bᵀMz)_t + Σ (bᵀK_a z)_{x_a} = 0.
  Eigen::MatrixXd affine_symmetries;
  /// M = M₊ - M₊ᵀ, K_a = K₊ - K₊ᵀ, with potentials in the rows of M₊, K₊ and, for other fields, algebraic ones in its
  /// columns: densities are then free of bare potentials and multipliers (energy density S + Σ z_{x_a}ᵀK₊z). Of K_a,
  /// any other fields have rows or columns so that those which M joins have the same: δ⁺ in rows of K₊ are differences
  /// of a staggered grid. Where K joins these, too, both have half of the entry: differences are central.
  Eigen::MatrixXd M_plus;
  std::vector<Eigen::MatrixXd> K_plus;
  /// The columns of `kernel` whose constraint holds at every level, free of multipliers.
  Eigen::MatrixXd level_constraints;

  /// multiplier or nonlinear: the scheme keeps the field's midpoint value, and nothing at levels.
  [[nodiscard]] bool at_midpoints(int field) const {
    return multiplier[static_cast<std::size_t>(field)] || nonlinear[static_cast<std::size_t>(field)];
  }
  /// The same for every field.
  [[nodiscard]] std::vector<bool> at_midpoints() const {
    std::vector<bool> all = multiplier;
    for (std::size_t f = 0; f < all.size(); ++f) {
      all[f] = all[f] || nonlinear[f];
    }
    return all;
  }
};

/// \throws std::invalid_argument naming the field if one is not determined by the equation, or if a constraint that is
/// not linear binds a combination of fields that is not a field of its own, or binds a field in which S is not linear
[[nodiscard]] FieldStructure analyse(const MultisymplecticSystem& system);

/// S'' at a random point where it is finite; if none is found, its constant part with random values for the others.
[[nodiscard]] Eigen::MatrixXd generic_hessian(const MultisymplecticSystem& system, std::mt19937_64& random);

/// An orthonormal basis of the kernel, singular values below 1e-10 of the largest counting as zero once rows and
/// columns are scaled to entries of about 1.
[[nodiscard]] Eigen::MatrixXcd null_space(const Eigen::MatrixXcd& matrix);
[[nodiscard]] Eigen::MatrixXd null_space(const Eigen::MatrixXd& matrix);
[[nodiscard]] Eigen::Index rank(const Eigen::MatrixXcd& matrix);
/// The column space of `basis` in reduced column echelon form; entries below 1e-9 are 0.
[[nodiscard]] Eigen::MatrixXd column_echelon(Eigen::MatrixXd basis);

}  // namespace rubato
