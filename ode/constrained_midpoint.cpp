#include <rubato/ode/constrained_midpoint.hpp>

#include <cmath>
#include <utility>

#include <rubato/base/limits.hpp>
#include <rubato/ode/constrained_state.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Its unknowns are the increment from (q_k, p⁺) to (q_{k+1}, p⁻), and μ.
class ConstrainedMidpoint final : public ConstrainedState {
public:
  ConstrainedMidpoint(const Hamiltonian& hamiltonian, std::span<const double> z_0)
      : ConstrainedState(hamiltonian, static_cast<Index>(z_0.size() + hamiltonian.constraints().count()), z_0),
        solver_(static_cast<int>(2 * n_ + c_)),
        gradient_rounding_(hamiltonian.gradient_code()) {
    middle_.setZero(2 * n_);
    gradient_.setZero(2 * n_);
    first_entries_.setZero(static_cast<Index>(constraints_.places().size()));
    first_G_.setZero(c_, n_);
    hessian_.setZero(2 * n_, 2 * n_);
    correction_.setZero(2 * n_ + c_);
    last_correction_.setZero(2 * n_ + c_);
    mu_.setZero(c_);
    matrix_.setZero(2 * n_ + c_, 2 * n_ + c_);
  }

private:
  void start_on_tangent(double h) override {
    evaluator_.gradient(z_.value().data(), gradient_.data());
    unknowns_.head(n_) = h * gradient_.tail(n_);
    unknowns_.segment(n_, n_) = -h * gradient_.head(n_);
    unknowns_.tail(c_).setZero();
  }

  [[nodiscard]] Status step(double h) override {
    at_.evaluate(z_.value().data());
    first_entries_ = at_.entries();
    first_G_ = at_.G();
    if (const Status status = iterate(h); status != Status::success) {
      return status;
    }
    point_.stand_at(z_.value(), z_.low());
    point_.delta() = unknowns_.head(2 * n_);
    at_.kick(first_entries_, mu_, point_.delta().data() + n_);
    point_.entries() = at_.entries();
    return Status::success;
  }

  /// Newton's method; its matrix is kept as long as corrections shrink fast.
  [[nodiscard]] Status iterate(double h) {
    const auto increment = unknowns_.head(2 * n_);
    double last = 1.0;
    bool settled = false, factored = false;
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      ++iterations_;
      mu_ = unknowns_.tail(c_);
      middle_ = z_.low() + 0.5 * increment;
      at_.kick(first_entries_, mu_, middle_.data() + n_);
      middle_ += z_.value();
      energy_ = evaluator_.gradient(middle_.data(), gradient_.data());
      if (!std::isfinite(energy_) || !gradient_.allFinite()) {
        return Status::undefined;
      }
      at_end_.head(n_) = z_.value().head(n_) + (z_.low().head(n_) + increment.head(n_));
      at_.evaluate(at_end_.data());
      if (settled) {
        return Status::success;
      }
      if (!factored) {
        assemble_matrix(h);
        if (solver_.factor(matrix_.data()) != Status::success) {
          dependent_ = at_.dependent();
          return Status::undefined;
        }
      }
      correction_.head(n_) = increment.head(n_) - h * gradient_.tail(n_);
      correction_.segment(n_, n_) = increment.tail(n_) + h * gradient_.head(n_);
      correction_.tail(c_) = at_.g();
      solver_.solve(correction_.data());
      unknowns_ -= correction_;
      const double size = history_.relative_size(correction_.head(2 * n_), increment, z_.value());
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      factored = size <= slowest_multipliers * last;
      settled = size / last * size <= tuning::least_leftover || size <= epsilon || (size >= 0.5 * last && stagnates(h));
      last = size;
      last_correction_ = correction_;
    }
    return Status::not_converged;
  }

  /// By the matrix of Newton's method: of (q_k, p⁺) a variation moves the middle along, and of δμ as its last column.
  [[nodiscard]] Status vary_step(Columns columns, double h, std::span<double> energies) override {
    at_end_ = z_.value();
    at_.evaluate(at_end_.data());
    first_entries_ = at_.entries();
    first_G_ = at_.G();
    mu_ = unknowns_.tail(c_);
    vary_gradients(at_end_.data(), mu_, columns);
    middle_ = z_.low() + 0.5 * unknowns_.head(2 * n_);
    at_.kick(first_entries_, mu_, middle_.data() + n_);
    middle_ += z_.value();
    at_end_.head(n_) = z_.value().head(n_) + (z_.low().head(n_) + unknowns_.head(n_));
    at_.evaluate(at_end_.data());
    assemble_matrix(h);
    if (const Status status = solver_.factor(matrix_.data()); status != Status::success) {
      return status;
    }
    for (Index i = 0; i < columns.cols(); ++i) {
      auto column = columns.col(i);
      const bool by_h = !energies.empty() && i + 1 == columns.cols();
      correction_.head(n_) = h * hessian_.bottomRows(n_).lazyProduct(column);
      correction_.segment(n_, n_) = -h * hessian_.topRows(n_).lazyProduct(column);
      correction_.tail(c_) = -at_.G().lazyProduct(column.head(n_));
      if (by_h) {
        correction_.head(n_) += gradient_.tail(n_);
        correction_.segment(n_, n_) -= gradient_.head(n_);
      }
      solver_.solve(correction_.data());
      rates_ = correction_.tail(c_);
      at_.kick(first_entries_, rates_, column.data() + n_);
      if (!energies.empty()) {
        energies[static_cast<std::size_t>(i)] = gradient_.dot(column + 0.5 * correction_.head(2 * n_));
      }
      column += correction_.head(2 * n_);
    }
    at_end_.tail(n_) = middle_.tail(n_) + 0.5 * unknowns_.segment(n_, n_);
    return Status::success;
  }

  /// Whether nothing more is to be had of any coordinate or momentum, each in its own units: what the last correction
  /// mended is no more than the rounding error of the equation, or, where elimination rounds more, corrections no
  /// longer shrink.
  [[nodiscard]] bool stagnates(double h) {
    constexpr double unit = 0.5 * epsilon;
    if (!(at_.left(at_end_.data()).relative <= stagnant_constraint)) {
      return false;
    }
    // The middle before the correction, and what it was made of, are rounded.
    errors_ = middle_.cwiseAbs() + unknowns_.head(2 * n_).cwiseAbs();
    const double* entry = first_entries_.data();
    for (const auto [row, column] : constraints_.places()) {
      errors_[n_ + static_cast<Index>(column)] += std::abs(*entry++ * mu_[static_cast<Index>(row)]);
    }
    gradient_rounding_.run(as_span(std::as_const(middle_)), as_span(std::as_const(errors_)));
    for (Index i = 0; i < 2 * n_; ++i) {
      const double size = std::abs(correction_[i]), increment = unknowns_[i] + correction_[i];
      if (size >= 0.5 * std::abs(last_correction_[i]) && size <= stagnant_constraint * std::abs(middle_[i])) {
        continue;
      }
      const Index slope = i < n_ ? n_ + i : i - n_;
      const double residual = std::abs(increment + (i < n_ ? -h : h) * gradient_[slope]);
      const double bound = std::abs(h) * gradient_rounding_.bound(static_cast<std::size_t>(1 + slope));
      if (!(residual <= 2.0 * unit * (bound + 4.0 * std::abs(increment)))) {
        return false;
      }
    }
    return true;
  }

  /// The derivatives of what is left of the equations.
  void assemble_matrix(double h) {
    evaluator_.hessian(middle_.data(), gradient_.data(), hessian_.data());
    matrix_.setIdentity();
    matrix_.bottomRightCorner(c_, c_).setZero();
    matrix_.topLeftCorner(n_, 2 * n_) -= 0.5 * h * hessian_.bottomRows(n_);
    matrix_.block(n_, 0, n_, 2 * n_) += 0.5 * h * hessian_.topRows(n_);
    matrix_.block(0, 2 * n_, n_, c_) = h * hessian_.bottomRightCorner(n_, n_).lazyProduct(first_G_.transpose());
    matrix_.block(n_, 2 * n_, n_, c_) = -h * hessian_.topRightCorner(n_, n_).lazyProduct(first_G_.transpose());
    matrix_.block(2 * n_, 0, c_, n_) = at_.G();
  }

  solve::DenseSolver solver_;
  formula::RoundingEvaluator gradient_rounding_;
  VectorXd middle_, gradient_, first_entries_, mu_, correction_, last_correction_;
  MatrixXd first_G_, hessian_, matrix_;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_constrained_midpoint(const Hamiltonian& hamiltonian, std::span<const double> z_0) {
  check_initial_state(hamiltonian, z_0);
  check_constraints(hamiltonian.constraints(), hamiltonian.q_names(), z_0.first(z_0.size() / 2));
  auto scheme = std::make_unique<ConstrainedMidpoint>(hamiltonian, z_0);
  scheme->check_start(hamiltonian.p_names());
  return scheme;
}

}  // namespace rubato
