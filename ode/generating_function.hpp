#pragma once

#include <memory>
#include <span>
#include <string>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/ode/darboux.hpp>
#include <rubato/ode/generating_nodes.hpp>
#include <rubato/ode/hamiltonian.hpp>

namespace rubato {

/// The generating function of the flow of a Hamiltonian, of the normal Darboux type with the symmetric matrix F, as a
/// power series in t (Section 4 of the paper; theory, section 4):
///
///     J(ẑ - z) = ∇φ(w, t),   w = ½(ẑ + z) + ½JF(ẑ - z),   φ(w, t) = Σ_{j≥1} t^j φ^j(w)
///
/// for z and ẑ on the exact flow at distance t. The coefficients are those of (4.10), with its sign corrected for F ≠
/// 0, but come from another road: with Z(s; c) the flow from c, and Z(t/2; c) = Ev(t; c) + Od(t; c) split into its even
/// and odd part in t, the *centre* c(t) and with it everything else follow at fixed w from
///
///     w = Ev(t; c(t)) + JF·Od(t; c(t)),   ∇φ(w, t) = 2J·Od(t; c(t)),   -∂φ/∂t(w, t) = H(c(t)).
///
/// The orbit between z and ẑ is carried along as its values at Gauss' nodes in time (GeneratingNodes), each a power
/// series in t: N recurrences of univariate Taylor arithmetic side by side, N/2 for F = 0, where the orbit at -τ is
/// that at τ with the sign of t changed.
///
/// Any H the formula engine takes will do, separable or not. For F = 0 the even coefficients vanish identically. Cost:
/// O(N³) per operation of ∇H for N terms, in vectors of the machine.
///
/// Holds work space: one per thread. No allocation after construction (hessian() apart).
class GeneratingFunction {
public:
  static constexpr int most_terms = 100;  ///< double precision is exhausted long before

  /// \param terms N ≥ 1: ∇φ^j for j ≤ N and φ^j for j ≤ N + 1 can be had
  /// \throws std::invalid_argument if F is not symmetric, finite and 2n × 2n, or `terms` not in 1 … most_terms
  GeneratingFunction(const Hamiltonian& hamiltonian, const Eigen::MatrixXd& F, int terms);
  GeneratingFunction(GeneratingFunction&&) noexcept;
  GeneratingFunction& operator=(GeneratingFunction&&) noexcept;
  ~GeneratingFunction();

  [[nodiscard]] int terms() const;
  [[nodiscard]] std::size_t dimension() const;  ///< 2n
  [[nodiscard]] const Eigen::MatrixXd& F() const;
  /// True if φ^j = 0 for even j: F = 0.
  [[nodiscard]] bool odd() const;

  /// Everything at w. Status::undefined, with a failure() that says why, where H has no Taylor expansion at w (division
  /// by zero, abs, min or sign at a kink, …) or a coefficient overflows.
  Status expand(std::span<const double> w);
  /// The same in parts, for those who need less: ∇φ^j for j ≤ `terms` alone; then more of them at the same w; then the
  /// φ^j that the gradients so far allow: j ≤ terms + 1.
  Status expand_gradients(std::span<const double> w, int terms);
  Status extend_gradients(int terms);
  Status expand_values();

  /// φ^j(w), 1 ≤ j ≤ terms() + 1 after expand().
  [[nodiscard]] double coefficient(int j) const;
  /// ∇φ^j(w), 1 ≤ j ≤ terms() after expand().
  [[nodiscard]] std::span<const double> gradient(int j) const;
  /// The coefficient of t^d in the centre c(t), 0 ≤ d ≤ terms(); c_0 = w.
  [[nodiscard]] std::span<const double> centre(int d) const;

  /// How many ∇φ^j the last expansion holds.
  [[nodiscard]] int known_terms() const;
  /// What it holds of the orbit from z to ẑ: the coefficients of t^d in component m of J∇H at the nodes, d <
  /// known_terms(), `slope_stride()` numbers from one d to the next.
  [[nodiscard]] const GeneratingNodes& nodes() const;
  [[nodiscard]] std::span<const double> slopes(std::size_t m) const;
  [[nodiscard]] Eigen::Index slope_stride() const;

  /// Φ_s(w, h) = Σ_{j≤s} h^j φ^j(w), and its first derivatives ∂_hΦ_s, ∇Φ_s, ∂_h∇Φ_s; s ≤ terms().
  [[nodiscard]] double sum(double h, int s) const;
  [[nodiscard]] double sum_rate(double h, int s) const;
  [[nodiscard]] double sum_second_rate(double h, int s) const;  ///< ∂²_hΦ_s
  /// The rounding error of the terms of ∂_hΦ_s beyond the first, -H(w): an estimate.
  [[nodiscard]] double rate_rounding(double h, int s) const;
  void gradient_sum(double h, int s, Eigen::Ref<Eigen::VectorXd> result) const;
  void gradient_sum_rate(double h, int s, Eigen::Ref<Eigen::VectorXd> result) const;
  /// The matrix of second derivatives of Φ_s in w, at any w: 2n expansions of twice the size. Leaves the expansion at
  /// the last w as it is.
  Status hessian_sum(std::span<const double> w, double h, int s, Eigen::Ref<Eigen::MatrixXd> result);

  /// After Status::undefined: why, for example "abs has no Taylor expansion at 0".
  [[nodiscard]] std::string failure() const;

private:
  void probe_energy();

  class Expansion;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace rubato
