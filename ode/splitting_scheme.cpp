#include <rubato/ode/splitting_scheme.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/ode/increment.hpp>
#include <rubato/ode/separable.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

/// T or V with its gradient.
class Half {
public:
  Half(formula::Expression energy, std::span<const formula::Expression> variables) {
    std::vector<formula::Expression> outputs = {energy};
    const auto gradient = formula::gradient(energy, variables);
    outputs.insert(outputs.end(), gradient.begin(), gradient.end());
    evaluate_ = formula::ScalarEvaluator(formula::Bytecode(outputs, variables));
  }

  /// The value at x; to -= or += length·gradient.
  template <typename Point, typename Target>
  double operator()(const Point& x, double length, Target&& to) {
    const std::span<double> inputs = evaluate_.inputs();
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      inputs[i] = x[static_cast<Index>(i)];
    }
    evaluate_.run();
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      to[static_cast<Index>(i)] += length * evaluate_.output(1 + i);
    }
    return evaluate_.output(0);
  }

private:
  formula::ScalarEvaluator evaluate_;
};

class SplittingScheme final : public SegmentScheme {
public:
  SplittingScheme(const Hamiltonian& hamiltonian, const Separation& halves, const Composition& composition,
                  std::span<const double> z_0)
      : composition_(composition),
        evaluator_(hamiltonian),
        energy_size_(hamiltonian.size_code()),
        n_(static_cast<Index>(hamiltonian.degrees_of_freedom())),
        T_(halves.T, std::span(hamiltonian.variables()).subspan(hamiltonian.degrees_of_freedom())),
        V_(halves.V, std::span(hamiltonian.variables()).first(hamiltonian.degrees_of_freedom())),
        z_(VectorXd(Eigen::Map<const VectorXd>(z_0.data(), 2 * n_))),
        golden_(composition.name == "golden") {
    for (VectorXd* vector : {&delta_, &point_, &errors_}) {
      vector->setZero(2 * n_);
    }
  }

  [[nodiscard]] std::size_t dimension() const override { return static_cast<std::size_t>(2 * n_); }
  [[nodiscard]] std::span<const double> state() const override { return as_span(z_.value()); }
  [[nodiscard]] int order() const override { return composition_.order; }
  [[nodiscard]] bool has_node_law() const override { return golden_; }

  /// Explicit: `accuracy` has nothing to bear on.
  [[nodiscard]] Status advance(double h, double /*accuracy*/) override {
    trial_h_ = h;
    trial_node_.reset();
    end_energy_.reset();
    ++iterations_;
    delta_.setZero();
    double energy = 0.0;
    for (const Composition::Part& part : composition_.parts) {
      z_.displaced(1.0, delta_, point_);
      const double length = part.length * h;
      energy += part.length * (part.drift ? T_(point_.tail(n_), length, delta_.head(n_))
                                          : V_(point_.head(n_), -length, delta_.tail(n_)));
    }
    energy_ = energy;
    return std::isfinite(energy) && delta_.allFinite() ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override {
    if (!node_energy_) {
      node_energy_ = evaluator_.value(z_.value().data());
    }
    if (!end_energy_) {
      z_.displaced(1.0, delta_, end_);
      end_energy_ = evaluator_.value(end_.data());
    }
    return composition_.order * (energy_ - 0.5 * (*node_energy_ + *end_energy_)) / trial_h_;
  }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    z_.displaced(0.5, delta_, point_);
    errors_ = 2.0 * (point_.cwiseAbs() + delta_.cwiseAbs());
    return energy_size_(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  [[nodiscard]] LevelNode node() override {
    if (!node_) {
      node_ = node_at(z_.value());
    }
    return *node_;
  }
  [[nodiscard]] LevelNode trial_node() override {
    if (!trial_node_) {
      z_.displaced(1.0, delta_, point_);
      trial_node_ = node_at(point_);
    }
    return *trial_node_;
  }

  void accept() override {
    z_.add(delta_);
    node_ = std::exchange(trial_node_, std::nullopt);
    node_energy_ = std::exchange(end_energy_, std::nullopt);
    iterations_ = 0;
  }

  void save(StateWriter& state) const override { z_.save(state); }
  void restore(StateReader& state) override {
    z_.restore(state);
    node_.reset();
    trial_node_.reset();
    node_energy_.reset();
    end_energy_.reset();
    iterations_ = 0;
  }

private:
  LevelNode node_at(const VectorXd& z) {
    LevelNode node;
    if (golden_) {
      // E - H = 3 h² η and Γ := -24 η (theory, section 8): of (7 - 3√5)/16 h² fᵀH_zz f.
      node.gamma = -0.5 * (7.0 - 3.0 * std::sqrt(5.0)) * evaluator_.gamma(z.data(), node.energy);
    } else {
      node = {evaluator_.value(z.data()), std::numeric_limits<double>::quiet_NaN()};
    }
    return node;
  }

  const Composition& composition_;
  mutable HamiltonianEvaluator evaluator_;
  formula::SumSizeEvaluator energy_size_;
  Index n_;
  Half T_, V_;
  CompensatedState<VectorXd> z_;
  bool golden_;
  VectorXd delta_, point_, errors_;
  mutable VectorXd end_;
  double trial_h_ = 0.0, energy_ = 0.0;
  int iterations_ = 0;
  std::optional<LevelNode> node_, trial_node_;  ///< where already asked for
  mutable std::optional<double> node_energy_, end_energy_;
};

}  // namespace

std::unique_ptr<SegmentScheme> make_splitting_scheme(const Hamiltonian& hamiltonian, const Composition& composition,
                                                     std::span<const double> z_0) {
  check_initial_state(hamiltonian, z_0);
  const Separation halves = separate(hamiltonian);
  if (!halves.separable()) {
    throw std::invalid_argument(fmt::format(
        "a splitting needs H = T(p) + V(q); the term {} depends on coordinates and momenta: use lagrangian = \"gauss\"",
        halves.mixed));
  }
  return std::make_unique<SplittingScheme>(hamiltonian, halves, composition, z_0);
}

}  // namespace rubato
