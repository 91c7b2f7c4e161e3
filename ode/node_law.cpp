#include <rubato/ode/node_law.hpp>

#include <cmath>
#include <limits>

namespace rubato {

NodeEnergy NodeLaw::operator()(const double* z) {
  NodeEnergy node;
  if (!generating_) {
    if (std::isnan(factor_)) {
      return {evaluator_.value(z), factor_};
    }
    node.gamma = factor_ * evaluator_.gamma(z, node.energy);
    return node;
  }
  node.energy = evaluator_.value(z);
  const bool defined = generating_->expand({z, evaluator_.dimension()}) == Status::success;
  node.gamma = defined ? -24.0 * generating_->coefficient(order_ + 1) : std::numeric_limits<double>::quiet_NaN();
  return node;
}

}  // namespace rubato
