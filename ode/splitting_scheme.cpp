#include <rubato/ode/splitting_scheme.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/machine_code.hpp>
#include <rubato/ode/node_law.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_energies.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/ode/state_kernels.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

/// T or V with its gradient.
class Half {
public:
  explicit Half(const SplittingHalf& formula) : gradient_is_point_(is_point(formula)) {
    evaluate_ = formula::ScalarEvaluator(
        gradient_is_point_ ? formula::Bytecode(std::span(formula.outputs).first(1), formula.variables) : formula.code);
  }

  /// The value at x (n entries), whose gradient is in gradient() until the next call.
  double operator()(const double* x) {
    const double* const outputs = evaluate_.at(x);
    gradient_ = gradient_is_point_ ? x : outputs + 1;
    return outputs[0];
  }
  [[nodiscard]] const double* gradient() const { return gradient_; }

private:
  /// As of T = p²/2, of which nothing has to be copied.
  static bool is_point(const SplittingHalf& formula) {
    const std::span<const std::uint32_t> outputs = formula.code.outputs();
    for (std::uint32_t i = 0; i + 1 < outputs.size(); ++i) {
      if (outputs[i + 1] != i) {
        return false;
      }
    }
    return true;
  }

  bool gradient_is_point_;
  formula::ScalarEvaluator evaluate_;
  const double* gradient_ = nullptr;
};

/// Many coordinates with the same forces: one half after the other, in vectors, is quicker than a long formula.
bool goes_in_loops(const SplittingHalf& half) {
  const formula::MachineCode* const code = half.code.machine_code();
  return code != nullptr && code->in_loops();
}

/// A whole step, if it is one formula.
std::optional<formula::ScalarEvaluator> whole_step(const SplittingHalf& T, const SplittingHalf& V,
                                                   const Composition& composition) {
  const auto step = goes_in_loops(V) ? std::nullopt : splitting_formula(T, V, composition);
  if (!step) {
    return std::nullopt;
  }
  std::vector<formula::Expression> outputs = {step->energy};
  outputs.insert(outputs.end(), step->delta.begin(), step->delta.end());
  return formula::ScalarEvaluator(formula::Bytecode(outputs, step->inputs()));
}

class SplittingScheme final : public OneStepState<VectorXd> {
public:
  SplittingScheme(const Hamiltonian& hamiltonian, const SplittingHalf& T, const SplittingHalf& V,
                  const Composition& composition, std::span<const double> z_0)
      : OneStepState(hamiltonian, z_0),
        composition_(composition),
        law_(hamiltonian, composition.gamma),
        energy_size_(hamiltonian.size_code()),
        n_(static_cast<Index>(hamiltonian.degrees_of_freedom())),
        graph_(hamiltonian.graph()),
        T_half_(T),
        V_half_(V),
        T_(T),
        V_(V),
        whole_(whole_step(T, V, composition)),
        is_long_(is_long(T, V, composition)) {
    inputs_.setZero(4 * n_ + 1);
    point_.setZero(2 * n_);
    errors_.setZero(2 * n_);
    low_.setZero(2 * n_);
  }

  [[nodiscard]] int order() const override { return composition_.order; }
  [[nodiscard]] bool has_node_law() const override { return composition_.has_node_law(); }

  [[nodiscard]] bool is_explicit() const override { return true; }
  [[nodiscard]] Status advance(double h, double) override {
    trial_h_ = h;
    forget_trial();
    ++iterations_;
    energy_ = whole_ ? by_whole(h) : is_long_ ? by_states(h) : by_parts(h);
    const VectorXd& found = is_long_ ? trial_end() : delta_;
    const bool finite = whole_ ? found.allFinite() : all_finite(static_cast<std::size_t>(2 * n_), found.data());
    return std::isfinite(energy_) && finite ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_by_nodes(energy_, trial_h_); }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    if (is_long_) {
      delta_ = (trial_end() - z_.value()) + (low_ - z_.low());
    }
    z_.displaced(0.5, delta_, point_);
    errors_ = 2.0 * (point_.cwiseAbs() + delta_.cwiseAbs());
    formula::SumSize size = energy_size_(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
    size.rounding *= magnitude_;
    return size;
  }
  [[nodiscard]] double prepare_abreast() override {
    energy_size_.prepare();
    if (!abreast_) {
      abreast_.emplace(T_half_, V_half_, composition_);
    }
    return abreast_->price();
  }
  void energies_abreast(std::span<const double, abreast> h, std::span<double, abreast> energies) override {
    (*abreast_)(as_span(z_.value()), as_span(z_.low()), h, energies);
    ++iterations_;
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    if (is_long_) {
      take_with(low_);
    } else {
      take();
    }
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

  /// Where nothing is known of Γ the energies are all there is to it, and they are known.
  ///@{
  [[nodiscard]] NodeEnergy node() override {
    return has_node_law() ? OneStepState::node() : NodeEnergy{energy_here(), std::numeric_limits<double>::quiet_NaN()};
  }
  [[nodiscard]] NodeEnergy trial_node() override {
    return has_node_law() ? OneStepState::trial_node()
                          : NodeEnergy{energy_there(), std::numeric_limits<double>::quiet_NaN()};
  }
  ///@}

private:
  [[nodiscard]] NodeEnergy node_at(const VectorXd& z) override { return law_(z.data()); }

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
      move_state(static_cast<std::size_t>(n_), length, half.gradient(), z_.value().data() + moved,
                 z_.low().data() + moved, delta_.data() + moved, point_.data() + moved);
    }
    return energy;
  }
  ///@}

  /// z + δ, without δ: of long states four arrays fewer, and so what a step goes over again and again stays near.
  double by_states(double h) {
    VectorXd& end = trial_end();
    std::array<const double*, 2> high{z_.value().data(), z_.value().data() + n_};  // of q and of p, as they stand
    std::array<const double*, 2> low{z_.low().data(), z_.low().data() + n_};
    double energy = 0.0;
    for (const Composition::Part& part : composition_.parts) {
      Half& half = part.drift ? T_ : V_;
      const std::size_t moved = part.drift ? 0 : 1;
      const Index first = part.drift ? 0 : n_;
      energy += part.length * half(high[1 - moved]);
      displace_state(static_cast<std::size_t>(n_), part.drift ? part.length * h : -(part.length * h), half.gradient(),
                     high[moved], low[moved], end.data() + first, low_.data() + first);
      high[moved] = end.data() + first;
      low[moved] = low_.data() + first;
    }
    end_is_known();
    return energy;
  }

  const Composition& composition_;
  double magnitude_ = composition_.magnitude();
  NodeLaw law_;
  formula::SumSizeEvaluator energy_size_;
  Index n_;
  std::shared_ptr<const formula::Graph> graph_;  ///< of the formulas of T and V
  SplittingHalf T_half_, V_half_;
  Half T_, V_;
  std::optional<SplittingEnergies> abreast_;
  std::optional<formula::ScalarEvaluator> whole_;
  bool is_long_;
  VectorXd inputs_;  ///< of whole_
  VectorXd point_, errors_;
  VectorXd low_;  ///< of the trial level, where it is found without δ
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
  const std::span variables(hamiltonian.variables());
  const std::size_t n = hamiltonian.degrees_of_freedom();
  if (composition.of_quadratic_kinetic_energy && !is_quadratic(halves.T, variables.subspan(n))) {
    throw std::invalid_argument(
        fmt::format("the composition {} is of order {} where T(p) is of degree two alone, and T = {} is not: use {}",
                    composition.name, composition.order, formula::to_string(halves.T),
                    composition_of_order(composition.order).name));
  }
  return std::make_unique<SplittingScheme>(hamiltonian, SplittingHalf(halves.T, variables.subspan(n)),
                                           SplittingHalf(halves.V, variables.first(n)), composition, z_0);
}

}  // namespace rubato
