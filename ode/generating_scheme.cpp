#include <rubato/ode/generating_scheme.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/limits.hpp>
#include <rubato/ode/flow_map.hpp>
#include <rubato/ode/generating_action.hpp>
#include <rubato/ode/generating_continuation.hpp>
#include <rubato/ode/generating_forecast.hpp>
#include <rubato/ode/generating_function.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/node_law.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/power_of.hpp>

namespace rubato {

namespace {

using namespace tuning::generating;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// -24 φ^(s+1), which the step law of order s has in place of Γ.
constexpr double gamma_by_eta = -24.0;

class GeneratingScheme final : public OneStepScheme {
public:
  GeneratingScheme(const Hamiltonian& hamiltonian, const MatrixXd& F, const GeneratingOrder& order,
                   std::span<const double> z_0)
      : order_(order),
        generating_(hamiltonian, F, order.order),
        at_node_(hamiltonian, F, order.order),
        continuation_(generating_),
        prediction_error_(F.rows()),
        flow_(hamiltonian, order.order + extra_flow_order),
        tangent_(hamiltonian, std::min(order.order + 1, most_tangent_order)),
        small_tangent_(hamiltonian, std::min(order.order + 1, small_tangent_order)),
        energy_evaluator_(hamiltonian),
        energy_size_(hamiltonian.size_code()),
        gradient_rounding_(hamiltonian.gradient_code()),
        gamma_factor_(NodeLaw::gamma_factor(F, order.order)),
        plain_(generating_.odd()),
        size_(F.rows()),
        weight_(plain_ ? MatrixXd() : darboux_weight(F)),
        z_(VectorXd(Eigen::Map<const VectorXd>(z_0.data(), size_))),
        history_(size_) {
    for (VectorXd* vector : {&delta_, &step_, &point_, &w_, &continued_from_, &continued_, &slope_, &residual_,
                             &correction_, &lost_, &moved_, &rounding_point_}) {
      vector->setZero(size_);
    }
    node_ = node_at(z_.value());
    node_known_ = true;
  }

  [[nodiscard]] std::size_t dimension() const override { return static_cast<std::size_t>(size_); }
  [[nodiscard]] std::span<const double> state() const override { return as_span(z_.value()); }
  [[nodiscard]] int order() const override { return order_.order; }
  [[nodiscard]] double gamma_factor() const override { return gamma_factor_; }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    if (const Status status = predict(h); status != Status::success) {
      return status;
    }
    double previous = 0.0;
    double first = 0.0;
    StagnationTest test(accuracy);
    for (int iteration = 0; iteration < most_generating_iterations; ++iteration) {
      if (const Status status = correct(h); status != Status::success) {
        return fail(status);
      }
      const double size = relative_size(correction_);
      if (!std::isfinite(size)) {
        return fail(Status::undefined);
      }
      if (previous > measurable_correction) {
        surprise_ = std::max({surprise_, 1.0, (size - rounding) / (previous * estimate_)});
      }
      if (iteration == 0) {
        first = std::max(size, forecast_size_);
      }
      estimate_ = displacement_error + tangent_error_ + first;
      previous = size;
      const double rate = surprise_ > 0.0 ? std::min(1.0, rate_margin * surprise_ * estimate_) : 1.0;
      const auto verdict = test.judge(size, relative_size(residual_));
      // A correction as large as δ itself was made for another one, whose residual is small only beside the new δ.
      constexpr double same = 0.5;
      if (size < same && (verdict == StagnationTest::Verdict::done || rate * size <= 0.25 * epsilon ||
                          (verdict != StagnationTest::Verdict::again && residual_is_rounding(h)))) {
        return finish(h);
      }
    }
    return fail(Status::not_converged);
  }

  /// With G = ∂²Φ_s/∂w² and w = z_k + E_F δ: (J - G E_F)(V_1 - V_0) = G V_0.
  [[nodiscard]] Status tangent(std::span<double> columns) override {
    const Index count = static_cast<Index>(columns.size()) / size_, n = size_ / 2;
    place();
    MatrixXd curvature(size_, size_);
    if (const Status status = generating_.hessian_sum(as_span(w_), trial_h_, order_.terms, curvature);
        status != Status::success) {
      reason_ = generating_.failure();
      return status;
    }
    MatrixXd matrix = plain_ ? MatrixXd(-0.5 * curvature) : MatrixXd(-curvature.lazyProduct(weight_));
    matrix.topRightCorner(n, n).diagonal().array() += 1.0;
    matrix.bottomLeftCorner(n, n).diagonal().array() -= 1.0;
    Eigen::Map<MatrixXd> all(columns.data(), size_, count);
    const MatrixXd rhs = curvature.lazyProduct(all);
    const auto changes = solve::quotient(matrix, rhs);
    if (!changes) {
      return Status::singular;
    }
    all += *changes;
    return all.allFinite() ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] formula::SumSize energy_size() override {
    if (!predicted_) {
      return energy_size_(as_span(z_.value()));
    }
    formula::SumSize size = energy_size_(as_span(w_));
    size.rounding += generating_.rate_rounding(trial_h_, order_.terms);
    return size;
  }
  /// s(s+1) h^(s-1) φ^(s+1)(w), to leading order.
  [[nodiscard]] double discrete_energy_slope() const override {
    const int s = order_.order;
    return s * (s + 1.0) * power_of(trial_h_, s - 1) * tail_;
  }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] int iterations() const override { return iterations_; }
  [[nodiscard]] std::string failure_reason() const override { return reason_; }

  [[nodiscard]] NodeEnergy node() override {
    if (!node_known_) {
      node_ = node_at(z_.value());
      node_known_ = true;
    }
    return node_;
  }

  void accept() override {
    continued_h_ = trial_h_;
    continued_terms_ = generating_.known_terms();
    continued_from_ = w_;
    if (is_continued_) {
      moved_ = delta_ - continued_;
      prediction_error_.record(trial_h_, moved_, [this](const VectorXd& v) { return relative_size(v); });
    } else {
      prediction_error_.restart();
    }
    history_.record(trial_h_, delta_);
    z_.add(delta_, lost_);
    start_level();
  }

  void save(StateWriter& state) const override {
    z_.save(state);
    history_.save(state);
    prediction_error_.save(state);
    state.write(surprise_);
    state.write(continued_h_);
    state.write(static_cast<double>(continued_terms_));
    state.write(as_span(continued_from_));
  }

  void restore(StateReader& state) override {
    z_.restore(state);
    history_.restore(state);
    prediction_error_.restore(state);
    state.read(surprise_);
    state.read(continued_h_);
    state.read(continued_terms_);
    if (continued_terms_ < 0 || continued_terms_ > generating_.terms()) {
      throw std::invalid_argument("a saved state has more terms than there are");
    }
    state.read(as_span(continued_from_));
    if (continued_h_ != 0.0 &&
        generating_.expand_gradients(as_span(continued_from_), continued_terms_) != Status::success) {
      continued_h_ = 0.0;
    }
    start_level();
  }

  void restart(std::span<const double> z) override {
    z_ = CompensatedState<VectorXd>(VectorXd(Eigen::Map<const VectorXd>(z.data(), size_)));
    history_ = VelocityHistory<VectorXd>(size_);
    prediction_error_.restart();
    surprise_ = 0.0;
    continued_h_ = 0.0;
    start_level();
  }

private:
  void start_level() {
    predicted_ = tail_known_ = node_known_ = false;
    iterations_ = 0;
  }

  [[nodiscard]] double relative_size(const VectorXd& v) const { return history_.relative_size(v, delta_, z_.value()); }

  Status fail(Status status) {
    predicted_ = false;
    return status;
  }

  /// δ of the orbit of the last step continued, or of a Taylor step; at a second h within the level, that of the trial
  /// continued.
  Status predict(double h) {
    if (predicted_) {
      is_continued_ = is_continued_ && h == trial_h_;
      static_cast<void>(continuation_.increment(generating_, trial_h_, h - trial_h_, moved_));  // near at any rate
      delta_ += moved_;
    } else {
      is_continued_ = continued_h_ != 0.0 && continuation_.increment(generating_, continued_h_, h, continued_);
      forecast_size_ = 0.0;
      if (is_continued_) {
        delta_ = continued_;
        prediction_error_.correct(h, delta_);
        moved_ = delta_ - continued_;
        forecast_size_ = relative_size(moved_);
      } else {
        if (const Status status = flow_.start(z_.value(), h); status != Status::success) {
          reason_ = flow_.failure();
          return status;
        }
        flow_.increment(h, delta_);
      }
    }
    predicted_ = true;
    trial_h_ = h;
    return Status::success;
  }

  /// E_F v, as step_.
  void weigh(const VectorXd& v) {
    if (plain_) {
      step_ = 0.5 * v;
    } else {
      step_.noalias() = weight_ * v;
    }
  }

  /// w = z_k + E_F δ
  void place() {
    weigh(delta_);
    z_.displaced(1.0, step_, w_);
  }

  /// One correction of δ.
  Status correct(double h) {
    place();
    ++iterations_;
    if (const Status status = generating_.expand_gradients(as_span(w_), order_.terms); status != Status::success) {
      reason_ = generating_.failure();
      return status;
    }
    generating_.gradient_sum(h, order_.terms, slope_);
    apply_j(slope_, residual_);
    residual_ = -residual_ - delta_;
    correction_ = residual_;
    if (const double size = displaced_size(h); size > 0.0) {
      FlowTangent& tangent = size <= small_residual ? small_tangent_ : tangent_;
      const double scale = displacement / size;
      weigh(residual_);
      step_ *= scale;
      if (const Status status = tangent.apply(z_.value(), step_, h, moved_); status != Status::success) {
        reason_ = tangent.failure();
        return status;
      }
      correction_ += moved_ / scale;
      tangent_error_ = relative_size(tangent.last_terms()) / displacement;
    }
    moved_ = delta_;
    delta_ += correction_;
    lost_ = correction_ - (delta_ - moved_);
    return Status::success;
  }

  /// The bound of the rounding errors of the rate of component i, over ½ε, as evaluated last.
  [[nodiscard]] double rate_bound(Index i) const {
    const Index n = size_ / 2;
    return gradient_rounding_.bound(static_cast<std::size_t>(1 + (i < n ? n + i : i - n)));
  }

  /// The relative size of the residual, to displace by. A component that is 0 but for rounding errors would leave the
  /// others next to no displacement: it is measured by the terms of its rate.
  double displaced_size(double h) {
    const double size = relative_size(residual_);
    if (size <= large_residual) {
      return size;
    }
    rounding_point_ = w_.cwiseAbs();
    gradient_rounding_.run(as_span(w_), as_span(rounding_point_));
    for (Index i = 0; i < size_; ++i) {
      moved_[i] = std::max(std::abs(delta_[i]), std::abs(h) * rate_bound(i));
    }
    return history_.relative_size(residual_, moved_, z_.value());
  }

  /// Whether the last residual, -J∇Φ_s(w, h) - δ, was no more than its evaluation rounds at: that of its first term,
  /// hJ∇H(w), with w itself rounded, and as much again from each of the others.
  bool residual_is_rounding(double h) {
    rounding_point_ = w_.cwiseAbs() + delta_.cwiseAbs();
    gradient_rounding_.run(as_span(w_), as_span(rounding_point_));
    for (Index row = 0; row < size_; ++row) {
      const double bound = order_.terms * std::abs(h) * rate_bound(row) + 4.0 * std::abs(delta_[row]);
      if (!(std::abs(residual_[row]) <= epsilon * bound)) {
        return false;
      }
    }
    return true;
  }

  /// E_k at the last w, and to first order at the δ corrected since; φ^(s+1) there.
  Status finish(double h) {
    Status status = Status::success;
    generating_.gradient_sum_rate(h, order_.terms, slope_);
    weigh(correction_);
    const double change = slope_.dot(step_);
    const bool fresh = !tail_known_ || std::abs(h - tail_h_) > tail_ratio * std::abs(h);
    if (fresh) {
      status = generating_.extend_gradients(order_.order);
    }
    if (status == Status::success) {
      status = generating_.expand_values();
    }
    if (status != Status::success) {
      reason_ = generating_.failure();
      return fail(status);
    }
    if (fresh) {
      tail_ = generating_.coefficient(order_.order + 1);
      tail_h_ = h;
      tail_known_ = true;
    }
    energy_ = -(generating_.sum_rate(h, order_.terms) + change);
    return Status::success;
  }

  /// NaN where H has no Taylor expansion, for the caller to judge.
  NodeEnergy node_at(const VectorXd& z) {
    NodeEnergy node{energy_evaluator_.value(z.data()), std::numeric_limits<double>::quiet_NaN()};
    if (at_node_.expand(as_span(z)) == Status::success) {
      node.gamma = gamma_by_eta * at_node_.coefficient(order_.order + 1);
    } else {
      reason_ = at_node_.failure();
    }
    return node;
  }

  GeneratingOrder order_;
  GeneratingFunction generating_, at_node_;  ///< at w, and at z
  OrbitContinuation continuation_;
  PredictionError prediction_error_;
  FlowMap flow_;
  FlowTangent tangent_, small_tangent_;
  HamiltonianEvaluator energy_evaluator_;
  formula::SumSizeEvaluator energy_size_;
  formula::RoundingEvaluator gradient_rounding_;
  double gamma_factor_;
  bool plain_;  ///< F = 0
  Index size_;
  MatrixXd weight_;  ///< E_F, unless it is ½
  CompensatedState<VectorXd> z_;
  VelocityHistory<VectorXd> history_;

  VectorXd delta_, w_;
  VectorXd continued_from_;   ///< w of the last step, whose orbit generating_ holds at a new level
  double continued_h_ = 0.0;  ///< its length; 0 before the first
  int continued_terms_ = 0;
  VectorXd continued_;          ///< the prediction by it
  bool is_continued_ = false;   ///< whether δ started there, and with the present h
  double forecast_size_ = 0.0;  ///< of what was added to it
  VectorXd step_, point_, slope_, residual_, correction_, moved_, rounding_point_;
  VectorXd lost_;               ///< of the last correction, when it was added to δ
  double tangent_error_ = 0.0;  ///< of the tangent that made the last correction, relative
  double estimate_ = 0.0;       ///< of how much smaller than the last correction the next will be: by the errors of the
                                ///< tangent, and by what truncation and curvature make of the first correction
  double surprise_ = 0.0;       ///< the largest factor so far by which it was larger than that; 0: not measured
  bool predicted_ = false;
  double trial_h_ = 0.0;
  double energy_ = 0.0;
  double tail_ = 0.0, tail_h_ = 0.0;  ///< φ^(s+1) at w, and the h for which it was last computed
  bool tail_known_ = false;
  int iterations_ = 0;
  NodeEnergy node_;
  bool node_known_ = false;
  std::string reason_;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_generating_scheme(const Hamiltonian& hamiltonian, const MatrixXd& F, int order,
                                                      std::span<const double> z_0) {
  const std::size_t size = 2 * hamiltonian.degrees_of_freedom();
  if (z_0.size() != size) {
    throw std::invalid_argument(fmt::format(
        "the initial state has {} entries, the Hamiltonian has {} coordinates and as many momenta: {} are needed",
        z_0.size(), size / 2, size));
  }
  check_darboux_symmetric(F, static_cast<Index>(size / 2));
  auto scheme = std::make_unique<GeneratingScheme>(hamiltonian, F, generating_order(order, F), z_0);
  const NodeEnergy node = scheme->node();
  if (!std::isfinite(node.energy) || !std::isfinite(node.gamma)) {
    throw std::invalid_argument(fmt::format(
        "H has no Taylor expansion at the initial state ({}): {}", fmt::join(z_0, ", "),
        scheme->failure_reason().empty() ? fmt::format("its value is {}", node.energy) : scheme->failure_reason()));
  }
  return scheme;
}

}  // namespace rubato
