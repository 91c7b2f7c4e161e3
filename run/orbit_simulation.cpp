#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include <rubato/ode/custom_consistency.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/problem/energy_terms.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/exact_measures.hpp>
#include <rubato/run/local_frequency.hpp>
#include <rubato/run/orbit_levels.hpp>
#include <rubato/run/simulation.hpp>

namespace rubato {

namespace {

class OrbitSimulation final : public Simulation {
public:
  explicit OrbitSimulation(const Problem& problem)
      : orbit_(*problem.hamiltonian()),
        clock_(problem.clock()),
        integrator_(make_integrator(problem)),
        invariants_(problem, orbit_.invariants, orbit_.formula_names()),
        exact_(problem, orbit_.exact, {"t"}),
        energy_terms_(make_energy_terms(problem)),
        frequency_(problem),
        momentum_maps_(problem, momentum_maps_of(orbit_), orbit_.names()),
        constraints_(make_constraint_table(problem)) {
    if (problem.scheme.lagrangian == LagrangianName::custom) {
      constexpr double some_steps = 1e-3;
      const double step = problem.scheme.step.value_or(some_steps * (problem.scheme.until - problem.start()));
      off_motion_ =
          off_motion(make_hamiltonian(problem), std::get<Custom>(make_integration_options(problem).lagrangian),
                     integrator_.scheme().state(), integrator_.t(), step);
    }
    for (const std::string& name : momentum_maps_.names()) {
      laws_.emplace_back(name);
    }
    for (const std::string& name : constraint_laws(orbit_)) {
      laws_.emplace_back(name);
    }
    const std::vector<std::string> names = orbit_.formula_names();
    for (const NamedFormula& formula : orbit_.exact) {
      exact_index_.push_back(static_cast<std::size_t>(std::ranges::find(names, formula.name) - names.begin()));
    }
    step_by(integrator_);
    const std::size_t size = integrator_.scheme().state().size();
    levels_kept_ = std::clamp<std::size_t>(most_numbers / size, 1, most_levels);
    levels_.resize(levels_kept_ + 2);
    for (Level& level : levels_) {
      level.z.resize(size);
    }
    keep(levels_[0]);
    keep(levels_[1]);
  }

  [[nodiscard]] std::size_t levels_kept() const override { return levels_kept_; }
  void look_at(std::size_t place) override { at_ = place + 2; }

  [[nodiscard]] std::vector<std::string> invariant_names() const override { return invariants_.names(); }
  [[nodiscard]] std::span<const double> invariants() override { return invariants_(formula_inputs()); }

  [[nodiscard]] std::span<const double> energy_term_values() override { return energy_terms_(formula_inputs()); }

  /// How far each momentum map changes in the step: rounding errors where the discrete action has its symmetry. And the
  /// constraints at its end.
  [[nodiscard]] std::span<Law> laws() override {
    const std::size_t maps = momentum_maps_.names().size();
    if (maps > 0) {
      const std::span<const double> before = momentum_maps_(levels_[at_ - 1].z);
      changes_.assign(before.begin(), before.end());
      const std::span<const double> now = momentum_maps_(level().z);
      for (std::size_t i = 0; i < maps; ++i) {
        laws_[i].set(magnitude(now[i] - changes_[i]));
      }
    }
    if (maps < laws_.size()) {
      const std::span<const double> values = constraints_(formula_inputs());
      for (std::size_t i = 0; i < values.size(); ++i) {
        laws_[maps + i].set(magnitude(values[i]));
      }
    }
    return laws_;
  }
  [[nodiscard]] std::span<const Law> laws() const override { return laws_; }

  void measure(std::size_t number, figures::Measures& measures) override {
    if (number == 0) {
      measures.action = off_motion_;
    }
    if (number < 2 && !exact_.names().empty()) {
      measure_exact(number == 0, measures);
    }
    const double h = level().h;
    const double turn = 2.0 * std::numbers::pi / (frequency_(level().z, h) * std::abs(h));
    if (std::isfinite(turn) && !(turn >= measures.turn)) {
      measures.turn = turn;
      measures.turn_t = clock();
    }
  }

  [[nodiscard]] std::vector<Named<Spread>> errors() override {
    const std::span<const double> exact = exact_({&level().t, 1});
    const std::span<const double> inputs = formula_inputs();
    std::vector<Named<Spread>> errors;
    for (std::size_t i = 0; i < exact.size(); ++i) {
      errors.push_back({exact_.names()[i], {}});
      errors.back().value.add(std::abs(inputs[exact_index_[i]] - exact[i]));
    }
    return errors;
  }

  void describe_states(record::Layout& layout, bool with_previous) override {
    layout.scales.push_back({"/states/coordinate", orbit_.q, "names of the coordinates"});
    layout.scales.push_back({"/states/momentum", orbit_.p, "names of the momenta"});
    if (orbit_.L) {
      layout.scales.push_back({"/states/velocity", orbit_.q_dot, "names of the velocities"});
    }
    const auto describe = [&](const std::string& group, const std::string& axis, const std::string& which) {
      const record::Column q =
          layout.add({group + "/q", axis, {"/states/coordinate"}, record::Type::f64, "coordinates " + which});
      return PhaseColumns{
          q, layout.add({group + "/p", axis, {"/states/momentum"}, record::Type::f64, "momenta " + which})};
    };
    columns_ = describe("/states", "/states/t", "at the stored levels");
    if (orbit_.L) {
      q_dot_ = layout.add({"/states/q_dot",
                           "/states/t",
                           {"/states/velocity"},
                           record::Type::f64,
                           "velocities at the stored levels, of q and p by the Legendre transform"});
    }
    if (with_previous) {
      const std::string before = "one level before each stored one (the first row repeats the start)";
      previous_t_column_ =
          layout.add({"/states/previous/t", "/states/previous/t", {}, record::Type::f64, "time " + before});
      previous_columns_ = describe("/states/previous", "/states/previous/t", before);
    }
    for (const std::string& name : exact_.names()) {
      exact_columns_.push_back(
          layout.add({"/exact/" + name, "/states/t", {}, record::Type::f64, "exact solution, from [exact]", true}));
    }
  }

  void append_states(RowSink& sink, std::size_t count, std::size_t stride) override {
    // of_level(level): one row
    const auto append = [&](record::Column column, std::size_t levels_before, const auto& of_level) {
      rows_.clear();
      for (std::size_t i = 0; i < count; ++i) {
        const std::span<const double> row = of_level(levels_[at_ + i * stride - levels_before]);
        rows_.insert(rows_.end(), row.begin(), row.end());
      }
      sink.append_rows(column, count, rows_);
    };
    const std::size_t n = level().z.size() / 2;
    const auto append_both = [&](const PhaseColumns& columns, std::size_t levels_before) {
      append(columns.q, levels_before, [n](const Level& level) { return std::span(level.z).first(n); });
      append(columns.p, levels_before, [n](const Level& level) { return std::span(level.z).last(n); });
    };
    append_both(columns_, 0);
    if (orbit_.L) {
      append(q_dot_, 0, [](const Level& level) { return std::span(level.q_dot); });
    }
    if (previous_columns_) {
      append(previous_t_column_, 1, [](const Level& level) { return std::span(&level.t, 1); });
      append_both(*previous_columns_, 1);
    }
    for (std::size_t i = 0; i < exact_columns_.size(); ++i) {
      append(exact_columns_[i], 0, [&](const Level& level) { return exact_({&level.t, 1}).subspan(i, 1); });
    }
  }

  [[nodiscard]] OutputStep last() const override {
    const Level& before = levels_[at_ - 1];
    return {.z_0 = before.z, .z_1 = level().z, .t_0 = before.t, .t_1 = level().t, .h = level().h, .clock = clock_};
  }

  void save(StateWriter& state) const override {
    integrator_.save(state);
    state.write(levels_[at_ - 1].t);
    state.write(levels_[at_ - 1].z);
  }
  void restore(StateReader& state) override {
    integrator_.restore(state);
    state.read(levels_[0].t);
    state.read(std::span<double>(levels_[0].z));
    at_ = 1;
    keep(levels_[1]);
  }

protected:
  [[nodiscard]] StepReport step(std::size_t place) override {
    if (place == 0) {
      std::swap(levels_[0], levels_[at_ - 1]);
      std::swap(levels_[1], levels_[at_]);
      at_ = 1;
    }
    const StepReport report = integrator_.step();
    if (report.status == Status::success) {
      keep(levels_[++at_]);
    }
    return report;
  }

private:
  /// Numbers of the states of a block, and its steps at most: it stays in the cache.
  static constexpr std::size_t most_numbers = std::size_t{1} << 14, most_levels = 256;

  struct Level {
    double t = 0.0, h = 0.0;  ///< h: of the step to it
    std::vector<double> z, q_dot = {};
  };
  struct PhaseColumns {
    record::Column q, p;
  };
  [[nodiscard]] const Level& level() const { return levels_[at_]; }
  [[nodiscard]] static Spread magnitude(double value) {
    Spread spread;
    spread.add(std::abs(value));
    return spread;
  }
  /// The level where the integrator stands.
  void keep(Level& level) {
    level.t = integrator_.t();
    level.h = integrator_.levels().last_step();
    std::ranges::copy(integrator_.scheme().state(), level.z.begin());
    if (orbit_.L) {
      const std::span<const double> velocities = integrator_.q_dot();
      level.q_dot.assign(velocities.begin(), velocities.end());
    }
  }
  /// At the start, or after the first step.
  void measure_exact(bool is_start, figures::Measures& measures) {
    const auto values_at = [&](double time, std::span<const double> z) {
      std::vector<double> values;
      const std::size_t n = z.size() / 2;
      for (const std::size_t index : exact_index_) {
        // Velocities are not among the states.
        const std::size_t place = orbit_.L && index >= n ? index - n : index;
        const bool is_velocity = orbit_.L && index >= n && index < 2 * n;
        values.push_back(is_velocity ? figures::Measures::none : z[place]);
      }
      const std::span<const double> exact = exact_({&time, 1});
      return std::pair(values, std::vector<double>(exact.begin(), exact.end()));
    };
    const auto [now, exact] = values_at(level().t, level().z);
    const auto [before, exact_before] = values_at(levels_[at_ - 1].t, levels_[at_ - 1].z);
    constexpr double rounding = 1e-12;  // what is left of a 0
    double largest = 0.0;
    for (std::size_t i = 0; i < now.size(); ++i) {
      largest = std::max({largest, std::abs(now[i]), std::abs(exact[i])});
    }
    for (std::size_t i = 0; i < now.size(); ++i) {
      if (is_start) {
        const double size = std::max(std::abs(now[i]), std::abs(exact[i]));
        compare_exact(now[i], exact[i], std::max(size, rounding * largest), measures.exact_start);
      } else {
        compare_increments(now[i], before[i], exact[i], exact_before[i], measures.exact_residual);
      }
    }
  }

  /// What HamiltonianProblem::formula_names() names.
  [[nodiscard]] std::span<const double> formula_inputs() {
    const Level& level = this->level();
    if (!orbit_.L) {
      return level.z;
    }
    inputs_ = level.z;
    inputs_.insert(inputs_.begin() + static_cast<std::ptrdiff_t>(level.q_dot.size()), level.q_dot.begin(),
                   level.q_dot.end());
    return inputs_;
  }

  const HamiltonianProblem& orbit_;
  std::optional<std::size_t> clock_;  ///< Problem::clock()
  OrbitIntegrator integrator_;
  FormulaTable invariants_, exact_, energy_terms_;
  LocalFrequency frequency_;
  FormulaTable momentum_maps_, constraints_;
  std::vector<Law> laws_;                        ///< of each of them
  double off_motion_ = figures::Measures::none;  ///< Measures::action
  std::vector<double> changes_;
  std::vector<std::size_t> exact_index_;
  std::vector<double> inputs_, rows_;
  std::vector<Level> levels_;  ///< the two before a block, and those of its steps
  std::size_t levels_kept_ = 1;
  std::size_t at_ = 1;  ///< the level that is looked at
  PhaseColumns columns_;
  record::Column q_dot_, previous_t_column_;
  std::optional<PhaseColumns> previous_columns_;  ///< where states are stored with their predecessors
  std::vector<record::Column> exact_columns_;
};

}  // namespace

std::unique_ptr<Simulation> make_orbit_simulation(const Problem& problem) {
  return std::make_unique<OrbitSimulation>(problem);
}

}  // namespace rubato
