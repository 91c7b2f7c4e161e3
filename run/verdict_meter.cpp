#include <rubato/run/verdict_meter.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <rubato/grids/slab.hpp>

namespace rubato {

namespace {

/// The first so many levels are in the sample, and at least half as many of k, ..., 2k. Doubled, the sample is twice as
/// large. A large lattice has so few that what they take stays below that of the steps.
constexpr std::size_t lattice_density = 16, large_density = 2;
constexpr double large_lattice = 1 << 17;  // nodes

/// Likewise of an orbit with so many coordinates and momenta. A level of the sample takes as long as several steps,
/// which in a short run of a large system would be most of its time.
std::size_t orbit_density(std::size_t dimension) {
  constexpr std::size_t least = 4, most = 128, numbers_in_all = 1 << 14;
  return std::clamp(numbers_in_all / dimension, least, most);
}

std::size_t density_of(const Problem& problem) {
  const MultisymplecticProblem* const lattice = problem.multisymplectic();
  if (lattice == nullptr) {
    return orbit_density(problem.hamiltonian()->names().size());
  }
  return lattice->nodes() > large_lattice ? large_density : lattice_density;
}

/// Of a scheme of this order: its phase error is a tenth of the turn or so.
double fewest_steps_per_turn(int order) {
  return order <= 2 ? 4.0 : order <= 4 ? 2.5 : 2.0;
}

}  // namespace

double accepted_reasons(const Problem& problem) {
  double accepted = 0.0;
  for (const figures::ReasonKind kind : problem.accepted) {
    accepted += std::exp2(static_cast<double>(kind));
  }
  return accepted;
}

VerdictMeter::VerdictMeter(const Problem& problem)
    : dense_(density_of(problem)), stored_(std::numeric_limits<std::size_t>::max()), poles_(problem) {
  const auto stored = static_cast<std::size_t>(problem.output.states_every());
  if (problem.hamiltonian() == nullptr && stored >= lattice_density) {
    stored_ = stored;
  }
  measures_.accepted = accepted_reasons(problem);
  measures_.pure_law = problem.scheme.potential.kind == StepPotentialChoice::Kind::none ? 1.0 : 0.0;
}

bool VerdictMeter::samples(std::size_t number) const {
  const std::size_t distance = std::bit_floor(std::max<std::size_t>(1, number / dense_ * 2));
  return number % distance == 0 || number % stored_ == 0;
}

void VerdictMeter::add_level(Simulation& simulation, std::size_t number, double node_energy, double rounding) {
  if (number > 0 && poles_.looks() && std::isnan(measures_.pole_t)) {
    if (const OutputStep step = simulation.last(); poles_.crosses(step.z_0, step.z_1)) {
      measures_.pole_t = step.end();
    }
  }
  if (samples(number)) {
    take(simulation, number, node_energy, rounding);
  }
}

void VerdictMeter::take(Simulation& simulation, std::size_t number, double node_energy, double rounding) {
  if (grids::Slab::present() != nullptr) {
    return;
  }
  // A discrete Lagrangian that names t has a balance (3.4); the stated H need not be its energy, which is not
  // conserved.
  if (simulation.autonomous()) {
    energy_.add(simulation.energy_term_values(), node_energy, rounding, simulation.clock(),
                static_cast<double>(number));
  }
  measures_.turn_least = fewest_steps_per_turn(simulation.order());
  simulation.measure(number, measures_);
}

figures::Measures VerdictMeter::measures() const {
  figures::Measures measures = measures_;
  energy_.measure(measures);
  return measures;
}

figures::Measures VerdictMeter::measures_to(Simulation& simulation, std::size_t number) const {
  if (samples(number)) {
    return measures();
  }
  VerdictMeter meter = *this;
  meter.take(simulation, number, simulation.node().energy, number == 0 ? 0.0 : simulation.energy_rounding());
  return meter.measures();
}

void VerdictMeter::set_halved(double relative, double t) {
  measures_.halved = relative;
  measures_.halved_t = t;
}

void VerdictMeter::end_early(double t, double until) {
  measures_.end = t;
  measures_.end_wanted = until;
}

void VerdictMeter::save(StateWriter& state) const {
  figures::Measures::visit(measures_, [&state](double value) { state.write(value); });
  energy_.save(state);
}

void VerdictMeter::restore(StateReader& state) {
  figures::Measures::visit(measures_, [&state](double& value) { state.read(value); });
  energy_.restore(state);
  measures_.end = measures_.end_wanted = figures::Measures::none;
}

}  // namespace rubato
