#include <rubato/ode/splitting_scheme.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/formula/machine_code.hpp>
#include <rubato/ode/constrained_splitting.hpp>
#include <rubato/ode/node_law.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/ode/splitting_passes.hpp>
#include <rubato/ode/splitting_tangent.hpp>
#include <rubato/ode/state_kernels.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

/// Many coordinates with the same forces: one pass after the other, in vectors, is quicker than a long formula.
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
  std::vector<formula::Expression> outputs = step->there.all();
  outputs.push_back(step->energy);
  return formula::ScalarEvaluator(formula::Bytecode(outputs, step->inputs()));
}

class SplittingScheme final : public OneStepScheme {
public:
  SplittingScheme(const Hamiltonian& hamiltonian, const SplittingHalf& T, const SplittingHalf& V,
                  const Composition& composition, std::span<const double> z_0)
      : composition_(composition),
        evaluator_(hamiltonian),
        law_(hamiltonian, composition.gamma),
        energy_size_(hamiltonian.size_code()),
        n_(hamiltonian.degrees_of_freedom()),
        graph_(hamiltonian.graph()),
        T_(T),
        V_(V),
        whole_(whole_step(T, V, composition)) {
    std::array<std::span<double>, 2> rooms;
    if (whole_) {
      const std::size_t room = SplittingState::parts * n_ + 1;  // with h before a step, and E after it
      memory_.resize(2 * room);
      rooms = {std::span(memory_).first(room), std::span(memory_).last(room)};
    } else {
      passes_.emplace(T, V, composition);
      rooms = passes_->levels();
    }
    for (std::size_t i = 0; i < 2; ++i) {
      levels_[i].numbers = rooms[i];
      levels_[i].z = rooms[i].data() + n_;
    }
    point_.resize(2 * n_);
    errors_.resize(2 * n_);
    stand_at(z_0);
  }

  [[nodiscard]] std::size_t dimension() const override { return 2 * n_; }
  [[nodiscard]] std::span<const double> state() const override { return {here_->z, 2 * n_}; }
  [[nodiscard]] int order() const override { return composition_.order; }
  [[nodiscard]] bool has_node_law() const override { return composition_.has_node_law(); }

  [[nodiscard]] bool solves_fully() const override { return true; }
  [[nodiscard]] Status advance(double h, double) override {
    trial_h_ = h;
    ++iterations_;
    there_->energy.reset();
    there_->node.reset();
    energy_ = whole_ ? by_whole(h) : (*passes_)(h, here_->numbers.data(), there_->numbers.data());
    return std::isfinite(energy_) && all_finite(std::span(there_->z, 2 * n_)) ? Status::success : Status::undefined;
  }

  [[nodiscard]] Status tangent(std::span<double> columns) override {
    if (!tangent_) {
      tangent_.emplace(T_, V_, composition_);
    }
    return (*tangent_)({here_->z, 2 * n_}, trial_h_, columns);
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// From the node laws at both ends of the step, E - H = (s+1) h^s η + O(h^(s+1)) with signs that agree (theory,
  /// section 8): s (E - (H(z_k) + H(z_{k+1}))/2)/h (1 + O(h²)).
  [[nodiscard]] double discrete_energy_slope() const override {
    return order() * (energy_ - 0.5 * (energy_at(*here_) + energy_at(*there_))) / trial_h_;
  }
  [[nodiscard]] bool slope_costs_more() const override { return true; }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] double gamma_factor() const override { return law_.gamma_factor(); }
  [[nodiscard]] formula::SumSize energy_size() override {
    // After a step was taken its ends have changed places.
    middle_of_states(2 * n_, here_->z, there_->z, point_.data(), errors_.data());
    formula::SumSize size = energy_size_(point_, errors_);
    size.rounding *= magnitude_;
    return size;
  }
  [[nodiscard]] std::size_t energy_size_period() const override {
    return 2 * n_ <= tuning::small_state && !passes_ ? tuning::size_period : tuning::large_size_period;
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    std::swap(here_, there_);
    iterations_ = 0;
  }
  void restart(std::span<const double> z) override {
    stand_at(z);
    iterations_ = 0;
  }

  void save(StateWriter& state) const override {
    state.write(this->state());
    state.write(here_->numbers.first(n_));
    state.write(here_->numbers.subspan(3 * n_, n_));
  }
  void restore(StateReader& state) override {
    state.read(std::span(here_->z, 2 * n_));
    state.read(here_->numbers.first(n_));
    state.read(here_->numbers.subspan(3 * n_, n_));
    stand_here();
    iterations_ = 0;
  }

  [[nodiscard]] NodeEnergy node() override { return node_at(*here_); }

private:
  struct Level {
    std::span<double> numbers;                  ///< of a SplittingState, and what else a step needs
    double* z = nullptr;                        ///< among them, 2n
    mutable std::optional<double> energy = {};  ///< H, where it was asked for
    mutable std::optional<NodeEnergy> node = {};
  };

  [[nodiscard]] double energy_at(const Level& level) const {
    if (!level.energy) {
      level.energy = evaluator_.value(level.z);
    }
    return *level.energy;
  }
  /// Where nothing is known of Γ the energies are all there is to it.
  [[nodiscard]] NodeEnergy node_at(const Level& level) {
    if (!has_node_law()) {
      return {energy_at(level), std::numeric_limits<double>::quiet_NaN()};
    }
    if (!level.node) {
      level.node = law_(level.z);
    }
    return *level.node;
  }

  void stand_at(std::span<const double> z) {
    std::ranges::fill(here_->numbers, 0.0);
    std::ranges::copy(z, here_->z);
    stand_here();
  }
  /// No step is known, from where it may be.
  void stand_here() {
    if (passes_) {
      passes_->forget();
    }
    std::copy_n(here_->z, 2 * n_, there_->z);
    for (Level& level : levels_) {
      level.energy.reset();
      level.node.reset();
    }
  }

  double by_whole(double h) {
    here_->numbers.back() = h;
    (*whole_)(here_->numbers, there_->numbers);
    return there_->numbers.back();
  }

  const Composition& composition_;
  double magnitude_ = composition_.magnitude();
  mutable HamiltonianEvaluator evaluator_;
  NodeLaw law_;
  formula::SumSizeEvaluator energy_size_;
  std::size_t n_;
  std::shared_ptr<const formula::Graph> graph_;  ///< of the formulas of T and V
  SplittingHalf T_, V_;
  std::optional<formula::ScalarEvaluator> whole_;
  std::optional<SplittingPasses> passes_;    ///< in its place
  std::optional<SplittingTangent> tangent_;  ///< where it was asked for
  std::vector<double> memory_;               ///< of whole steps
  std::array<Level, 2> levels_;
  Level *here_ = &levels_[0], *there_ = &levels_[1];
  std::vector<double> point_, errors_;
  double trial_h_ = 0.0, energy_ = 0.0;
  int iterations_ = 0;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_splitting_scheme(const Hamiltonian& hamiltonian, const Composition& composition,
                                                     std::span<const double> z_0) {
  if (!hamiltonian.constraints().none()) {
    return make_constrained_splitting(hamiltonian, composition, z_0);
  }
  check_initial_state(hamiltonian, z_0);
  const Hamiltonian own = hamiltonian.with_own_graph();
  const Separation halves = separate(own);
  if (!halves.separable()) {
    throw std::invalid_argument(fmt::format(
        "a splitting needs H = T(p) + V(q); the term {} depends on coordinates and momenta: use lagrangian = \"gauss\"",
        halves.mixed));
  }
  const std::span variables(own.variables());
  const std::size_t n = own.degrees_of_freedom();
  if (composition.of_quadratic_kinetic_energy && !is_quadratic(halves.T, variables.subspan(n))) {
    throw std::invalid_argument(
        fmt::format("the composition {} is of order {} where T(p) is of degree two alone, and T = {} is not: use {}",
                    composition.name, composition.order, formula::to_string(halves.T),
                    composition_of_order(composition.order).name));
  }
  return std::make_unique<SplittingScheme>(own, SplittingHalf(halves.T, variables.subspan(n)),
                                           SplittingHalf(halves.V, variables.first(n)), composition, z_0);
}

}  // namespace rubato
