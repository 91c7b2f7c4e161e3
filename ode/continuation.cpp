#include <rubato/ode/continuation.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/ode/tuning.hpp>
#include <rubato/solve/damped_least_squares.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::continuation;

using Eigen::Index;
using Eigen::VectorXd;

class Follower {
public:
  Follower(const Hamiltonian& hamiltonian, EndConditions& ends, const BoundaryValueSolution& start,
           const ContinuationOptions& options)
      : hamiltonian_(hamiltonian),
        ends_(ends),
        start_(start),
        options_(options),
        segments_(make_segment_equation(hamiltonian, options.newton.lagrangian)),
        equations_(hamiltonian, *segments_, ends, targets(options), start.orbit,
                   options.newton.levels == Levels::variable ? StationaryAction::Levels::free
                                                             : StationaryAction::Levels::prescribed,
                   start.potential),
        form_(options.parameter.component ? equations_.start_form(*options.parameter.component)
                                          : equations_.parameter_form()) {}

  Branch run() {
    Branch branch;
    VectorXd u = equations_.pack(start_.orbit);
    const double from = form_.dot(u), way = options_.to - from;
    const auto first = tangent(u, unit_condition(options_.step.value_or(way)));
    if (!first) {
      return ended(std::move(branch), "the start has no tangent");
    }
    VectorXd direction = *first;
    add(branch, u, start_.history, false);
    double length = std::abs(options_.step.value_or(way / first_parts)) / std::abs(form_.dot(direction));
    while (branch.points.size() < options_.most_points) {
      BoundaryValueSolution found;
      VectorXd next;
      std::optional<VectorXd> next_direction;
      while (!(next_direction = advance(u, direction, length, next, found))) {
        length *= 0.5;
        if (length * std::abs(direction.cwiseAbs().maxCoeff()) < least_step * u.norm()) {
          return ended(std::move(branch), fmt::format("no step leads further from {:.10g}: {}", form_.dot(u),
                                                      found.worst.empty() ? "there is no tangent" : found.worst));
        }
      }
      if ((form_.dot(next) - options_.to) * (form_.dot(u) - options_.to) <= 0.0) {
        return arrive(std::move(branch), u, next);
      }
      if (form_.dot(direction) * form_.dot(*next_direction) < 0.0) {
        add_fold(branch, u, direction, length);
      }
      u = next;
      direction = *next_direction;
      add(branch, u, found.history, false);
      length *= found.history.size() <= quick_iterations ? growth : found.history.size() >= slow_iterations ? 0.5 : 1.0;
    }
    return ended(std::move(branch), fmt::format("{} points, and the parameter has not come to {:.10g}",
                                                options_.most_points, options_.to));
  }

private:
  static StationaryAction::Targets targets(const ContinuationOptions& options) {
    using Parameter = StationaryAction::Parameter;
    const Parameter target = options.parameter.target;
    if ((target == Parameter::none) == !options.parameter.component.has_value()) {
      throw std::invalid_argument("a branch has one parameter: the duration, the energy, or a component of the start");
    }
    if (target != Parameter::none) {
      return {.parameter = target};
    }
    return {.duration = options.newton.duration, .energy = options.newton.energy};
  }

  /// The parameter's form of length one, in the direction of `way`.
  [[nodiscard]] LinearCondition unit_condition(double way) const {
    LinearCondition condition{form_, 1.0};
    condition.coefficients *= (way < 0.0 ? -1.0 : 1.0) / form_.norm();
    return condition;
  }

  /// The unknown that a direction moves most, as a condition with the value 1 along it.
  [[nodiscard]] static LinearCondition largest_of(const VectorXd& direction) {
    Index place = 0;
    static_cast<void>(direction.cwiseAbs().maxCoeff(&place));
    LinearCondition condition{Eigen::SparseVector<double>(direction.size()), 1.0};
    condition.coefficients.insert(place) = 1.0 / direction[place];
    return condition;
  }

  /// The direction of the branch at u, of length one, with condition · direction > 0.
  std::optional<VectorXd> tangent(const VectorXd& u, const LinearCondition& condition) {
    const LinearCondition conditions[] = {condition};
    Eigen::SparseMatrix<double> jacobian;
    VectorXd residual, direction;
    if (equations_.evaluate(u, residual, &jacobian, conditions) != Status::success) {
      return std::nullopt;
    }
    residual.setZero();
    residual[residual.size() - 1] = -1.0;
    if (solver_.factor(jacobian, tuning::damped_newton::least_damping) != Status::success ||
        solver_.solve(residual, direction) != Status::success || !(direction.norm() > 0.0)) {
      return std::nullopt;
    }
    return direction / direction.norm();
  }

  /// A step from u: the solution at this length along the direction, and the direction there.
  std::optional<VectorXd> advance(const VectorXd& u, const VectorXd& direction, double length, VectorXd& next,
                                  BoundaryValueSolution& found) {
    next = u + length * direction;
    LinearCondition held = largest_of(direction);
    held.value = held.coefficients.dot(next);
    found = {};
    const LinearCondition conditions[] = {held};
    if (!find_stationary(equations_, conditions, 0, options_.newton, next, found) ||
        (next - u - length * direction).norm() > most_correction * length) {
      return std::nullopt;
    }
    return tangent(next, largest_of(direction));
  }

  /// Between u, where the parameter still went on, and the point at `length`: Illinois' rule.
  void add_fold(Branch& branch, const VectorXd& u, const VectorXd& direction, double length) {
    double a = 0.0, b = length, slope_a = form_.dot(direction), slope_b = 0.0;
    VectorXd at;
    BoundaryValueSolution found;
    const auto slope = [&](double x) {
      const auto there = advance(u, direction, x, at, found);
      return there ? form_.dot(*there) : std::numeric_limits<double>::quiet_NaN();
    };
    slope_b = slope(b);
    for (int i = 0; i < most_fold_iterations && std::abs(b - a) > fold_accuracy * length; ++i) {
      const double x = (a * slope_b - b * slope_a) / (slope_b - slope_a), here = slope(x);
      if (!std::isfinite(here)) {
        return;
      }
      if (here * slope_b < 0.0) {
        a = b;
        slope_a = slope_b;
      } else {
        slope_a *= 0.5;
      }
      b = x;
      slope_b = here;
      if (std::abs(here) < fold_accuracy * form_.norm()) {
        break;
      }
    }
    add(branch, at, found.history, true);
  }

  /// The solution at the goal, which lies between two.
  Branch arrive(Branch branch, const VectorXd& before, const VectorXd& after) {
    const double a = form_.dot(before), b = form_.dot(after);
    VectorXd u = before + (options_.to - a) / (b - a) * (after - before);
    LinearCondition goal = unit_condition(1.0);
    goal.value = options_.to / form_.norm();
    const LinearCondition conditions[] = {goal};
    BoundaryValueSolution found;
    if (!find_stationary(equations_, conditions, 0, options_.newton, u, found)) {
      return ended(std::move(branch), fmt::format("there is no solution at {:.10g}", options_.to));
    }
    add(branch, u, found.history, false);
    branch.status = Status::success;
    return branch;
  }

  void add(Branch& branch, const VectorXd& u, std::vector<NewtonIteration> history, bool is_fold) {
    BoundaryValueOptions options = options_.newton;
    options.duration.reset();
    options.energy.reset();
    BranchPoint point{.parameter = form_.dot(u), .is_fold = is_fold};
    point.solution = boundary_value_residual(hamiltonian_, ends_, equations_.unpack(u), start_.potential, options);
    point.solution.history = std::move(history);
    branch.points.push_back(std::move(point));
  }

  static Branch ended(Branch branch, std::string why) {
    branch.message = std::move(why);
    return branch;
  }

  const Hamiltonian& hamiltonian_;
  EndConditions& ends_;
  const BoundaryValueSolution& start_;
  const ContinuationOptions& options_;
  std::unique_ptr<SegmentEquation> segments_;
  StationaryAction equations_;
  Eigen::SparseVector<double> form_;  ///< of the parameter
  solve::DampedLeastSquares solver_;
};

}  // namespace

Branch follow_branch(const Hamiltonian& hamiltonian, EndConditions ends, const BoundaryValueSolution& start,
                     const ContinuationOptions& options) {
  return Follower(hamiltonian, ends, start, options).run();
}

}  // namespace rubato
