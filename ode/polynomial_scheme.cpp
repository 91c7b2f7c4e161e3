#include <rubato/ode/polynomial_scheme.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/ode/tuning.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

Eigen::VectorXd phase_point(std::span<const double> q, std::span<const double> p) {
  Eigen::VectorXd z(static_cast<Eigen::Index>(q.size() + p.size()));
  std::ranges::copy(p, std::ranges::copy(q, z.data()).out);
  return z;
}

bool is_near(double h, double other) {
  const double ratio = other == 0.0 ? 0.0 : h / other;
  return ratio > 1.0 / tuning::longest_continuation && ratio < tuning::longest_continuation;
}

}  // namespace

PolynomialScheme::PolynomialScheme(const Lagrangian& lagrangian, const ActionQuadrature& quadrature,
                                   std::span<const double> q, std::span<const double> q_dot, Index constraints,
                                   double beside_others)
    : action_(lagrangian, quadrature),
      transform_(lagrangian),
      n_(static_cast<Index>(q.size())),
      d_(quadrature.degree),
      z_(phase_point(q, momenta(lagrangian, q, q_dot))),
      seed_(Eigen::Map<const VectorXd>(q_dot.data(), n_)),
      energy_size_(lagrangian.energy_size_code()),
      beside_others_(beside_others) {
  for (Unknowns* unknowns : {&x_, &last_, &trial_, &shorter_}) {
    unknowns->Y.setZero(n_, d_);
    unknowns->mu.setZero(constraints, d_);
  }
  begun_.setZero(n_, d_);
  for (VectorXd* vector : {&velocity_, &trial_velocity_, &usual_, &last_end_}) {
    vector->setZero(n_);
  }
  point_.setZero(2 * n_);
  errors_.setZero(2 * n_);
  weights_.setZero(d_ + 1);
}

formula::SumSize PolynomialScheme::energy_size() {
  if (trial_h_ == 0.0) {
    static_cast<void>(node());
    point_ << z_.value().head(n_), velocity_;
    errors_.head(n_) = 2.0 * point_.head(n_).cwiseAbs();
  } else {
    point_ = action_.points.col(action_.values.size() / 2);
    errors_.head(n_) = 2.0 * (point_.head(n_).cwiseAbs() + x_.Y.col(d_ - 1).cwiseAbs());
  }
  errors_.tail(n_) = 4.0 * point_.tail(n_).cwiseAbs();
  return energy_size_(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
}

void PolynomialScheme::restart(std::span<const double> z) {
  if (here_ && std::isfinite(here_->energy)) {
    seed_ = velocity_;
  }
  z_ = CompensatedState<VectorXd>(Eigen::Map<const VectorXd>(z.data(), 2 * n_));
  last_h_ = 0.0;
  start_level();
}

void PolynomialScheme::save_guesses(StateWriter& state) const {
  state.write(as_span(here_ && std::isfinite(here_->energy) ? velocity_ : seed_));
  state.write(as_span(usual_));
}
void PolynomialScheme::restore_guesses(StateReader& state) {
  here_.reset();
  state.read(as_span(seed_));
  state.read(as_span(usual_));
}

void PolynomialScheme::save(StateWriter& state) const {
  z_.save(state);
  state.write(last_h_);
  state.write(as_span(seed_));
  state.write(as_span(usual_));
  for (const MatrixXd* matrix : {&last_.Y, &last_.mu}) {
    state.write({matrix->data(), static_cast<std::size_t>(matrix->size())});
  }
}
void PolynomialScheme::restore(StateReader& state) {
  z_.restore(state);
  state.read(last_h_);
  state.read(as_span(seed_));
  state.read(as_span(usual_));
  for (MatrixXd* matrix : {&last_.Y, &last_.mu}) {
    state.read(std::span<double>(matrix->data(), static_cast<std::size_t>(matrix->size())));
  }
  start_level();
}

void PolynomialScheme::start_level() {
  here_.reset();
  known_trial_h_ = 0.0;
  trial_h_ = 0.0;
  iterations_ = 0;
}

void PolynomialScheme::start_on_tangent(double h) {
  for (Index i = 0; i < d_; ++i) {
    x_.Y.col(i) = h * action_.quadrature.control[i + 1] * velocity_;
  }
  x_.mu.setZero();
}

bool PolynomialScheme::start(double h) {
  if (is_near(h, known_trial_h_)) {
    continue_from(trial_, 0.0, h / known_trial_h_);
  } else if (is_near(h, last_h_)) {
    continue_from(last_, 1.0, h / last_h_);
  } else {
    start_on_tangent(h);
    return false;
  }
  return true;
}

/// From σ = origin (0 or 1) on, over θ steps.
void PolynomialScheme::continue_from(const Unknowns& from, double origin, double theta) {
  last_end_.setZero();
  if (origin != 0.0) {
    last_end_ = from.Y.col(d_ - 1);
  }
  for (Index i = 0; i < d_; ++i) {
    action_.quadrature.interpolation(origin + theta * action_.quadrature.control[i + 1], weights_);
    x_.Y.col(i) = -last_end_;
    x_.Y.col(i).noalias() += from.Y.lazyProduct(weights_.tail(d_));
  }
  x_.mu = theta * from.mu;
}

Status PolynomialScheme::iterate_nearby(double h, double accuracy) {
  begun_ = x_.Y;
  const Status status = iterate(h, accuracy);
  far_ = false;
  if (status != Status::success) {
    return status;
  }
  // A coordinate that has hardly moved yet may be judged beside the others: constraints make it move with them.
  const double others = beside_others_ * usual_.lpNorm<Eigen::Infinity>();
  const double begun = beside_others_ * begun_.lpNorm<Eigen::Infinity>();
  for (Index r = 0; r < n_; ++r) {
    const double moved = (x_.Y.row(r) - begun_.row(r)).lpNorm<Eigen::Infinity>();
    const double usual = std::max(usual_[r], others);
    const double allowed = std::max({begun_.row(r).lpNorm<Eigen::Infinity>(), usual, begun});
    far_ = far_ || (usual > 0.0 && moved > tuning::of_lagrangian::lagrangian_farthest * allowed);
  }
  return far_ ? Status::not_converged : status;
}

Status PolynomialScheme::approach(double h, double accuracy) {
  for (int parts = 2; parts <= tuning::of_lagrangian::lagrangian_finest_approach; parts *= 2) {
    double share = 1.0 / parts;
    const double growth = std::pow(share, -1.0 / parts);
    start_on_parabola(share * h);
    Status status = iterate_nearby(share * h, accuracy);
    for (int part = 0; part < parts && status == Status::success; ++part) {
      const double next = part + 1 == parts ? 1.0 : share * growth;
      shorter_.Y = x_.Y;
      shorter_.mu = x_.mu;
      continue_from(shorter_, 0.0, next / share);
      share = next;
      status = iterate_nearby(share * h, accuracy);
    }
    if (status == Status::success) {
      return status;
    }
  }
  return Status::not_converged;
}

void PolynomialScheme::remember_trial(double h) {
  if (known_trial_h_ == 0.0) {
    trial_.Y = x_.Y;
    trial_.mu = x_.mu;
    known_trial_h_ = h;
  }
}

void PolynomialScheme::move_on(const VectorXd& seed) {
  seed_ = seed;
  std::swap(last_, x_);
  last_h_ = trial_h_;
  start_level();
}

}  // namespace rubato
