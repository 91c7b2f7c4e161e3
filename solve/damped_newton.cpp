#include <rubato/solve/damped_newton.hpp>

#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {

namespace {

using namespace tuning::damped_newton;

using Eigen::VectorXd;

double largest(const VectorXd& residual) {
  return residual.size() == 0 ? 0.0 : residual.cwiseAbs().maxCoeff();
}

/// A correction from where the equations were factored.
class DampedStep {
public:
  explicit DampedStep(Equations& equations) : equations_(equations) {}

  /// Moves u. False where no part of the correction helps.
  /// \param fraction λ of the last step; of this one when it returns
  bool take(const VectorXd& residual, VectorXd& u, double& fraction) {
    for (double damping = least_damping; damping <= most_damping; damping *= damping_factor) {
      Interruptible::end_if_asked();
      if (equations_.factor(damping) != Status::success || equations_.solve(residual, correction_) != Status::success) {
        continue;
      }
      for (double part = std::min(1.0, 4.0 * fraction); part >= least_fraction; part *= 0.5) {
        trial_ = u + part * correction_;
        if (equations_.evaluate(trial_, trial_residual_, false) == Status::success &&
            equations_.solve(trial_residual_, next_) == Status::success &&
            next_.norm() <= (1.0 - 0.25 * part) * correction_.norm()) {
          u = trial_;
          fraction = part;
          return true;
        }
      }
      fraction = 1.0;
    }
    return false;
  }
  [[nodiscard]] double size() const { return correction_.norm(); }
  /// Of the residual where it led to.
  [[nodiscard]] double residual() const { return largest(trial_residual_); }

private:
  Equations& equations_;
  VectorXd correction_, trial_, trial_residual_, next_;
};

}  // namespace

std::string NewtonSearch::message(std::size_t iterations) const {
  return status != Status::not_converged
             ? fmt::format("the equations are not defined at {}", worst)
             : fmt::format(
                   "Newton's method did not converge; the residual is {:.3g} after {} iterations, the largest "
                   "in {}",
                   residual, iterations, worst);
}

NewtonSearch find_zero(Equations& equations, double tolerance, std::size_t most_iterations, int stage, VectorXd& u,
                       std::vector<NewtonIteration>& history) {
  VectorXd residual;
  NewtonSearch search{.status = equations.evaluate(u, residual, true), .worst = {}};
  if (search.status != Status::success) {
    search.worst = equations.describe_failure();
    return search;
  }
  history.push_back({.stage = stage, .residual = largest(residual)});
  DampedStep step(equations);
  double fraction = 1.0;
  for (std::size_t iteration = 0; iteration < most_iterations && largest(residual) > least_residual; ++iteration) {
    Interruptible::end_if_asked();
    VectorXd next = u;
    const double before = largest(residual), length = u.norm();
    const bool moved = step.take(residual, next, fraction);
    // Below the tolerance it goes on as long as that makes it much smaller: down to rounding.
    const bool rounding = before <= tolerance && (!moved || step.residual() > 0.25 * before);
    if (!moved || (rounding && step.residual() >= before)) {
      break;
    }
    u = next;
    search.status = equations.evaluate(u, residual, true);
    history.push_back({.stage = stage,
                       .residual = largest(residual),
                       .correction = step.size() / (length + std::numeric_limits<double>::min()),
                       .fraction = fraction});
    if (rounding) {
      break;
    }
  }
  Eigen::Index row = 0;
  search.residual = residual.cwiseAbs().maxCoeff(&row);
  search.worst = equations.describe(row);
  search.status = search.residual <= tolerance ? Status::success : Status::not_converged;
  return search;
}

}  // namespace rubato::solve
