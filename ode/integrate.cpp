#include <rubato/ode/integrate.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/base/spread.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/generating_action.hpp>
#include <rubato/ode/generating_scheme.hpp>
#include <rubato/ode/midpoint_scheme.hpp>
#include <rubato/ode/orbit_end.hpp>
#include <rubato/ode/orbit_events.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/ode/two_step_scheme.hpp>
#include <rubato/solve/spectrum.hpp>

namespace rubato {

namespace {

using namespace tuning::parasites;

std::vector<double> joined(const InitialState& state) {
  std::vector<double> z = state.q;
  z.insert(z.end(), state.p.begin(), state.p.end());
  return z;
}

void check_span(double start, const IntegrationOptions& options) {
  check_run_span(start, options.step, options.until, options.tolerance);
  if (options.max_steps == 0) {
    throw std::invalid_argument("max_steps = 0 allows no step: leave it out, or give a larger number");
  }
}

void check(const Hamiltonian& hamiltonian, const InitialState& initial, const IntegrationOptions& options) {
  const std::size_t n = hamiltonian.degrees_of_freedom();
  for (const InitialState* state : {&initial, options.next ? &*options.next : &initial}) {
    if (state->q.size() != n || state->p.size() != n) {
      throw std::invalid_argument(
          fmt::format("the initial state has {} coordinates and {} momenta; the Hamiltonian has {} of each",
                      state->q.size(), state->p.size(), n));
    }
    for (const auto* values : {&state->q, &state->p}) {
      for (const double value : *values) {
        if (!std::isfinite(value)) {
          throw std::invalid_argument(fmt::format("the initial state is not finite: q = ({}), p = ({})",
                                                  fmt::join(state->q, ", "), fmt::join(state->p, ", ")));
        }
      }
    }
  }
  check_span(initial.t, options);
  if (options.next && options.next->t - initial.t != options.step &&
      std::abs(options.next->t - initial.t - options.step) > 1e-12 * std::abs(options.step)) {
    throw std::invalid_argument(fmt::format("step = {} contradicts the starting pair, whose times differ by {}",
                                            options.step, options.next->t - initial.t));
  }
}

/// The second node of a starting pair: the user's, or one midpoint step.
SegmentNode second_node(const Hamiltonian& hamiltonian, const SegmentNode& first, const IntegrationOptions& options) {
  if (options.next) {
    return {options.next->t, joined(*options.next)};
  }
  const auto midpoint = make_midpoint_scheme(hamiltonian, first.z);
  if (const Status status = midpoint->advance(options.step, 0.0); status != Status::success) {
    throw std::invalid_argument(
        fmt::format("no midpoint step of length {} can be made from the initial state ({}): try a smaller step",
                    options.step, to_string(status)));
  }
  midpoint->accept();
  const auto z = midpoint->state();
  return {first.t + options.step, {z.begin(), z.end()}};
}

/// \throws std::invalid_argument if the forward 𝕃 is asked to run as an initial-value method
void check_stability(const InitialState& initial, const IntegrationOptions& options) {
  const auto* forward = std::get_if<Forward>(&options.lagrangian);
  const double steps = std::ceil((options.until - initial.t) / options.step - 1e-9);
  if (forward != nullptr && !forward->allow_unstable && steps > static_cast<double>(forward_step_limit)) {
    throw UnstableError(fmt::format(
        "lagrangian = \"forward\" is violently unstable as an initial-value method: on an oscillator of frequency w it "
        "multiplies a rounding error by about 16/(h w)^2 in every step (theory, section 2.2), and this run asks for {} "
        "steps; it is meant for boundary-value problems. Use lagrangian = \"midpoint\", at most {} steps, or "
        "allow_unstable = true",
        steps, forward_step_limit));
  }
}

/// A scheme for H, or 𝕃, without the constant that was added to it, and what that adds to the discrete energy.
struct ReducedScheme {
  std::unique_ptr<SegmentScheme> scheme;
  double energy_constant = 0.0;
};

/// The midpoint 𝕃 has a one-step production form, and some are nothing else; every other one, and an arbitrary starting
/// pair, is two-step.
ReducedScheme make_scheme(const Hamiltonian& whole, const InitialState& initial, const IntegrationOptions& options) {
  require_constrained(whole, options.lagrangian);
  const Hamiltonian& hamiltonian = whole.without_constant();
  const SegmentNode first{initial.t, joined(initial)};
  if (std::holds_alternative<Midpoint>(options.lagrangian) && !options.next) {
    return {make_midpoint_scheme(hamiltonian, first.z), whole.constant()};
  }
  if (method_of(options.lagrangian).is_map()) {
    if (options.next) {
      throw std::invalid_argument(
          "a starting pair is for two-step forms, and this scheme has none: leave out the second level");
    }
    return {make_one_step_scheme(hamiltonian, options.lagrangian, first.z), whole.constant()};
  }
  if (const auto* generating = std::get_if<Generating>(&options.lagrangian)) {
    const Eigen::MatrixXd F = generating->F(hamiltonian.degrees_of_freedom());
    if (!options.next) {
      return {make_generating_scheme(hamiltonian, F, generating->order, first.z), whole.constant()};
    }
    static_cast<void>(parasite_matrix(F));  // throws where no two-step map exists
  }
  const SegmentNode second = second_node(hamiltonian, first, options);
  if (const auto* custom = std::get_if<Custom>(&options.lagrangian)) {
    ReducedAction reduced = reduced_lagrangian_action(hamiltonian, custom->L, custom->parameters);
    return {make_two_step_scheme(std::make_unique<FormulaAction>(std::move(reduced.action)), hamiltonian, first, second,
                                 std::nullopt),
            -reduced.constant};
  }
  std::optional<NodeLaw> law;
  if (!std::holds_alternative<Forward>(options.lagrangian)) {
    law = make_node_law(hamiltonian, options.lagrangian);
  }
  return {
      make_two_step_scheme(make_action(hamiltonian, options.lagrangian), hamiltonian, first, second, std::move(law)),
      whole.constant()};
}

}  // namespace

OrbitIntegrator::OrbitIntegrator(const Hamiltonian& hamiltonian, const InitialState& initial,
                                 const IntegrationOptions& options)
    : options_(options) {
  check(hamiltonian, initial, options);
  check_stability(initial, options);
  auto [scheme, energy_constant] = make_scheme(hamiltonian, initial, options);
  scheme_ = std::move(scheme);
  HamiltonianEvaluator evaluator(hamiltonian.without_constant());
  std::vector<double> gradient(scheme_->dimension());
  evaluator.gradient(scheme_->state().data(), gradient.data());
  const bool at_rest = std::ranges::all_of(gradient, [](double x) { return x == 0.0; });
  begin_levels(initial.t, energy_constant, hamiltonian.constant(), at_rest);
}

OrbitIntegrator::OrbitIntegrator(const Lagrangian& lagrangian, const InitialMotion& initial,
                                 const IntegrationOptions& options)
    : options_(options) {
  check_span(initial.t, options);
  if (options.next) {
    throw std::invalid_argument(
        "a starting pair is for two-step forms, and this scheme has none: leave out the second level");
  }
  const Lagrangian& bare = lagrangian.without_constant();
  scheme_ = make_one_step_scheme(bare, options.lagrangian, initial.q, initial.q_dot);
  // At rest where no force acts.
  std::vector<double> at = initial.q, gradient(scheme_->dimension());
  at.insert(at.end(), initial.q_dot.begin(), initial.q_dot.end());
  LagrangianEvaluator(bare).gradient(at.data(), gradient.data());
  const auto zero = [](double x) { return x == 0.0; };
  const auto n = static_cast<std::ptrdiff_t>(initial.q.size());
  const bool at_rest =
      std::all_of(gradient.begin(), gradient.begin() + n, zero) && std::ranges::all_of(initial.q_dot, zero);
  begin_levels(initial.t, -lagrangian.constant(), -lagrangian.constant(), at_rest);
}

/// The levels of the scheme that is there.
void OrbitIntegrator::begin_levels(double t, double energy_constant, double node_constant, bool at_equilibrium) {
  LevelOptions levels = level_options(options_, method_of(options_.lagrangian).takes_potential, energy_constant);
  levels.run_length = std::abs(options_.until - t);
  if (at_equilibrium && levels.levels == Levels::variable && levels.potential.kind == StepPotentialChoice::Kind::none) {
    throw EquilibriumError(
        "the initial state is an equilibrium: the gradient of H vanishes there, so every step conserves the energy "
        "and no energy law can "
        "fix h; use levels = \"fixed\", or start elsewhere");
  }
  if (const double gamma = scheme_->node().gamma; scheme_->has_gamma() && !std::isfinite(gamma)) {
    throw std::invalid_argument(
        fmt::format("Gamma is {} at the initial state ({}): the derivatives of H that it is made of are not finite "
                    "there{}; start elsewhere",
                    gamma, fmt::join(scheme_->state(), ", "),
                    scheme_->failure_reason().empty() ? "" : fmt::format(" ({})", scheme_->failure_reason())));
  }
  begin(*scheme_, options_, levels, t, node_constant);
}

std::vector<std::string> OrbitIntegrator::cautions() const {
  const auto* const generating = std::get_if<Generating>(&options_.lagrangian);
  const auto* const named = generating != nullptr ? std::get_if<DarbouxType>(&generating->darboux) : nullptr;
  if (generating == nullptr || (named != nullptr && *named == DarbouxType::midpoint && !options_.next)) {
    return {};
  }
  const std::size_t n = scheme_->dimension() / 2;
  const Eigen::MatrixXd F = generating->F(n);
  const auto is_type = [&](DarbouxType type) { return F == darboux_symmetric(type, static_cast<Eigen::Index>(n)); };
  std::vector<std::string> cautions;
  if (options_.levels == Levels::variable && (is_type(DarbouxType::euler_a) || is_type(DarbouxType::euler_b))) {
    cautions.emplace_back(
        "with the symplectic-Euler types the step law changes sign at every turning point of the orbit, where no step "
        "keeps the energy: levels = \"fixed\" is the choice for them, or darboux = \"midpoint\"");
  }
  if (options_.next) {
    const double growth = solve::spectral_radius(parasite_matrix(F));
    if (growth > 1.0 + growth_tolerance) {
      cautions.push_back(
          fmt::format("with this darboux matrix the parasite of a starting pair grows by a factor of {:.3g} in every "
                      "step: leave out [initial.next], or take darboux = \"midpoint\" or a definite matrix",
                      growth));
    }
  }
  return cautions;
}

namespace {

/// How well the laws held, from the energies of steps and levels as they come.
class HeldLaws {
public:
  void add_level(double node_energy) {
    first_node_ = nodes_.count() == 0.0 ? node_energy : first_node_;
    nodes_.add(node_energy);
  }
  void add_step(double energy, bool off_law) {
    if (!off_law) {
      E_ = law_.count() == 0.0 ? energy : E_;
      law_.add(energy);
    }
  }

  [[nodiscard]] double energy() const { return E_; }
  [[nodiscard]] double discrete_energy_deviation() const {
    if (law_.undefined + nodes_.undefined > 0.0) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    const double deviation = law_.farthest(E_);
    return deviation == 0.0 ? 0.0 : deviation / std::max(std::abs(E_), nodes_.largest());
  }
  [[nodiscard]] double node_energy_deviation() const {
    return nodes_.undefined > 0.0 ? std::numeric_limits<double>::quiet_NaN() : nodes_.farthest(first_node_);
  }

private:
  Spread law_, nodes_;
  double E_ = 0.0, first_node_ = 0.0;
};

HeldLaws laws_of(const Orbit& orbit) {
  HeldLaws laws;
  for (const double value : orbit.node_energy) {
    laws.add_level(value);
  }
  for (std::size_t k = 0; k < orbit.energy.size(); ++k) {
    laws.add_step(orbit.energy[k], orbit.off_law[k] != 0);
  }
  return laws;
}

}  // namespace

double Orbit::discrete_energy_deviation() const {
  return laws_of(*this).discrete_energy_deviation();
}

double Orbit::node_energy_deviation() const {
  return laws_of(*this).node_energy_deviation();
}

namespace {

/// The events of the options, and what was found of them.
class EventLog {
public:
  EventLog(const IntegrationOptions& options, std::vector<std::string> names, std::unique_ptr<OrbitBetween> between,
           std::optional<Hamiltonian> rates, std::unique_ptr<OneStepScheme> velocities)
      : options_(options) {
    names.emplace_back("t");
    std::vector<formula::Expression> arguments;
    for (const std::string& name : names) {
      arguments.push_back(graph_.variable(name));
    }
    events_.emplace(std::move(*between), arguments, std::move(rates), std::move(velocities));
    for (const Event& event : options.events) {
      std::vector<std::string> known = names;
      for (const auto& [name, value] : event.parameters) {
        known.push_back(name);
      }
      const auto resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
        if (const auto found = std::ranges::find(names, name); found != names.end()) {
          return arguments[static_cast<std::size_t>(found - names.begin())];
        }
        const auto parameter = event.parameters.find(std::string(name));
        return parameter == event.parameters.end() ? std::nullopt : std::optional(graph_.constant(parameter->second));
      };
      events_->add(formula::parse(event.crossing, graph_, {.resolve = resolve, .known_names = known}), event.direction);
    }
  }

  void begin(std::span<const double> z, double t, Orbit& orbit) {
    events_->begin(z, t);
    before_.assign(z.begin(), z.end());
    for (const Event& event : options_.events) {
      orbit.events.push_back({.name = event.name});
    }
  }

  /// Whether the step ends the run.
  bool follow(std::span<const double> z, double t_0, double t_1, double h, Orbit& orbit) {
    const OrbitStep step{.z_0 = before_, .z_1 = z, .t_0 = t_0, .t_1 = t_1, .h = h};
    events_->follow(step);
    bool ends = false;
    for (std::size_t i = 0; i < options_.events.size(); ++i) {
      EventCrossings& found = orbit.events[i];
      for (const Crossing& crossing : events_->crossings(i)) {
        if (crossing.jump) {
          ++found.jumps;
          continue;
        }
        const std::span<const double> at = events_->state(step, crossing.fraction);
        const std::size_t n = at.size() / 2;
        found.t.push_back(step.time(crossing.fraction));
        found.q.insert(found.q.end(), at.begin(), at.begin() + static_cast<std::ptrdiff_t>(n));
        found.p.insert(found.p.end(), at.begin() + static_cast<std::ptrdiff_t>(n), at.end());
        found.direction.push_back(crossing.direction);
      }
      found.undefined += events_->undefined(i) ? 1 : 0;
      const std::size_t last = options_.events[i].stop_after;
      found.stopped = last > 0 && found.t.size() >= last;
      ends = ends || found.stopped;
    }
    before_.assign(z.begin(), z.end());
    return ends;
  }

private:
  const IntegrationOptions& options_;
  formula::Graph graph_;
  std::optional<OrbitEvents> events_;
  std::vector<double> before_;
};

std::unique_ptr<EventLog> make_log(const Hamiltonian& hamiltonian, const InitialState& initial,
                                   const IntegrationOptions& options) {
  if (options.events.empty()) {
    return nullptr;
  }
  std::vector<std::string> names = hamiltonian.q_names();
  std::ranges::copy(hamiltonian.p_names(), std::back_inserter(names));
  return std::make_unique<EventLog>(
      options, std::move(names),
      std::make_unique<OrbitBetween>(hamiltonian, options.lagrangian, options.next.has_value(), joined(initial)),
      hamiltonian.without_constant(), nullptr);
}

std::unique_ptr<EventLog> make_log(const Lagrangian& lagrangian, const InitialMotion& initial,
                                   const IntegrationOptions& options) {
  if (options.events.empty()) {
    return nullptr;
  }
  std::vector<std::string> names = lagrangian.q_names();
  std::ranges::copy(lagrangian.velocity_names(), std::back_inserter(names));
  for (const std::string& name : lagrangian.q_names()) {
    names.push_back("p_" + name);
  }
  const auto map = [&] {
    return make_one_step_scheme(lagrangian.without_constant(), options.lagrangian, initial.q, initial.q_dot);
  };
  return std::make_unique<EventLog>(options, std::move(names),
                                    std::make_unique<OrbitBetween>(map(), 2 * initial.q.size()), std::nullopt, map());
}

std::string steps_used_up(const IntegrationOptions& options, double t) {
  return fmt::format("max_steps = {} reached at t = {:.10g}", options.max_steps, t);
}

Orbit run(OrbitIntegrator integrator, std::unique_ptr<EventLog> events, const IntegrationOptions& options) {
  Orbit orbit;
  orbit.degrees_of_freedom = integrator.q().size();
  orbit.cautions = integrator.cautions();
  const auto record_level = [&] {
    orbit.t.push_back(integrator.t());
    const NodeEnergy node = integrator.node();
    orbit.gamma.push_back(node.gamma);
    orbit.node_energy.push_back(node.energy);
    orbit.q.insert(orbit.q.end(), integrator.q().begin(), integrator.q().end());
    orbit.p.insert(orbit.p.end(), integrator.p().begin(), integrator.p().end());
    const auto q_dot = integrator.q_dot();
    orbit.q_dot.insert(orbit.q_dot.end(), q_dot.begin(), q_dot.end());
  };
  record_level();
  bool stopped = false;
  if (events != nullptr) {
    events->begin(integrator.scheme().state(), integrator.t(), orbit);
  }
  while (!integrator.finished() && !stopped) {
    if (orbit.steps() == options.max_steps) {
      orbit.status = Status::not_converged;
      orbit.message = steps_used_up(options, integrator.t());
      break;
    }
    const StepReport report = integrator.step();
    if (report.status != Status::success) {
      orbit.status = report.status;
      orbit.message = integrator.explain(report);
      break;
    }
    orbit.h.push_back(report.h);
    orbit.energy.push_back(report.energy);
    orbit.condition.push_back(report.condition);
    orbit.off_law.push_back(report.off_law ? 1 : 0);
    record_level();
    if (events != nullptr) {
      stopped =
          events->follow(integrator.scheme().state(), orbit.t[orbit.t.size() - 2], integrator.t(), report.h, orbit);
    }
  }
  return orbit;
}

/// Of levels and steps no more than how well the laws held.
OrbitEnd run_to_end(OrbitIntegrator& integrator, EventLog* events, const IntegrationOptions& options) {
  OrbitEnd end;
  Orbit crossings;
  HeldLaws laws;
  laws.add_level(integrator.node().energy);
  bool stopped = false;
  if (events != nullptr) {
    events->begin(integrator.scheme().state(), integrator.t(), crossings);
  }
  while (!integrator.finished() && !stopped && !(end.interrupted = Interruptible::asked())) {
    if (end.steps == options.max_steps) {
      end.status = Status::not_converged;
      end.message = steps_used_up(options, integrator.t());
      break;
    }
    const double before = integrator.t();
    StepReport report;
    try {
      report = integrator.step();
    } catch (const Interrupted&) {  // in its look-ahead
      end.interrupted = true;
      break;
    }
    if (report.status != Status::success) {
      end.status = report.status;
      end.message = integrator.explain(report);
      break;
    }
    ++end.steps;
    laws.add_step(report.energy, report.off_law);
    laws.add_level(integrator.node().energy);
    if (events != nullptr) {
      stopped = events->follow(integrator.scheme().state(), before, integrator.t(), report.h, crossings);
    }
  }
  end.t = integrator.t();
  end.q.assign(integrator.q().begin(), integrator.q().end());
  end.p.assign(integrator.p().begin(), integrator.p().end());
  end.discrete_energy = laws.energy();
  end.discrete_energy_deviation = laws.discrete_energy_deviation();
  end.node_energy_deviation = laws.node_energy_deviation();
  end.events = std::move(crossings.events);
  return end;
}

}  // namespace

OrbitEnd integrate_to_end(const Hamiltonian& hamiltonian, const InitialState& initial,
                          const IntegrationOptions& options) {
  OrbitIntegrator integrator(hamiltonian, initial, options);
  const auto events = make_log(hamiltonian, initial, options);
  return run_to_end(integrator, events.get(), options);
}

Orbit integrate(const Hamiltonian& hamiltonian, const InitialState& initial, const IntegrationOptions& options) {
  OrbitIntegrator integrator(hamiltonian, initial, options);  // which looks at what it is given
  return run(std::move(integrator), make_log(hamiltonian, initial, options), options);
}

Orbit integrate(const Lagrangian& lagrangian, const InitialMotion& initial, const IntegrationOptions& options) {
  OrbitIntegrator integrator(lagrangian, initial, options);
  return run(std::move(integrator), make_log(lagrangian, initial, options), options);
}

}  // namespace rubato
