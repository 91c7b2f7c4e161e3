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

  /// δ over a time `next` from the end of the step of length h ≠ 0 that the last expansion of `generating`, of which
  /// this was made, is for. False where the series has not converged well enough to be of use.
  [[nodiscard]] bool increment(const GeneratingFunction& generating, double h, double next, Eigen::VectorXd& delta);

private:
  void set_weights(const GeneratingNodes& nodes, double h, double ratio, int terms);

  Eigen::Index lane_stride_;
  Eigen::VectorXd weights_;  ///< by order and lane
  double h_ = 0.0, ratio_ = 0.0;
  int terms_ = 0;
};

}  // namespace rubato
