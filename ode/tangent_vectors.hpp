#pragma once

#include <memory>
#include <span>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/base/status.hpp>
#include <rubato/ode/orbit_tangent.hpp>

namespace rubato {

/// Orthonormal vectors v_1 … v_n, Jv_n … Jv_1 of 2n entries, the first `count` of them one after the other: e_1 … e_n,
/// Je_n … Je_1 turned by a unitary matrix that is drawn once, with a fixed seed. Hence dp∧dq pairs the i-th with the
/// i-th from the end alone, and no vector lies in a plane that a special motion leaves invariant.
/// Precondition: count ≤ 2n.
[[nodiscard]] std::vector<double> symplectic_start(std::size_t degrees_of_freedom, std::size_t count);

/// The largest |(dp∧dq)(u', v') - (dp∧dq)(u, v)| over pairs of columns before and after a step, in units of |u'| |v'|
/// and of |u| |v|, whichever are larger: what a step that preserves the two-form leaves is rounding errors. With one
/// column there is no pair, and the result is not a number.
[[nodiscard]] double two_form_defect(std::span<const double> before, std::span<const double> after, std::size_t count);

/// Tangent vectors along an orbit (Benettin, Galgani, Giorgilli and Strelcyn, Meccanica 15, 1980): each step takes them
/// by the tangent of the scheme and makes them orthonormal again, V = QR, so that the sums of ln r_ii over the time are
/// the Lyapunov exponents of the discrete flow. With all 2n of them from symplectic_start() each R is symplectic, and
/// ln r_ii cancels that of the i-th from the end in every step.
///
/// Lengths and angles of vectors are those in units u_i of q_i and 1/u_i of p_i, powers of 2 that make rows and columns
/// of the first step's tangent about even (Parlett and Reinsch 1969). They leave dp∧dq as it is, and a problem in other
/// units has the same exponents. A first step without force determines no u_i by its p_i: for that the force is taken
/// to be the weakest that turns the motion in some 6,000 steps.
///
/// Besides them, on request, the columns of the state-transition matrix ∂z_k/∂z_0, which are left as they become.
class TangentVectors {
public:
  /// \param dimension 2n; \param count of the vectors, at most 2n \throws std::invalid_argument otherwise
  TangentVectors(std::unique_ptr<OrbitTangent> tangent, std::size_t dimension, std::size_t count, bool with_matrix);

  /// Takes the step, which follows the one taken last. Once it fails all that follows is not a number.
  [[nodiscard]] Status step(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h);

  [[nodiscard]] std::size_t count() const { return count_; }
  /// Of the step taken last: ln r_ii of each vector, and two_form_defect().
  ///@{
  [[nodiscard]] std::span<const double> logarithms() const { return logarithms_; }
  [[nodiscard]] double defect() const { return defect_; }
  ///@}
  /// ∂z_k/∂z_0, 2n × 2n, row by row; empty where it was not asked for.
  [[nodiscard]] std::span<const double> matrix() const { return matrix_; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  [[nodiscard]] Status fail(Status status);
  void read_matrix();
  /// From the tangent of the first step. Carries the vectors, which are orthonormal in these units, along.
  [[nodiscard]] Status find_units(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h);
  /// The vectors among `columns`, of `size` entries each, to their units, or back.
  void to_units(std::span<double> columns, std::size_t size, bool back = false) const;

  std::unique_ptr<OrbitTangent> tangent_;
  std::size_t dimension_, count_;
  bool begun_ = false;         ///< true if columns are what the tangent carries, and no longer variations of z_0
  std::vector<double> units_;  ///< of the coordinates
  std::vector<double> columns_, before_, logarithms_, matrix_;
  double defect_ = 0.0;
};

}  // namespace rubato
