#include <rubato/ode/custom_consistency.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/Core>

#include <rubato/ode/discrete_lagrangian.hpp>

namespace rubato {

namespace {

using Eigen::VectorXd;

/// Halving steps takes a half of an error of the first order.
constexpr double falls = 0.7;
/// Of the terms: what is smaller is rounding.
constexpr double nothing = 1e-5;
/// The longest step that is looked at, of those of the run, and how often it is halved.
constexpr double first_part = 1.0 / 16.0;
constexpr int halvings = 5;

class Motion {
public:
  explicit Motion(const Hamiltonian& hamiltonian) : H_(hamiltonian) {}

  struct Derivatives {
    VectorXd gradient, first, second;  ///< ∇H, ż, z̈
    double H = 0.0;
  };
  [[nodiscard]] Derivatives at(const VectorXd& z) {
    Derivatives result{VectorXd(z.size()), {}, {}};
    Eigen::MatrixXd hessian(z.size(), z.size());
    result.H = H_.hessian(z.data(), result.gradient.data(), hessian.data());
    result.first = turned(result.gradient);
    result.second = turned(hessian * result.first);
    return result;
  }

private:
  /// J v.
  [[nodiscard]] static VectorXd turned(const VectorXd& v) {
    const Eigen::Index n = v.size() / 2;
    VectorXd result(v.size());
    result << v.tail(n), -v.head(n);
    return result;
  }

  HamiltonianEvaluator H_;
};

class StatedSteps {
public:
  StatedSteps(FormulaAction& action, double t) : action_(action), t_(t) {}

  /// ∂A of the step from (t, z_0) to (t + h, z_1).
  [[nodiscard]] VectorXd variation(const VectorXd& z_0, const VectorXd& z_1, double t, double h) {
    const auto size = static_cast<Eigen::Index>(action_.element().per_corner());
    VectorXd corners(2 * size), result(2 * size);
    corners << t, z_0, t + h, z_1;
    action_.gradient({corners.data(), static_cast<std::size_t>(corners.size())}, result);
    return result;
  }

  /// The two defects at z with steps of length h, the larger one, relative to the terms.
  [[nodiscard]] double off(const VectorXd& z, const Motion::Derivatives& motion, double h) {
    const VectorXd before = z - h * motion.first + 0.5 * h * h * motion.second,
                   after = z + h * motion.first + 0.5 * h * h * motion.second;
    const VectorXd to = variation(before, z, t_ - h, h), from = variation(z, after, t_, h);
    const Eigen::Index d = z.size();
    const VectorXd rows = (to.tail(d) + from.segment(1, d)) / h;
    const double energy = std::max(std::abs(motion.H), (z.array() * motion.gradient.array()).abs().sum());
    double largest = energy > 0.0 ? std::abs(from(0) - motion.H) / energy : 0.0;
    for (Eigen::Index i = 0; i < d; ++i) {
      const double size = std::abs(motion.gradient(i));
      const double defect = size > 0.0 ? std::abs(rows(i)) / size : 0.0;
      largest = std::isnan(defect) ? defect : std::max(largest, defect);
    }
    return largest;
  }

private:
  FormulaAction& action_;
  double t_;
};

}  // namespace

double off_motion(const Hamiltonian& hamiltonian, const Custom& stated, std::span<const double> z, double t,
                  double step) {
  const Hamiltonian& reduced = hamiltonian.without_constant();
  FormulaAction action = reduced_lagrangian_action(reduced, stated.L, stated.parameters).action;
  Motion motion(reduced);
  StatedSteps steps(action, t);
  const VectorXd middle = Eigen::Map<const VectorXd>(z.data(), static_cast<Eigen::Index>(z.size()));
  const VectorXd along = motion.at(middle).first;
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> part(-0.3, 0.3);
  constexpr int points = 4;
  double off = std::numeric_limits<double>::quiet_NaN();
  for (int number = 0; number < points; ++number) {
    VectorXd point = middle;
    for (Eigen::Index i = 0; i < point.size(); ++i) {
      point(i) += part(random) * (std::abs(middle(i)) + std::abs(step * along(i)));
    }
    const Motion::Derivatives derivatives = motion.at(point);
    const VectorXd corners = steps.variation(point, point + step * derivatives.first, t, step);
    const double of_times = corners(0) + corners(corners.size() / 2);
    if (std::abs(of_times) > nothing * std::max(std::abs(corners(0)), std::abs(derivatives.H))) {
      return std::numeric_limits<double>::quiet_NaN();  // 𝕃 names t
    }
    double h = first_part * step, last = steps.off(point, derivatives, h), now = last;
    bool fell = false;
    for (int i = 0; i < halvings; ++i) {
      h *= 0.5;
      last = now;
      now = steps.off(point, derivatives, h);
      fell = now <= falls * last;
    }
    if (std::isfinite(now)) {
      off = std::fmax(off, fell || now < nothing ? 0.0 : now);
    }
  }
  return off;
}

}  // namespace rubato
