#pragma once

#include <vector>

#include <rubato/ode/generating_function.hpp>
#include <rubato/variation/discrete_action.hpp>

namespace rubato {

/// What "order" means for generating functions: the coefficients φ^j that are kept, the order of the scheme they make,
/// and the first coefficient that is not kept, whose sign decides on variable levels (theory, section 4).
///
/// F = 0: the even coefficients vanish, so that orders are even, an odd one rounds up, and order 2m keeps j ≤ 2m - 1.
/// Any other F: order s keeps j ≤ s.
struct GeneratingOrder {
  int terms = 1;  ///< kept: j ≤ terms
  int order = 2;  ///< of the scheme; the first coefficient left out is φ^(order+1)
};
inline constexpr int most_generating_order = GeneratingFunction::most_terms - 1;
/// \throws std::invalid_argument unless 1 ≤ order ≤ most_generating_order
[[nodiscard]] GeneratingOrder generating_order(int order, const Eigen::MatrixXd& F);

/// The discrete action of the truncated generating function Φ_s(w, h) = Σ_{j≤s} h^j φ^j(w) of type F (theory, section
/// 4, which corrects (4.12)–(4.13)):
///
///     A = -½ z̄ᵀJδ + Φ_s(w, h) - ¼ δᵀFδ,   w = z̄ + ½JFδ,   z̄ = (z_0 + z_1)/2,   δ = z_1 - z_0,   h = t_1 - t_0
///
/// E = -∂_hΦ_s(w, h). For F = 0 the first term is p̄·(q_1 - q_0) up to a total difference, and one term is the midpoint
/// 𝕃. With the defect d = Jδ - ∇Φ_s(w, h), (3.3) is (I + FJ) d_k + (I - FJ) d_{k-1} = 0.
///
/// Where H has no Taylor expansion, the value and the variations are NaN, for the caller to judge.
class GeneratingAction final : public DiscreteAction {
public:
  /// \throws std::invalid_argument as generating_order and GeneratingFunction
  GeneratingAction(const Hamiltonian& hamiltonian, const Eigen::MatrixXd& F, int order);

  [[nodiscard]] const Element& element() const override { return element_; }
  [[nodiscard]] double value(std::span<const double> corners) override;
  void gradient(std::span<const double> corners, Eigen::Ref<Eigen::VectorXd> result) override;
  void hessian(std::span<const double> corners, Eigen::Ref<Eigen::MatrixXd> result) override;
  [[nodiscard]] formula::SumSize energy_size(std::span<const double> corners) override;

private:
  [[nodiscard]] Status expand(std::span<const double> corners);

  GeneratingFunction generating_;
  formula::SumSizeEvaluator energy_size_;
  int terms_;
  Element element_;
  Eigen::MatrixXd J_, weight_;  ///< weight = ½JF = ∂w/∂δ
  double h_ = 0.0;
  Eigen::VectorXd middle_, delta_, w_, slope_, slope_rate_;
  Eigen::MatrixXd curvature_;
};

}  // namespace rubato
