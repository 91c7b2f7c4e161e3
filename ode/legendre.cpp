#include <rubato/ode/legendre.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <rubato/base/limits.hpp>
#include <rubato/formula/branches.hpp>
#include <rubato/ode/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::legendre;

/// Powers of two, so that scaling rounds nothing.
void scale(const Eigen::Ref<const Eigen::MatrixXd>& masses, Eigen::VectorXd& scales) {
  for (Eigen::Index i = 0; i < masses.rows(); ++i) {
    const double largest = masses.row(i).cwiseAbs().maxCoeff();
    scales[i] = largest > 0.0 ? std::ldexp(1.0, -std::ilogb(largest) / 2) : 1.0;
  }
}

}  // namespace

Eigen::VectorXd velocity_scales(const Eigen::MatrixXd& masses) {
  Eigen::VectorXd scales(masses.rows());
  scale(masses, scales);
  return scales;
}

LegendreTransform::LegendreTransform(const Lagrangian& lagrangian)
    : evaluator_(lagrangian),
      rounding_(lagrangian.gradient_code()),
      n_(static_cast<Eigen::Index>(lagrangian.degrees_of_freedom())),
      solver_(static_cast<int>(n_)) {
  for (Eigen::VectorXd* vector : {&scales_, &sizes_, &residual_, &step_, &trial_, &last_, &last_guess_}) {
    vector->setZero(n_);
  }
  inputs_.setZero(2 * n_);
  errors_.setZero(2 * n_);
  gradient_.setZero(2 * n_);
  hessian_.setZero(2 * n_, 2 * n_);
  scaled_.setZero(n_, n_);
}

bool LegendreTransform::is_regular(const Eigen::Ref<const Eigen::MatrixXd>& masses) {
  scale(masses, scales_);
  for (Eigen::Index j = 0; j < n_; ++j) {
    scaled_.col(j) = scales_[j] * masses.col(j).cwiseProduct(scales_);
  }
  return solver_.factor(scaled_.data()) == Status::success && solver_.rcond_estimate() > least_pivot_ratio;
}

double LegendreTransform::evaluate(const double* q, const double* q_dot) {
  std::copy_n(q, n_, inputs_.data());
  std::copy_n(q_dot, n_, inputs_.data() + n_);
  return evaluator_.hessian(inputs_.data(), gradient_.data(), hessian_.data());
}

/// Whether rounding explains the residual of the trial: that of ∂L/∂q̇, of q̇ itself, which is off by u|q̇| at best, and
/// of the difference. Twice the bound, since that is of first order.
bool LegendreTransform::is_rounding(const Eigen::Ref<const Eigen::VectorXd>& momenta) {
  constexpr double u = 0.5 * epsilon;
  errors_.tail(n_) = inputs_.tail(n_).cwiseAbs();
  const auto size = static_cast<std::size_t>(2 * n_);
  rounding_.run({inputs_.data(), size}, {errors_.data(), size});
  for (Eigen::Index i = 0; i < n_; ++i) {
    const double bound = rounding_.bound(static_cast<std::size_t>(1 + n_ + i)) + std::abs(momenta[i]);
    if (!(std::abs(residual_[i]) <= 2.0 * u * bound)) {
      return false;
    }
  }
  return true;
}

/// What rounding leaves is judged beside the terms at the first guess. Where that was far away, what was found is the
/// next one.
Status LegendreTransform::solve(const double* q, const double* p, double* q_dot) {
  constexpr double far = 1e3;
  constexpr int most_guesses = 40;
  Status status = solve_from_guess(q, p, q_dot);
  for (int guess = 1; guess < most_guesses && status == Status::success; ++guess) {
    bool near = true;
    for (Eigen::Index i = 0; i < n_; ++i) {
      near = near && sizes_[i] <= far * (std::abs(p[i]) + std::abs(gradient_[n_ + i]));
    }
    if (near) {
      break;
    }
    const double found = energy_;
    last_guess_ = Eigen::Map<const Eigen::VectorXd>(q_dot, n_);
    if (solve_from_guess(q, p, q_dot) != Status::success ||
        last_guess_ == Eigen::Map<const Eigen::VectorXd>(q_dot, n_)) {
      std::copy_n(last_guess_.data(), n_, q_dot);
      energy_ = found;
      evaluate(q, q_dot);
      singular_ = false;
      break;
    }
  }
  return status;
}

Status LegendreTransform::solve_from_guess(const double* q, const double* p, double* q_dot) {
  singular_ = false;
  const Eigen::Map<const Eigen::VectorXd> momenta(p, n_);
  Eigen::Map<Eigen::VectorXd> v(q_dot, n_);
  trial_ = v;
  step_.setZero();
  double last = std::numeric_limits<double>::infinity();
  double value = evaluate(q, trial_.data());
  // Sizes by which the equations are judged: those of their terms to begin with.
  sizes_ = momenta.cwiseAbs() + gradient_.tail(n_).cwiseAbs();
  for (Eigen::Index i = 0; i < n_; ++i) {
    sizes_[i] = std::isfinite(sizes_[i]) && sizes_[i] > 0.0 ? sizes_[i] : 1.0;
  }
  for (int iteration = 0, halvings = 0; iteration < most_legendre_iterations;) {
    residual_ = momenta - gradient_.tail(n_);
    const double left = residual_.cwiseQuotient(sizes_).cwiseAbs().maxCoeff();
    const bool defined = std::isfinite(value) && gradient_.allFinite() && hessian_.allFinite() && residual_.allFinite();
    if (defined && (left <= legendre_rounding || (left >= 0.5 * last && is_rounding(momenta)))) {
      v = trial_;
      energy_ = momenta.dot(v) - value;
      return Status::success;
    }
    if (!defined || left > last) {  // too long a step: half of it
      if (std::isinf(last) || ++halvings > most_legendre_halvings) {
        return defined ? Status::not_converged : Status::undefined;
      }
      step_ *= 0.5;
      trial_ = last_ + step_;
      value = evaluate(q, trial_.data());
      continue;
    }
    last = left;
    if (!is_regular(hessian_.bottomRightCorner(n_, n_))) {
      singular_ = true;
      return Status::undefined;
    }
    step_ = residual_.cwiseProduct(scales_);
    solver_.solve(step_.data());
    step_ = step_.cwiseProduct(scales_);
    last_ = trial_;
    trial_ += step_;
    value = evaluate(q, trial_.data());
    ++iteration;
    halvings = 0;
  }
  return Status::not_converged;
}

/// step_ = ∂²L/∂q̇²⁻¹ (p' - ∂²L/∂q̇∂q q̇), p' = ∂L/∂q.
bool LegendreTransform::find_acceleration() {
  if (!is_regular(hessian_.bottomRightCorner(n_, n_))) {
    return false;
  }
  residual_.noalias() = hessian_.bottomLeftCorner(n_, n_).lazyProduct(inputs_.tail(n_));
  step_ = (gradient_.head(n_) - residual_).cwiseProduct(scales_);
  solver_.solve(step_.data());
  step_ = step_.cwiseProduct(scales_);
  return true;
}

bool LegendreTransform::acceleration(double* q_ddot) {
  if (!find_acceleration()) {
    return false;
  }
  std::copy_n(step_.data(), n_, q_ddot);
  return true;
}

double LegendreTransform::gamma() {
  const auto q_dot = inputs_.tail(n_);
  const auto force = gradient_.head(n_);
  // ∇H = (-∂L/∂q, q̇) along f = (q̇, p'): q̇ changes by the acceleration.
  if (!find_acceleration()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  residual_.noalias() = hessian_.topLeftCorner(n_, n_).lazyProduct(q_dot);
  residual_.noalias() += hessian_.topRightCorner(n_, n_).lazyProduct(step_);
  return force.dot(step_) - q_dot.dot(residual_);
}

namespace {

/// M = ∂²L/∂q̇² row by row. \throws std::invalid_argument if an entry depends on a velocity
std::vector<formula::Expression> mass_formulas(formula::Expression L, std::span<const formula::Expression> q_dot) {
  const std::size_t n = q_dot.size();
  const formula::Expression zero = L.graph()->constant(0.0);
  std::vector<formula::Expression> masses(n * n, zero);
  const std::vector<formula::Expression> still(n, zero);
  bool is_quadratic = !formula::is_piecewise(L, q_dot);
  for (const formula::HessianEntry& entry : formula::hessian_entries(L, q_dot)) {
    is_quadratic = is_quadratic && formula::substitute(entry.value, q_dot, still) == entry.value;
    masses[entry.row * n + entry.column] = masses[entry.column * n + entry.row] = entry.value;
  }
  if (!is_quadratic) {
    throw std::invalid_argument("L is not quadratic in the velocities, and H(q, p) is then no formula");
  }
  return masses;
}

}  // namespace

formula::Expression legendre_transform(formula::Expression L, std::span<const formula::Expression> q_dot,
                                       std::span<const formula::Expression> p) {
  const std::size_t n = q_dot.size();
  std::vector<formula::Expression> masses = mass_formulas(L, q_dot);
  const std::vector<formula::Expression> still(n, L.graph()->constant(0.0));
  const std::vector<formula::Expression> slopes = formula::gradient(L, q_dot);
  std::vector<formula::Expression> parts;  // of p - b
  for (std::size_t i = 0; i < n; ++i) {
    const formula::Expression b = formula::substitute(slopes[i], q_dot, still);
    parts.push_back(b.is_constant() && b.constant_value() == 0.0 ? p[i] : p[i] - b);
  }
  formula::Expression H = -formula::substitute(L, q_dot, still);
  for (std::size_t k = 0; k < n; ++k) {
    const formula::Expression pivot = masses[k * n + k];
    if (pivot.is_constant() && pivot.constant_value() == 0.0) {
      throw std::invalid_argument("the elimination of the velocities meets a pivot that is 0");
    }
    H += 0.5 * parts[k] * parts[k] / pivot;
    for (std::size_t i = k + 1; i < n; ++i) {
      const formula::Expression below = masses[i * n + k];
      if (below.is_constant(0.0)) {  // products with 0 stay in formulas, as the domain of the other factor
        continue;
      }
      for (std::size_t j = k + 1; j < n; ++j) {
        if (!masses[k * n + j].is_constant(0.0)) {
          masses[i * n + j] = masses[i * n + j] - below * masses[k * n + j] / pivot;
        }
      }
      parts[i] = parts[i] - below * parts[k] / pivot;
    }
  }
  return H;
}

}  // namespace rubato
