#include <rubato/ode/splitting_scheme.hpp>

#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/ode/node_law.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/ode/separable.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

/// Instructions of a step up to which it is one formula: to compile them takes a millisecond.
constexpr std::size_t longest_whole_step = 4000;

/// T or V with its gradient.
class Half {
public:
  Half(formula::Expression energy, std::span<const formula::Expression> variables)
      : variables_(variables.begin(), variables.end()), outputs_of_(1, energy) {
    const auto gradient = formula::gradient(energy, variables);
    outputs_of_.insert(outputs_of_.end(), gradient.begin(), gradient.end());
    evaluate_ = formula::ScalarEvaluator(formula::Bytecode(outputs_of_, variables));
  }

  /// The value and the gradient at a point that is told by formulas of another graph.
  [[nodiscard]] std::vector<formula::Expression> at(std::span<const formula::Expression> point,
                                                    formula::Graph& graph) const {
    return formula::substitute(outputs_of_, graph, variables_, point);
  }
  [[nodiscard]] std::size_t instructions() const { return evaluate_.code().instructions().size(); }

  /// The value at x (n entries), whose gradient is in gradient() until the next call.
  double operator()(const double* x) {
    outputs_ = evaluate_.at(x);
    return outputs_[0];
  }
  [[nodiscard]] const double* gradient() const { return outputs_ + 1; }

private:
  std::vector<formula::Expression> variables_, outputs_of_;
  formula::ScalarEvaluator evaluate_;
  const double* outputs_ = nullptr;
};

/// A whole step as one formula, (z in its two parts, h) ↦ (E, δ): the operations of part after part, with their
/// numbers, which machine code then keeps in registers from one part to the next. Empty where that would be long.
std::optional<formula::ScalarEvaluator> whole_step(const Half& T, const Half& V, const Composition& composition,
                                                   std::size_t n) {
  std::size_t instructions = 0;
  for (const Composition::Part& part : composition.parts) {
    instructions += (part.drift ? T : V).instructions() + 4 * n;
  }
  if (instructions > longest_whole_step) {
    return std::nullopt;
  }
  formula::Graph graph;
  std::vector<formula::Expression> inputs;
  for (const char* name : {"high", "low"}) {
    for (std::size_t i = 0; i < 2 * n; ++i) {
      inputs.push_back(graph.variable(fmt::format("{}{}", name, i)));
    }
  }
  const formula::Expression h = graph.variable("h");
  const std::vector<formula::Expression> high(inputs.begin(), inputs.begin() + static_cast<std::ptrdiff_t>(2 * n)),
      low(inputs.begin() + static_cast<std::ptrdiff_t>(2 * n), inputs.end());
  inputs.push_back(h);
  std::vector<formula::Expression> delta(2 * n, graph.constant(0.0)), point;
  for (std::size_t i = 0; i < 2 * n; ++i) {
    point.push_back(high[i] + low[i]);
  }
  formula::Expression energy = graph.constant(0.0);
  for (const Composition::Part& part : composition.parts) {
    const Half& half = part.drift ? T : V;
    const std::size_t moved = part.drift ? 0 : n;
    const auto value = half.at(std::span(point).subspan(n - moved, n), graph);
    energy += part.length * value[0];
    const formula::Expression length = (part.drift ? part.length : -part.length) * h;
    for (std::size_t i = 0; i < n; ++i) {
      formula::Expression& change = delta[moved + i];
      change += length * value[1 + i];
      point[moved + i] = high[moved + i] + (low[moved + i] + change);
    }
  }
  std::vector<formula::Expression> outputs = {energy};
  outputs.insert(outputs.end(), delta.begin(), delta.end());
  return formula::ScalarEvaluator(formula::Bytecode(outputs, inputs));
}

class SplittingScheme final : public OneStepState<VectorXd> {
public:
  SplittingScheme(const Hamiltonian& hamiltonian, const Separation& halves, const Composition& composition,
                  std::span<const double> z_0)
      : OneStepState(hamiltonian, z_0),
        composition_(composition),
        law_(hamiltonian, composition.gamma),
        energy_size_(hamiltonian.size_code()),
        n_(static_cast<Index>(hamiltonian.degrees_of_freedom())),
        T_(halves.T, std::span(hamiltonian.variables()).subspan(hamiltonian.degrees_of_freedom())),
        V_(halves.V, std::span(hamiltonian.variables()).first(hamiltonian.degrees_of_freedom())),
        whole_(whole_step(T_, V_, composition, hamiltonian.degrees_of_freedom())) {
    inputs_.setZero(4 * n_ + 1);
    point_.setZero(2 * n_);
    errors_.setZero(2 * n_);
  }

  [[nodiscard]] int order() const override { return composition_.order; }
  [[nodiscard]] bool has_node_law() const override { return composition_.has_node_law(); }

  /// Explicit: `accuracy` has nothing to bear on.
  [[nodiscard]] Status advance(double h, double /*accuracy*/) override {
    trial_h_ = h;
    forget_trial();
    ++iterations_;
    energy_ = whole_ ? by_whole(h) : by_parts(h);
    return std::isfinite(energy_) && delta_.allFinite() ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_by_nodes(energy_, trial_h_); }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    z_.displaced(0.5, delta_, point_);
    errors_ = 2.0 * (point_.cwiseAbs() + delta_.cwiseAbs());
    formula::SumSize size = energy_size_(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
    size.rounding *= composition_.magnitude();
    return size;
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    take();
    iterations_ = 0;
  }
  void restart(std::span<const double> z) override {
    stand_at(Eigen::Map<const VectorXd>(z.data(), 2 * n_));
    iterations_ = 0;
  }

  void save(StateWriter& state) const override { z_.save(state); }
  void restore(StateReader& state) override {
    restore_state(state);
    iterations_ = 0;
  }

private:
  [[nodiscard]] LevelNode node_at(const VectorXd& z) override { return law_(z.data()); }

  /// δ. \return E
  ///@{
  double by_whole(double h) {
    inputs_.head(2 * n_) = z_.value();
    inputs_.segment(2 * n_, 2 * n_) = z_.low();
    inputs_[4 * n_] = h;
    const double* const outputs = whole_->at(inputs_.data());
    delta_ = Eigen::Map<const VectorXd>(outputs + 1, 2 * n_);
    return outputs[0];
  }
  double by_parts(double h) {
    delta_.setZero();
    z_.displaced(1.0, delta_, point_);
    double energy = 0.0;
    for (const Composition::Part& part : composition_.parts) {
      // One half of δ changes, and with it that half of the point.
      Half& half = part.drift ? T_ : V_;
      const double length = part.drift ? part.length * h : -(part.length * h);
      const Index moved = part.drift ? 0 : n_;
      energy += part.length * half(point_.data() + n_ - moved);
      const double* const gradient = half.gradient();
      for (Index i = 0; i < n_; ++i) {
        double& delta = delta_[moved + i];
        delta += length * gradient[i];
        point_[moved + i] = z_.displaced(moved + i, delta);
      }
    }
    return energy;
  }
  ///@}

  const Composition& composition_;
  NodeLaw law_;
  formula::SumSizeEvaluator energy_size_;
  Index n_;
  Half T_, V_;
  std::optional<formula::ScalarEvaluator> whole_;
  VectorXd inputs_;  ///< of whole_
  VectorXd point_, errors_;
  double trial_h_ = 0.0, energy_ = 0.0;
  int iterations_ = 0;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_splitting_scheme(const Hamiltonian& hamiltonian, const Composition& composition,
                                                     std::span<const double> z_0) {
  check_initial_state(hamiltonian, z_0);
  const Separation halves = separate(hamiltonian);
  if (!halves.separable()) {
    throw std::invalid_argument(fmt::format(
        "a splitting needs H = T(p) + V(q); the term {} depends on coordinates and momenta: use lagrangian = \"gauss\"",
        halves.mixed));
  }
  const std::span<const formula::Expression> momenta =
      std::span(hamiltonian.variables()).subspan(hamiltonian.degrees_of_freedom());
  if (composition.of_quadratic_kinetic_energy && !is_quadratic(halves.T, momenta)) {
    throw std::invalid_argument(
        fmt::format("the composition {} is of order {} where T(p) is of degree two alone, and T = {} is not: use {}",
                    composition.name, composition.order, formula::to_string(halves.T),
                    composition_of_order(composition.order).name));
  }
  return std::make_unique<SplittingScheme>(hamiltonian, halves, composition, z_0);
}

}  // namespace rubato
