#pragma once

#include <stdexcept>

#include <Eigen/Core>

/// \file
/// Darboux matrices and the fractional transforms they induce (Section 4 of the paper; theory, section 4): linear maps
/// between symplectic and symmetric matrices, and, applied to the flow of a Hamiltonian, its generating functions.
///
/// J = [[0, I], [-I, 0]] for z = (q, p). With it in place of the paper's J (for (p, q)) every formula reads the same.

namespace rubato {

/// The types of generating function that have a name: their normal Darboux matrices belong to
/// F = 0, [[0, I], [I, 0]] and -[[0, I], [I, 0]], that is to w = (ẑ + z)/2, (q̂, p) and (q, p̂).
enum class DarbouxType { midpoint, euler_a, euler_b };

/// J of size 2n.
[[nodiscard]] Eigen::MatrixXd symplectic_unit(Eigen::Index n);
/// J m of a matrix with 2n rows, by their exchange.
[[nodiscard]] Eigen::MatrixXd turned(const Eigen::MatrixXd& m);
/// E_F = (I + JF)/2, the weight of ẑ in w = (I - E_F) z + E_F ẑ. \throws std::invalid_argument as
/// check_darboux_symmetric
[[nodiscard]] Eigen::MatrixXd darboux_weight(const Eigen::MatrixXd& F);

/// The symmetric 2n × 2n matrix F of a named type.
[[nodiscard]] Eigen::MatrixXd darboux_symmetric(DarbouxType type, Eigen::Index n);

/// \throws std::invalid_argument, naming the size or the first pair of entries that differ, unless F is symmetric,
/// finite and of size 2n × 2n
void check_darboux_symmetric(const Eigen::MatrixXd& F, Eigen::Index n);

/// True if αᵀ [[0, -I], [I, 0]] α = [[J, 0], [0, -J]] (4.2), for α of size 4n × 4n, each entry to `tolerance` times the
/// largest |α_ij|².
[[nodiscard]] bool is_darboux(const Eigen::MatrixXd& alpha, double tolerance = 1e-12);

/// (4.4): α = [[J, -J], [E, I - E]], E = (I + JF)/2. With F = 0 it is (4.6).
/// \throws std::invalid_argument as check_darboux_symmetric
[[nodiscard]] Eigen::MatrixXd normal_darboux(const Eigen::MatrixXd& F);

/// (4.5): α⁻¹ = [[(E - I)J, I], [EJ, I]]. \throws std::invalid_argument as check_darboux_symmetric
[[nodiscard]] Eigen::MatrixXd normal_darboux_inverse(const Eigen::MatrixXd& F);

/// True if SᵀJS = J, each entry to `tolerance` times the largest |S_ij|².
[[nodiscard]] bool is_symplectic(const Eigen::MatrixXd& S, double tolerance = 1e-10);

/// σ_α(S) = (AS + B)(CS + D)⁻¹, a symmetric matrix, for α = [[A, B], [C, D]]. Defined for symplectic S (2n × 2n) with
/// CS + D regular; for a normal Darboux matrix that is so near S = I, which goes to 0.
/// \throws std::invalid_argument outside: α not Darboux, S not symplectic, sizes that do not fit, or CS + D singular to
/// working accuracy (a pivot below 1e-13 of the largest)
[[nodiscard]] Eigen::MatrixXd fractional_transform(const Eigen::MatrixXd& alpha, const Eigen::MatrixXd& S);

/// σ_α⁻¹(M) = (A₁M + B₁)(C₁M + D₁)⁻¹, a symplectic matrix, with α⁻¹ = [[A₁, B₁], [C₁, D₁]] (the inverse is
/// [[-J, 0], [0, J]] αᵀ [[0, -I], [I, 0]] by (4.2)). Defined for symmetric M with C₁M + D₁ regular.
/// \throws std::invalid_argument outside, as fractional_transform
[[nodiscard]] Eigen::MatrixXd inverse_fractional_transform(const Eigen::MatrixXd& alpha, const Eigen::MatrixXd& M);

/// A generating function whose two-step equation has no solution from an arbitrary starting pair.
class StartingPairError : public std::invalid_argument {
public:
  using std::invalid_argument::invalid_argument;
};

/// With the defect d_k = Jδ_k - ∇Φ the two-step equation (3.3) of type F is (I + FJ) d_k + (I - FJ) d_{k-1} = 0
/// (theory, section 4): the parasite of an arbitrary starting pair is multiplied by -(I + FJ)⁻¹(I - FJ) in every step.
/// It is bounded where all eigenvalues of FJ are imaginary and semisimple (F = 0, F definite) and grows otherwise.
/// \throws StartingPairError if I + FJ is singular, as for both Euler types: there d_k = 0 follows, no two-step map
/// exists, and an arbitrary starting pair cannot be continued
[[nodiscard]] Eigen::MatrixXd parasite_matrix(const Eigen::MatrixXd& F);

}  // namespace rubato
