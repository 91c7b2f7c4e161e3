#pragma once

#include <memory>
#include <optional>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/variation/discrete_action.hpp>

namespace rubato {

/// A discrete action stated as a formula in the corners' coordinates and values; its variations follow by
/// differentiation of the formula and are never written by hand.
class FormulaAction final : public DiscreteAction {
public:
  /// `corners`: the variables of the graph of `action`, in the order of Element. `graph` is kept alive.
  /// \throws std::invalid_argument unless corners.size() == element.size() and they are variables
  FormulaAction(std::shared_ptr<const formula::Graph> graph, formula::Expression action,
                std::span<const formula::Expression> corners, Element element);

  [[nodiscard]] const Element& element() const override { return element_; }
  [[nodiscard]] double value(std::span<const double> corners) override;
  void gradient(std::span<const double> corners, Eigen::Ref<Eigen::VectorXd> result) override;
  void hessian(std::span<const double> corners, Eigen::Ref<Eigen::MatrixXd> result) override;
  [[nodiscard]] formula::SumSize energy_size(std::span<const double> corners) override;

  [[nodiscard]] formula::Expression expression() const { return action_; }

private:
  std::shared_ptr<const formula::Graph> graph_;
  formula::Expression action_;
  std::vector<formula::Expression> corners_;
  Element element_;
  formula::ScalarEvaluator value_, gradient_, hessian_;
  std::optional<formula::SumSizeEvaluator> energy_size_;  ///< made when first asked for
};

}  // namespace rubato
