#pragma once

#include <Eigen/Core>

#include <rubato/ode/generating_function.hpp>
#include <rubato/ode/generating_nodes.hpp>

namespace rubato {

/// The orbit that an expansion at w follows through a step, continued into the next one. With f(y(τ; h)) = Σ_d h^d
/// f_d(τ) along it, f_d a polynomial of degree ≤ d in τ (GeneratingNodes), and the step's end at τ = ½,
///
///     z(t_{k+1} + h') - z(t_{k+1}) = Σ_d h^(d+1) ∫_{½}^{½+h'/h} f_d(τ) dτ
///
/// up to a first neglected term about 3^(N+1) times as large as that of the step itself, for h' = h. Each f_d is
/// integrated as the polynomial of degree d that it is: of higher degrees its values hold nothing but rounding.
class OrbitContinuation {
public:
  explicit OrbitContinuation(const GeneratingFunction& generating);

  [[nodiscard]] bool empty() const { return h_ == 0.0; }
  [[nodiscard]] double step() const { return h_; }  ///< h
  [[nodiscard]] int terms() const { return known_; }
  /// The orbit of the last expansion, all terms known of it, for a step of length h ≠ 0.
  void take(const GeneratingFunction& generating, double h);
  void forget() { h_ = 0.0; }
  /// δ over the next step, of length `next`. False where the series has not converged well enough to be of use.
  [[nodiscard]] bool increment(double next, Eigen::VectorXd& delta);

private:
  void set_weights(double ratio);

  GeneratingNodes nodes_;
  Eigen::Index lane_stride_;
  int known_ = 0;            ///< terms taken
  Eigen::MatrixXd slopes_;   ///< f_d at the nodes: by order and lane, and by component
  Eigen::MatrixXd weights_;  ///< by order and lane: of all orders, and of the last two alone
  double h_ = 0.0;
  double weights_h_ = 0.0, weights_ratio_ = 0.0;
  int weights_known_ = 0;
  Eigen::MatrixXd sums_;
};

}  // namespace rubato
