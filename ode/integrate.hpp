#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/ode/orbit_methods.hpp>
#include <rubato/variation/crossing.hpp>
#include <rubato/variation/integrator.hpp>

namespace rubato {

/// Steps after which a rounding error of the forward 𝕃 has typically swamped the orbit.
inline constexpr std::size_t forward_step_limit = 5;

struct InitialState {
  std::vector<double> q, p;
  double t = 0.0;
};

/// Where the motion of a Lagrangian starts.
struct InitialMotion {
  std::vector<double> q, q_dot;
  double t = 0.0;
};

/// What is looked for along an orbit: where a formula g passes zero. It is located between the levels, on the dense
/// output of the scheme (OrbitBetween), so that its time is off by what the orbit is off by; CrossingSearch says what
/// may be missed.
struct Event {
  std::string name;
  /// g, of coordinates, momenta and t; of a problem stated by L(q, q̇) of velocities too, momenta being called p_ and
  /// the coordinate.
  std::string crossing;
  Direction direction = Direction::both;
  /// The integration ends with the step that has this many crossings; 0: it does not.
  std::size_t stop_after = 0;
  Hamiltonian::Parameters parameters = {};
};

struct IntegrationOptions {
  SegmentLagrangian lagrangian = Midpoint{};
  double step = 0.0;  ///< t_1 - t_0; negative integrates backward; has to be given
  double until =
      0.0;  ///< the run ends at the first level at or past it; no step is shortened to hit it; has to be given
  Levels levels = Levels::variable;
  std::optional<OnSingular> on_singular = std::nullopt;  ///< plain; stated, it stands in place of the usual potential
  /// That makes levels exist everywhere. Usually chosen by a look-ahead, but for forward and custom 𝕃: none there.
  StepPotentialChoice potential = {.kind = StepPotentialChoice::Kind::usual};
  double tolerance = 1e-13;  ///< of the level equation, relative
  std::size_t max_steps = 100'000'000;
  /// A second node z_1 at its own t: the two-step form from an arbitrary pair, instead of a midpoint step for z_1.
  std::optional<InitialState> next = std::nullopt;
  std::vector<Event> events = {};
};

/// Initial data at which variable levels are meaningless: an equilibrium, where every h conserves the energy.
class EquilibriumError : public std::invalid_argument {
public:
  using std::invalid_argument::invalid_argument;
};

/// The forward 𝕃 asked to run as an initial-value method for more than a few steps.
class UnstableError : public std::invalid_argument {
public:
  using std::invalid_argument::invalid_argument;
};

/// Steps an orbit, level by level. integrate() is the loop over it.
class OrbitIntegrator final : public Integrator {
public:
  /// \throws std::invalid_argument with the offending values: sizes that do not fit, data that are not finite, what
  /// check_run_span() refuses (`step` or `until` left out, too), max_steps = 0, H undefined at the start;
  /// EquilibriumError, UnstableError, StartingPairError
  OrbitIntegrator(const Hamiltonian& hamiltonian, const InitialState& initial, const IntegrationOptions& options);
  /// The same for a problem stated by L(q, q̇). \throws SingularLagrangianError, too
  OrbitIntegrator(const Lagrangian& lagrangian, const InitialMotion& initial, const IntegrationOptions& options);

  [[nodiscard]] std::span<const double> q() const { return scheme_->state().first(scheme_->dimension() / 2); }
  [[nodiscard]] std::span<const double> p() const { return scheme_->state().last(scheme_->dimension() / 2); }
  /// q̇ of a problem that is stated by L; empty for others.
  [[nodiscard]] std::span<const double> q_dot() { return scheme_->velocities(); }
  [[nodiscard]] const SegmentScheme& scheme() const { return *scheme_; }
  /// What these options do badly although they can, with a remedy: sentences for people (theory, section 4). The step
  /// law of the Euler types changes sign at every turning point; the parasite of an arbitrary pair may grow.
  [[nodiscard]] std::vector<std::string> cautions() const override;

private:
  void begin_levels(double t, double energy_constant, double node_constant, bool at_equilibrium);

  IntegrationOptions options_;
  std::unique_ptr<SegmentScheme> scheme_;  ///< of H without its constant
};

/// The crossings of an event, in the order of the run.
struct EventCrossings {
  std::string name;
  std::vector<double> t = {};
  std::vector<double> q = {}, p = {};  ///< n entries each
  std::vector<Direction> direction = {};
  std::size_t undefined = 0;  ///< steps in which g was not a number somewhere: their crossings are not known
  std::size_t jumps = 0;      ///< jumps through zero, which are no crossings
  bool stopped = false;       ///< true if it ended the integration
};

/// An orbit in memory: level k at t[k] with q[k·n …], p[k·n …]; step k from level k to k+1.
struct Orbit {
  std::size_t degrees_of_freedom = 0;
  std::vector<double> t, gamma, node_energy;  ///< per level
  std::vector<double> q, p;                   ///< per level, n entries each
  std::vector<double> q_dot;                  ///< the same, of a problem that is stated by L
  std::vector<double> h, energy, condition;   ///< per step
  std::vector<EventCrossings> events;         ///< in the order of the options
  std::vector<unsigned char> off_law;         ///< per step: 1 where E_k is not E
  Status status = Status::success;            ///< why it ended: success at `until`
  std::string message;                        ///< for people, empty on success
  std::vector<std::string> cautions;          ///< OrbitIntegrator::cautions()

  [[nodiscard]] std::size_t steps() const { return h.size(); }
  [[nodiscard]] std::span<const double> q_at(std::size_t level) const {
    return {q.data() + level * degrees_of_freedom, degrees_of_freedom};
  }
  [[nodiscard]] std::span<const double> p_at(std::size_t level) const {
    return {p.data() + level * degrees_of_freedom, degrees_of_freedom};
  }
  /// max_k |E_k - E| / max(|E|, max |H|), over the steps on the law; E is that of the first of them.
  [[nodiscard]] double discrete_energy_deviation() const;
  /// max_k |H(z_k) - H(z_0)|
  [[nodiscard]] double node_energy_deviation() const;
};

/// Integrates from `initial` to `options.until`, or to the end of the step in which an event stops it. Ends early, with
/// all levels so far and the status, where a step fails. \throws as OrbitIntegrator; formula::ParseError of an event
[[nodiscard]] Orbit integrate(const Hamiltonian& hamiltonian, const InitialState& initial,
                              const IntegrationOptions& options);
[[nodiscard]] Orbit integrate(const Lagrangian& lagrangian, const InitialMotion& initial,
                              const IntegrationOptions& options);

/// The last level of one of many orbits, and how well the laws held on the way to it.
struct OrbitEnd {
  double t = 0.0;
  std::vector<double> q, p;  ///< n entries each
  std::size_t steps = 0;
  double discrete_energy = 0.0;            ///< E: that of the first step that meets the law
  double discrete_energy_deviation = 0.0;  ///< as Orbit shows them
  double node_energy_deviation = 0.0;
  std::vector<EventCrossings> events;
  Status status = Status::success;
  std::string message;
  bool interrupted = false;  ///< it goes to t alone; nothing is known of one without q
};

/// Integrates one H from many initial states with the same options, each with levels of its own: every orbit is the
/// same, bit for bit, as that of integrate() for it alone. On fixed levels with a splitting, and without events, they
/// go side by side in vectors (SplittingLanes), many times as fast; all others one after the other. They are shared out
/// to OpenMP's threads. Where the flag of this thread's Interruptible is set, they end where they are. \throws as
/// OrbitIntegrator, for the first of the states that cannot be started from
[[nodiscard]] std::vector<OrbitEnd> integrate(const Hamiltonian& hamiltonian, std::span<const InitialState> initial,
                                              const IntegrationOptions& options);

}  // namespace rubato
