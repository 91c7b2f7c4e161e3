#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include <rubato/ode/darboux.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/lagrangian.hpp>
#include <rubato/ode/node_law.hpp>
#include <rubato/ode/segment_scheme.hpp>
#include <rubato/variation/crossing.hpp>
#include <rubato/variation/discrete_action.hpp>
#include <rubato/variation/time_levels.hpp>

namespace rubato {

/// The midpoint 𝕃 (3.15), the default: order 2.
struct Midpoint {};
/// The forward 𝕃 (3.23). Refused beyond `forward_step_limit` steps unless `allow_unstable` (theory, section 2.2).
struct Forward {
  bool allow_unstable = false;
};
/// Any 𝕃, as a formula in t_0, t_1 and every coordinate and momentum with suffix _0 and _1.
struct Custom {
  std::string L;
  Hamiltonian::Parameters parameters = {};
};
/// The generating function of the flow of normal Darboux type F, truncated (theory, section 4): any order.
struct Generating {
  int order = 4;  ///< as generating_order() understands it: with F = 0 an odd one rounds up
  /// F by its name, or as a symmetric 2n × 2n matrix.
  std::variant<DarbouxType, Eigen::MatrixXd> darboux = DarbouxType::midpoint;

  [[nodiscard]] Eigen::MatrixXd F(std::size_t degrees_of_freedom) const;
};
/// Gauss collocation (make_gauss_scheme): order 2m with m stages, for any H.
struct Gauss {
  int stages = 3;
};
/// An explicit splitting of H = T(p) + V(q) (make_splitting_scheme).
struct Splitting {
  std::string composition = "golden";  ///< see composition()
};
/// The trapezoidal rule for the action of L(q, q̇) (make_lagrangian_scheme): order 2, Lobatto with two points.
struct Trapezoid {};
/// The Lobatto rule with 2 to 9 points for the action of L(q, q̇) (make_lagrangian_scheme): order 2 points - 2.
struct Lobatto {
  int points = 3;
};
/// Of a problem stated by L(q, q̇), Midpoint, Gauss, Trapezoid and Lobatto are quadratures of its action; of one stated
/// by H the last two are not available.
using SegmentLagrangian = std::variant<Midpoint, Forward, Custom, Generating, Gauss, Splitting, Trapezoid, Lobatto>;

/// Whether its scheme is a one-step map that is told as such, by make_one_step_scheme(), and not as an action: then
/// there are no two-step form and no starting pair.
[[nodiscard]] bool is_map(const SegmentLagrangian& lagrangian);
/// Whether its scheme has a production form that is a one-step map: those of is_map(), and midpoint and generating.
[[nodiscard]] bool has_one_step_form(const SegmentLagrangian& lagrangian);
/// \throws std::invalid_argument as the scheme's own function, or if has_one_step_form() does not hold
[[nodiscard]] std::unique_ptr<OneStepScheme> make_one_step_scheme(const Hamiltonian& hamiltonian,
                                                                  const SegmentLagrangian& lagrangian,
                                                                  std::span<const double> z_0);

/// The same of a problem stated by L. \throws std::invalid_argument as make_lagrangian_scheme(), or if the 𝕃 is not a
/// quadrature of an action
[[nodiscard]] std::unique_ptr<OneStepScheme> make_one_step_scheme(const Lagrangian& lagrangian,
                                                                  const SegmentLagrangian& quadrature,
                                                                  std::span<const double> q,
                                                                  std::span<const double> q_dot);

/// The action A = (t_1 - t_0)·𝕃 of a segment. \throws formula::ParseError (Custom); std::invalid_argument if is_map()
[[nodiscard]] std::unique_ptr<DiscreteAction> make_action(const Hamiltonian& hamiltonian,
                                                          const SegmentLagrangian& lagrangian);

/// What the time levels of that 𝕃 read at a node. \throws std::invalid_argument as NodeLaw
[[nodiscard]] NodeLaw make_node_law(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian);

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
  std::optional<OnSingular> on_singular = std::nullopt;  ///< bridge; stated, it stands in place of the usual potential
  std::optional<BridgeRule> bridge = std::nullopt;       ///< anchored; likewise
  /// That makes levels exist everywhere. Usually chosen by a scout, but for forward and custom 𝕃: none there.
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

/// What the account of a failure has to know of a scheme.
struct SchemeTraits {
  int order = 2;
  std::string_view bridged = {};  ///< what to use in its place where it has no bridges; as an option of [scheme]
};

/// Steps an orbit, level by level. integrate() is the loop over it.
class OrbitIntegrator {
public:
  /// \throws std::invalid_argument with the offending values: sizes that do not fit, data that are not finite, what
  /// check_run_span() refuses (`step` or `until` left out, too), max_steps = 0, H undefined at the start;
  /// EquilibriumError, UnstableError, StartingPairError
  OrbitIntegrator(const Hamiltonian& hamiltonian, const InitialState& initial, const IntegrationOptions& options);
  /// The same for a problem stated by L(q, q̇). \throws SingularLagrangianError, too
  OrbitIntegrator(const Lagrangian& lagrangian, const InitialMotion& initial, const IntegrationOptions& options);

  [[nodiscard]] StepReport step() { return levels_->step(); }
  /// Whether the present level is at or past `until` (a level within 1e-9 of a step of it counts as at it).
  [[nodiscard]] bool finished() const;

  [[nodiscard]] double t() const { return levels_->time(); }
  [[nodiscard]] std::span<const double> q() const { return scheme_->state().first(scheme_->dimension() / 2); }
  [[nodiscard]] std::span<const double> p() const { return scheme_->state().last(scheme_->dimension() / 2); }
  /// q̇ of a problem that is stated by L; empty for others.
  [[nodiscard]] std::span<const double> q_dot() { return scheme_->velocities(); }
  [[nodiscard]] LevelNode node();  ///< H(z_k) and Γ(z_k); Γ is NaN where the scheme has none
  /// The same of H without the constant that was added to it.
  [[nodiscard]] LevelNode bare_node() { return scheme_->node(); }
  [[nodiscard]] bool has_gamma() const { return scheme_->has_gamma(); }
  [[nodiscard]] SchemeTraits traits() const;
  [[nodiscard]] const TimeLevels& levels() const { return *levels_; }
  /// Whether E_k is one constant for the run; if not (𝕃 depends on t), energy_balance() is what (3.4) leaves.
  [[nodiscard]] bool autonomous() const { return !scheme_->energy_target().has_value(); }
  [[nodiscard]] const SegmentScheme& scheme() const { return *scheme_; }
  /// What these options do badly although they can, with a remedy: sentences for people (theory, section 4). The step
  /// law of the Euler types changes sign at every turning point; the parasite of an arbitrary pair may grow.
  [[nodiscard]] std::vector<std::string> cautions() const;
  /// After Status::undefined: what of the formula was not defined, where that is known.
  [[nodiscard]] std::string failure_reason() const { return scheme_->failure_reason(); }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  void begin(double t, double energy_constant, bool at_equilibrium);

  IntegrationOptions options_;
  double node_constant_;                   ///< what was added to H
  std::string_view bridged_ = {};          ///< SchemeTraits::bridged
  std::unique_ptr<SegmentScheme> scheme_;  ///< of H without it
  std::unique_ptr<TimeLevels> levels_;
};

/// The crossings of an event, in the order of the run.
struct EventCrossings {
  std::string name;
  std::vector<double> t;
  std::vector<double> q, p;  ///< n entries each
  std::vector<Direction> direction;
  std::size_t undefined = 0;  ///< steps in which g was not a number somewhere: their crossings are not known
  std::size_t jumps = 0;      ///< jumps through zero, which are no crossings
  bool stopped = false;       ///< whether it ended the integration
};

/// An orbit in memory: level k at t[k] with q[k·n …], p[k·n …]; step k from level k to k+1.
struct Orbit {
  std::size_t degrees_of_freedom = 0;
  std::vector<double> t, gamma, node_energy;  ///< per level
  std::vector<double> q, p;                   ///< per level, n entries each
  std::vector<double> q_dot;                  ///< the same, of a problem that is stated by L
  std::vector<double> h, energy, condition;   ///< per step
  std::vector<EventCrossings> events;         ///< in the order of the options
  std::vector<unsigned char> bridged;         ///< per step
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
  /// max_k |E_k - E| / max(|E|, max |H|), over the steps that are not bridges; E is that of the first of them.
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

/// One sentence on why a step failed at time t, with the values that matter and what to do, given what the run does
/// already where Γ vanishes. `reason`: what of the formula was not defined, where that is known.
[[nodiscard]] std::string describe_failure(const StepReport& report, double t, const LevelNode& node, double last_step,
                                           OnSingular on_singular, std::string_view reason = {},
                                           const SchemeTraits& scheme = {});

/// What is told in place of Γ where the slopes of steps are all that is known: "-(4/h) dE/dh" for order 2, and for
/// order s -24/(s(s+1) h^(s-1)) dE/dh, which is -24 η to leading order (theory, section 8).
[[nodiscard]] std::string slope_name(int order);

}  // namespace rubato
