#include <rubato/variation/formula_action.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

FormulaAction::FormulaAction(std::shared_ptr<const formula::Graph> graph, formula::Expression action,
                             std::span<const formula::Expression> corners, Element element)
    : graph_(std::move(graph)), action_(action), corners_(corners.begin(), corners.end()), element_(element) {
  if (corners.size() != element.size()) {
    throw std::invalid_argument(
        fmt::format("a discrete action on {} corners with {} coordinates and {} values each needs {} variables, got {}",
                    element.corners, element.coordinates, element.values, element.size(), corners.size()));
  }
  const formula::Expression outputs[] = {action};
  value_ = formula::ScalarEvaluator(formula::Bytecode(outputs, corners));
  gradient_ = formula::ScalarEvaluator(formula::Bytecode(formula::gradient(action, corners), corners));
  hessian_ = formula::ScalarEvaluator(formula::Bytecode(formula::hessian_upper(action, corners), corners));
}

double FormulaAction::value(std::span<const double> corners) {
  std::ranges::copy(corners, value_.inputs().begin());
  value_.run();
  return value_.output(0);
}

void FormulaAction::gradient(std::span<const double> corners, Eigen::Ref<Eigen::VectorXd> result) {
  std::ranges::copy(corners, gradient_.inputs().begin());
  gradient_.run();
  for (std::size_t i = 0; i < element_.size(); ++i) {
    result[static_cast<Eigen::Index>(i)] = gradient_.output(i);
  }
}

void FormulaAction::hessian(std::span<const double> corners, Eigen::Ref<Eigen::MatrixXd> result) {
  std::ranges::copy(corners, hessian_.inputs().begin());
  hessian_.run();
  const auto n = static_cast<Eigen::Index>(element_.size());
  std::size_t next = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = i; j < n; ++j) {
      result(i, j) = result(j, i) = hessian_.output(next++);
    }
  }
}

formula::SumSize FormulaAction::energy_size(std::span<const double> corners) {
  if (!energy_size_) {
    const formula::Expression energy = formula::derivative(action_, corners_[element_.coordinate(0, 0)]);
    energy_size_.emplace(formula::sum_size_code(energy, corners_));
  }
  return (*energy_size_)(corners);
}

}  // namespace rubato
