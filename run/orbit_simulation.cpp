#include <algorithm>
#include <cmath>

#include <rubato/ode/integrate.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/simulation.hpp>

namespace rubato {

namespace {

class OrbitSimulation final : public Simulation {
public:
  explicit OrbitSimulation(const Problem& problem)
      : orbit_(*problem.hamiltonian()),
        integrator_(make_integrator(problem)),
        invariants_(problem, orbit_.invariants, orbit_.formula_names()),
        exact_(problem, orbit_.exact, {"t"}) {
    const std::vector<std::string> names = orbit_.formula_names();
    for (const NamedFormula& formula : orbit_.exact) {
      exact_index_.push_back(static_cast<std::size_t>(std::ranges::find(names, formula.name) - names.begin()));
    }
    const auto z = integrator_.scheme().state();
    previous_.assign(z.begin(), z.end());
    previous_t_ = integrator_.t();
  }

  [[nodiscard]] StepReport step() override {
    const auto z = integrator_.scheme().state();
    before_.assign(z.begin(), z.end());
    const double before_t = integrator_.t();
    const StepReport report = integrator_.step();
    if (report.status == Status::success) {
      previous_.swap(before_);
      previous_t_ = before_t;
    }
    return report;
  }
  [[nodiscard]] Integrator& integrator() override { return integrator_; }
  [[nodiscard]] const Integrator& integrator() const override { return integrator_; }

  [[nodiscard]] std::vector<std::string> invariant_names() const override { return invariants_.names(); }
  [[nodiscard]] std::span<const double> invariants() override { return invariants_(formula_inputs()); }

  [[nodiscard]] std::vector<Named<Spread>> errors() override {
    const double now = t();
    const std::span<const double> exact = exact_({&now, 1});
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

  void append_state(RowSink& sink) override {
    sink.append(columns_.q, integrator_.q());
    sink.append(columns_.p, integrator_.p());
    if (orbit_.L) {
      sink.append(q_dot_, integrator_.q_dot());
    }
    if (previous_columns_) {
      const std::size_t n = previous_.size() / 2;
      sink.append(previous_t_column_, previous_t_);
      sink.append(previous_columns_->q, std::span<const double>(previous_).first(n));
      sink.append(previous_columns_->p, std::span<const double>(previous_).last(n));
    }
    const double now = t();
    const std::span<const double> exact = exact_({&now, 1});
    for (std::size_t i = 0; i < exact.size(); ++i) {
      sink.append(exact_columns_[i], exact[i]);
    }
  }

  [[nodiscard]] OutputStep last() const override {
    return {.z_0 = previous_, .z_1 = integrator_.scheme().state(), .t_0 = previous_t_, .t_1 = t(), .h = last_step()};
  }

  void save(StateWriter& state) const override {
    integrator_.save(state);
    state.write(previous_t_);
    for (const double value : previous_) {
      state.write(value);
    }
  }
  void restore(StateReader& state) override {
    integrator_.restore(state);
    state.read(previous_t_);
    for (double& value : previous_) {
      state.read(value);
    }
  }

private:
  struct PhaseColumns {
    record::Column q, p;
  };
  /// At the present level: what HamiltonianProblem::formula_names() names.
  [[nodiscard]] std::span<const double> formula_inputs() {
    if (!orbit_.L) {
      return integrator_.scheme().state();
    }
    inputs_.clear();
    for (const std::span<const double> part : {integrator_.q(), integrator_.q_dot(), integrator_.p()}) {
      inputs_.insert(inputs_.end(), part.begin(), part.end());
    }
    return inputs_;
  }

  const HamiltonianProblem& orbit_;
  OrbitIntegrator integrator_;
  FormulaTable invariants_, exact_;
  std::vector<std::size_t> exact_index_;
  std::vector<double> inputs_;
  std::vector<double> previous_, before_;  ///< the level before this one; what it is while a step is tried
  double previous_t_ = 0.0;
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
