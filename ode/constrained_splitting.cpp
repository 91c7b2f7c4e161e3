#include <rubato/ode/constrained_splitting.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/lagrange_weight.hpp>
#include <rubato/ode/constraints.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace rubato {

namespace {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// T(p) with its first and second derivatives.
class KineticEnergy {
public:
  KineticEnergy(formula::Expression T, std::span<const formula::Expression> momenta) {
    std::vector<formula::Expression> outputs = {T}, second;
    std::ranges::copy(formula::gradient(T, momenta), std::back_inserter(outputs));
    for (const formula::HessianEntry& entry : formula::hessian_entries(T, momenta)) {
      second.push_back(entry.value);
      places_.push_back({entry.row, entry.column});
    }
    first_ = formula::ScalarEvaluator(formula::Bytecode(outputs, momenta));
    second_ = formula::ScalarEvaluator(formula::Bytecode(second, momenta));
  }

  void evaluate(const double* p) { outputs_ = first_.at(p); }
  [[nodiscard]] double value() const { return outputs_[0]; }
  [[nodiscard]] const double* velocity() const { return outputs_ + 1; }
  /// result = G T_pp at p, a column for each momentum.
  void along(const double* p, const std::vector<Constraints::Place>& places, const VectorXd& entries,
             MatrixXd& result) {
    dense_.setZero(result.rows(), result.cols());
    const double* entry = entries.data();
    for (const auto [row, column] : places) {
      dense_(static_cast<Index>(row), static_cast<Index>(column)) = *entry++;
    }
    result.setZero();
    const double* second = second_.at(p);
    for (const auto [row, column] : places_) {
      const auto a = static_cast<Index>(row), b = static_cast<Index>(column);
      result.col(a) += *second * dense_.col(b);
      if (a != b) {
        result.col(b) += *second * dense_.col(a);
      }
      ++second;
    }
  }

private:
  formula::ScalarEvaluator first_, second_;
  std::vector<Constraints::Place> places_;
  const double* outputs_ = nullptr;
  MatrixXd dense_;
};

/// V, its gradient and the entries of G at a node.
struct ConstrainedNode {
  VectorXd q, force, entries;  ///< force: ∇V
  double V = 0.0;
  bool known = false;
};

/// The multipliers of a step over its length, a column for each drift, and the time of its middle.
struct StepMultipliers {
  double time = 0.0;
  MatrixXd values;
};

class ConstrainedSplitting final : public OneStepState<VectorXd> {
public:
  ConstrainedSplitting(const Hamiltonian& hamiltonian, const Separation& halves, const Composition& composition,
                       std::span<const double> z_0)
      : OneStepState(hamiltonian, z_0),
        composition_(composition),
        constraints_(hamiltonian.constraints()),
        q_names_(hamiltonian.q_names()),
        n_(static_cast<Index>(z_0.size()) / 2),
        count_(static_cast<Index>(constraints_.count())),
        T_(halves.T, std::span(hamiltonian.variables()).subspan(static_cast<std::size_t>(n_))),
        at_(constraints_),
        energy_size_(hamiltonian.size_code()),
        solver_(static_cast<int>(count_)) {
    const std::span<const formula::Expression> q =
        std::span(hamiltonian.variables()).first(static_cast<std::size_t>(n_));
    std::vector<formula::Expression> outputs = {halves.V};
    std::ranges::copy(formula::gradient(halves.V, q), std::back_inserter(outputs));
    V_ = formula::ScalarEvaluator(formula::Bytecode(outputs, q));
    const auto drifts = std::ranges::count_if(composition.parts, &Composition::Part::drift);
    multipliers_.setZero(count_, drifts);
    for (StepMultipliers& step : last_) {
      step.values.setZero(count_, drifts);
    }
    for (ConstrainedNode* node : {&here_, &there_, &node_}) {
      node->q.setZero(n_);
      node->force.setZero(n_);
      node->entries.setZero(static_cast<Index>(constraints_.places().size()));
    }
    for (VectorXd* vector : {&end_, &point_, &errors_, &begun_}) {
      vector->setZero(2 * n_);
    }
    for (VectorXd* vector : {&mu_, &rates_}) {
      vector->setZero(count_);
    }
    along_.setZero(count_, n_);
    matrix_.setZero(count_, count_);
  }

  [[nodiscard]] int order() const override { return composition_.order; }
  [[nodiscard]] bool has_node_law() const override { return false; }
  [[nodiscard]] bool solves_fully() const override { return true; }

  [[nodiscard]] Status advance(double h, double) override {
    forget_trial();
    trial_h_ = h;
    dependent_.clear();
    Status status = step(h);
    if (status == Status::not_converged) {  // multipliers that were extrapolated too far
      known_ = 0;
      tried_ = false;
      status = step(h);
    }
    tried_ = status == Status::success;
    forget_trial();
    return status;
  }

  [[nodiscard]] Status tangent(std::span<double>) override { return Status::undefined; }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_by_nodes(energy_, trial_h_); }
  [[nodiscard]] bool slope_costs_more() const override { return true; }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    z_.displaced(0.5, delta_, point_);
    errors_ = 2.0 * (point_.cwiseAbs() + delta_.cwiseAbs());
    formula::SumSize size = energy_size_(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
    size.rounding *= magnitude_;
    return size;
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    std::rotate(last_.begin(), last_.end() - 1, last_.end());
    last_.front().values.swap(multipliers_);
    last_.front().time = time_ + 0.5 * trial_h_;
    time_ += trial_h_;
    known_ = std::min(known_ + 1, last_.size());
    take();
    std::swap(here_, there_);
    here_.known = here_.known && here_.q == z_.value().head(n_);
    start_level();
  }
  void restart(std::span<const double> z) override {
    stand_at(Eigen::Map<const VectorXd>(z.data(), 2 * n_));
    known_ = 0;
    time_ = 0.0;
    here_.known = false;
    start_level();
  }
  void save(StateWriter& state) const override {
    z_.save(state);
    state.write(static_cast<double>(known_));
    state.write(time_);
    for (const StepMultipliers& step : last_) {
      state.write(step.time);
      state.write({step.values.data(), static_cast<std::size_t>(step.values.size())});
    }
  }
  void restore(StateReader& state) override {
    restore_state(state);
    double known = 0.0;
    state.read(known);
    known_ = static_cast<std::size_t>(known);
    state.read(time_);
    for (StepMultipliers& step : last_) {
      state.read(step.time);
      state.read(std::span<double>(step.values.data(), static_cast<std::size_t>(step.values.size())));
    }
    here_.known = false;
    start_level();
  }

  [[nodiscard]] std::string failure_reason() const override {
    return dependence_near(dependent_, q_names_, end_.head(n_));
  }

  /// Requires G ∇T(p) = 0 to rounding at the start. \throws std::invalid_argument, with the momenta that satisfy it
  void check_start(std::span<const std::string> p_names) {
    end_ = z_.value();
    at_.evaluate(end_.data());
    T_.evaluate(end_.data() + n_);
    at_.rates(T_.velocity(), rates_);
    if (at_.left(rates_, T_.velocity()).in_roundings <= roundings_of_start) {
      return;
    }
    const VectorXd rates = rates_;
    node_.entries = at_.entries();
    const bool found = project() == Status::success;
    refuse_start_off_hidden(constraints_, rates, found ? listed(p_names, end_.tail(n_)) : std::string());
  }

private:
  [[nodiscard]] NodeEnergy node_at(const VectorXd& z) override {
    return {evaluator_.value(z.data()), std::numeric_limits<double>::quiet_NaN()};
  }
  void start_level() {
    tried_ = false;
    trial_h_ = 0.0;
    iterations_ = 0;
  }

  void evaluate_potential(ConstrainedNode& node) {
    const double* const outputs = V_.at(node.q.data());
    node.V = outputs[0];
    std::copy_n(outputs + 1, n_, node.force.data());
  }

  [[nodiscard]] Status step(double h) {
    if (!here_.known) {
      here_.q = z_.value().head(n_);
      evaluate_potential(here_);
      at_.evaluate(here_.q.data());
      here_.entries = at_.entries();
      here_.known = true;
    }
    delta_.setZero();
    energy_ = 0.0;
    node_ = here_;
    Index drift = 0;
    for (const Composition::Part& part : composition_.parts) {
      if (!part.drift) {
        delta_.tail(n_) -= part.length * h * node_.force;
        energy_ += part.length * node_.V;
        continue;
      }
      if (const Status status = drift_to_constraint(part.length * h, drift++, h); status != Status::success) {
        return status;
      }
      energy_ += part.length * T_.value();
      node_.q = end_.head(n_);
      node_.entries = at_.entries();
      evaluate_potential(node_);
    }
    if (const Status status = project(); status != Status::success) {
      return status;
    }
    there_ = node_;
    there_.known = true;
    return std::isfinite(energy_) && delta_.allFinite() ? Status::success : Status::undefined;
  }

  /// The multipliers to begin with: those of a trial at this level, or of the last steps, extrapolated.
  void guess(Index drift, double h) {
    if (tried_) {
      mu_ = h * multipliers_.col(drift);
      return;
    }
    mu_.setZero();
    for (std::size_t i = 0; i < known_; ++i) {
      const auto time_of = [&](std::size_t k) { return last_[k].time; };
      mu_ += lagrange_weight(i, known_, time_ + 0.5 * h, time_of, h) * last_[i].values.col(drift);
    }
  }

  /// p -= Gᵀμ and q += length ∇T(p), with g = 0 at its end, by Newton's method for μ; its matrix is kept as long as
  /// corrections shrink fast.
  [[nodiscard]] Status drift_to_constraint(double length, Index drift, double h) {
    guess(drift, h);
    begun_ = delta_;
    double last = std::numeric_limits<double>::infinity();
    bool factored = false;
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      ++iterations_;
      delta_ = begun_;
      at_.kick(node_.entries, mu_, delta_.data() + n_);
      displace(n_, 2 * n_);
      T_.evaluate(end_.data() + n_);
      for (Index a = 0; a < n_; ++a) {
        delta_[a] += length * T_.velocity()[a];
      }
      displace(0, n_);
      at_.evaluate(end_.data());
      if (!at_.is_finite()) {
        return Status::undefined;
      }
      const ConstraintEvaluator::Left left = at_.left(end_.data());
      if (left.in_roundings <= roundings_of_step ||
          (left.relative >= 0.5 * last && left.relative <= stagnant_constraint)) {
        multipliers_.col(drift) = mu_ / h;
        return Status::success;
      }
      if (!factored || left.relative > slowest_multipliers * last) {
        if (const Status status = factor(length); status != Status::success) {
          return status;
        }
        factored = true;
      }
      last = left.relative;
      rates_ = at_.g();
      solver_.solve(rates_.data());
      mu_ += rates_;
    }
    return Status::not_converged;
  }

  /// p -= Gᵀν with G ∇T(p) = 0 at the end of the step.
  [[nodiscard]] Status project() {
    double last = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      displace(n_, 2 * n_);
      T_.evaluate(end_.data() + n_);
      at_.rates(T_.velocity(), rates_);
      const ConstraintEvaluator::Left left = at_.left(rates_, T_.velocity());
      if (!std::isfinite(left.relative)) {
        return Status::undefined;
      }
      if (left.in_roundings <= roundings_of_step ||
          (left.relative >= 0.5 * last && left.relative <= stagnant_constraint)) {
        return Status::success;
      }
      if (iteration == 0 || left.relative > slowest_multipliers * last) {
        if (const Status status = factor(1.0); status != Status::success) {
          return status;
        }
      }
      last = left.relative;
      solver_.solve(rates_.data());
      at_.kick(node_.entries, rates_, delta_.data() + n_);
    }
    return Status::not_converged;
  }

  /// The numbers from `first` to `last` of the end of the step.
  void displace(Index first, Index last) {
    for (Index i = first; i < last; ++i) {
      end_[i] = z_.value()[i] + (z_.low()[i] + delta_[i]);
    }
  }

  /// Factors length·G T_pp G_0ᵀ, G at the end of the drift and G_0 at its node.
  [[nodiscard]] Status factor(double length) {
    T_.along(end_.data() + n_, constraints_.places(), node_.entries, along_);
    matrix_.setZero();
    const double* entry = at_.entries().data();
    for (const auto [row, column] : constraints_.places()) {
      const double factor = length * *entry++;
      for (Index j = 0; j < count_; ++j) {
        matrix_(static_cast<Index>(row), j) += factor * along_(j, static_cast<Index>(column));
      }
    }
    if (solver_.factor(matrix_.data()) == Status::success && solver_.rcond_estimate() > least_multiplier_pivot) {
      return Status::success;
    }
    dependent_ = at_.dependent();
    return Status::undefined;
  }

  const Composition& composition_;
  double magnitude_ = composition_.magnitude();
  Constraints constraints_;
  std::vector<std::string> q_names_;
  Index n_, count_;
  KineticEnergy T_;
  formula::ScalarEvaluator V_;
  ConstraintEvaluator at_;
  formula::SumSizeEvaluator energy_size_;
  solve::DenseSolver solver_;
  ConstrainedNode here_, there_, node_;
  MatrixXd multipliers_;                 ///< of the trial, as StepMultipliers has them
  std::array<StepMultipliers, 4> last_;  ///< of the last steps, newest first
  std::size_t known_ = 0;                ///< of these
  double time_ = 0.0;                    ///< of the level, since the first of them
  bool tried_ = false;                   ///< whether there is a trial at this level
  VectorXd end_, point_, errors_, mu_, rates_, begun_;
  MatrixXd along_, matrix_;
  double trial_h_ = 0.0, energy_ = 0.0;
  int iterations_ = 0;
  std::string dependent_;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_constrained_splitting(const Hamiltonian& hamiltonian,
                                                          const Composition& composition, std::span<const double> z_0) {
  check_initial_state(hamiltonian, z_0);
  const Separation halves = separate(hamiltonian);
  if (!halves.separable()) {
    throw std::invalid_argument(
        fmt::format("constraints need H = T(p) + V(q); the term {} depends on coordinates and momenta: state the "
                    "problem by its Lagrangian",
                    halves.mixed));
  }
  if (!composition.is_of_verlet_steps()) {
    throw std::invalid_argument(fmt::format(
        "composition = \"{}\" is made of exact flows of T(p), which constraints do not leave exact: use one "
        "of Verlet steps, {}",
        composition.name, fmt::join(compositions_of_verlet_steps(), ", ")));
  }
  check_constraints(hamiltonian.constraints(), hamiltonian.q_names(), z_0.first(z_0.size() / 2));
  auto scheme = std::make_unique<ConstrainedSplitting>(hamiltonian, halves, composition, z_0);
  scheme->check_start(hamiltonian.p_names());
  return scheme;
}

}  // namespace rubato
