#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <optional>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/variation/level_scheme.hpp>
#include <rubato/variation/step_forecast.hpp>
#include <rubato/variation/step_potential.hpp>

namespace rubato {

/// How the levels t_k are chosen.
enum class Levels {
  variable,  ///< by the total variation: E_k = E together with the step, (3.3) and (3.4)
  fixed,     ///< t_k = start + k·step, (3.3) alone
};

/// What to do where the step equation has no solution (theory, section 3).
enum class OnSingular {
  bridge,  ///< cross it as theory, section 3.1 describes; `stop` for a scheme that has no node law
  fixed,   ///< plain steps of the last size until the energy law can be met again
  stop,    ///< end the run there
};

/// The amplitude c of the node law H - E = c·sign(Γ)|Γ|^(1/(s+1)) that a bridge leads to.
enum class BridgeRule {
  anchored,    ///< the run's own, set by its first step: what one bridge is off the next puts right, nothing drifts
  reversible,  ///< the one before the bridge: run backward, a bridge leads back to where it came from
};

struct LevelOptions {
  Levels levels = Levels::variable;
  OnSingular on_singular = OnSingular::bridge;
  BridgeRule bridge = BridgeRule::anchored;
  double tolerance = 1e-13;       ///< of the level equation, relative to energy_scale()
  double condition_limit = 1e-2;  ///< a step whose condition exceeds it is refused: its energy law is only rounding
  double energy_constant = 0.0;   ///< to be added to the scheme's energies in what is told of them
  StepPotentialChoice potential = {};
  /// |until - start|, as far as it is known: whether a scout is worth while
  /// (is_short_run, nearly_equal_steps); infinite if it is not.
  double run_length = std::numeric_limits<double>::infinity();
};

/// What one call of TimeLevels::step() did.
struct StepReport {
  Status status = Status::success;
  double h = 0.0;
  double energy = 0.0;     ///< E_k of the step, f'(h) included
  double potential = 0.0;  ///< f'(h), the step potential's part of it
  double target = 0.0;  ///< what E_k has to equal with variable levels: E, or the other side of the balance (3.4); NaN
                        ///< as long as no step has met the law, so that there is no E yet
  /// Total derivative dE/dh of the step; NaN with fixed levels where the scheme has it from node energies alone, which
  /// nobody asked for.
  double slope = 0.0;
  /// Step condition (|E_k - E| + δE) / |h dE/dh|, the relative error of h: by what is left of the level equation (on
  /// steps that meet it), and by δE, a bound of what rounding makes of E_k. For the midpoint 𝕃 |h dE/dh| = h²|Γ|/4. NaN
  /// with fixed levels, where h is what was asked for.
  double condition = 0.0;
  int iterations = 0;
  bool bridged = false;   ///< a plain step, taken where the energy law has no solution
  bool crossing = false;  ///< the first step of a bridge

  /// Evidence for why a step was flagged, or failed: Γ at both ends of a flagged step; of a failed one at the level
  /// before and at the level it failed from. Where the scheme does not know its Γ, or no level before is kept, what the
  /// slopes of the last two steps make of it, -24 dE/dh / (s(s+1) h^(s-1)). NaN where nothing is known.
  double gamma_before = std::numeric_limits<double>::quiet_NaN();
  double gamma_after = std::numeric_limits<double>::quiet_NaN();
  bool gamma_from_slope = false;
};

/// The choice of time levels, the same for orbits and lattices.
///
/// With variable levels each step solves E(h) = E for h by a safeguarded Newton iteration on the smooth scalar function
/// h ↦ E(h), the step solved inside (theory, section 3.2). E is that of the first step, for the whole run. The
/// predictor is the step law h^(s+1) Γ = const, extrapolated. A root is taken only where dE/dh has the sign it has
/// along the orbit: beyond the fold of E(h) lies the other branch, at h < 0 the reflected root, and both have the
/// opposite sign.
///
/// With a step potential f, E_k is K_h + f'(h) everywhere, K_h the scheme's: chosen before the first step, it makes the
/// level equation solvable where K_h alone has no solution, and there are no bridges. Where an orbit leaves what the
/// potential was chosen for, plain steps are taken, flagged, until the law can be met again; `stop` ends the run there.
///
/// A step that is not flagged as bridged meets E_k = E, to the tolerance or to what rounding in E_k leaves, whichever
/// is larger; the very numbers of its report are judged before it is taken. However large terms grow, as in a blow-up,
/// it is within a thousandth of those that E was set with. H has no preferred zero: what the tolerance is relative to,
/// and what rounding makes of E_k, are properties of the terms that E_k is the sum of (LevelScheme::energy_size), not
/// of its value.
class TimeLevels {
public:
  /// \param start t_0
  /// \param first_step t_1 - t_0, which fixes E; negative integrates backward
  TimeLevels(LevelScheme& scheme, const LevelOptions& options, double start, double first_step);

  /// One step; on success the scheme stands at the new level. Otherwise the scheme and the levels are as before.
  [[nodiscard]] StepReport step();

  [[nodiscard]] double time() const { return time_.value(); }
  [[nodiscard]] std::size_t steps() const { return steps_; }
  /// E, once a step has met the law; NaN before that.
  [[nodiscard]] double energy() const { return energy_ + options_.energy_constant; }
  /// The same without the constant that is added to energies.
  [[nodiscard]] double bare_energy() const { return energy_; }
  /// The largest size of E_k so far (LevelScheme::energy_size), added constants left out: what the tolerance is
  /// relative to.
  [[nodiscard]] double energy_scale() const { return energy_scale_; }
  /// A bound of what rounding makes of E_k, near the present level.
  [[nodiscard]] double energy_rounding() const { return rounding_; }
  [[nodiscard]] double law_constant() const {
    return law_constant_;
  }  ///< c of the node law H - E = c·sign(Γ)|Γ|^(1/(s+1))
  [[nodiscard]] double last_step() const { return last_step_; }
  /// The step potential of the run; none before the first step.
  [[nodiscard]] const StepPotential& potential() const { return potential_; }
  /// price_in_steps() of a potential that was chosen by a scout. It is told of a run that is restored, too, not by
  /// save(), whose layout records have.
  [[nodiscard]] std::optional<double> potential_price() const { return potential_price_; }
  void tell_potential_price(std::optional<double> price) { potential_price_ = price; }
  [[nodiscard]] const LevelOptions& options() const { return options_; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Sample {
    double time;
    double density;  ///< sign(Γ)|h|^-(s+1), proportional to Γ by the step law
  };

  StepReport fixed_step();
  StepReport first_step();
  StepReport variable_step();
  StepReport plain_step(double h);
  StepReport ordinary_step(double guess);
  StepReport report(Status status, double h);
  void take(StepReport& report);
  void take_ordinary(StepReport& report);
  void set_energy(const StepReport& report);
  [[nodiscard]] double solved_to() const;
  [[nodiscard]] double allowed_miss(const StepReport& step) const;
  [[nodiscard]] double gamma_of(const StepReport& step) const;
  void add_evidence(StepReport& failed);

  [[nodiscard]] Status solve_level(double guess);

  // potential_levels.cpp: levels with a step potential (theory, section 9).
  void choose_potential();
  [[nodiscard]] Status solve_with_potential(double guess);
  [[nodiscard]] double foreseen_slope_ratio();
  struct Root {
    double length, slope;  ///< of E_k, by |h|, to the side of the potential
  };
  [[nodiscard]] bool goes_abreast() const;
  [[nodiscard]] std::optional<Root> root_abreast(double foreseen);
  [[nodiscard]] StepReport resumed_with_potential();
  [[nodiscard]] StepReport plain_instead(const StepReport& failed);
  [[nodiscard]] double density_at(double time) const;
  [[nodiscard]] double predicted_step();
  [[nodiscard]] double law_step(double gamma) const;
  void set_direction(double gamma);
  void remember(double h, double slope);
  void measure(double h);

  // bridge.cpp: what happens where the step equation loses its solution (theory, section 3.1).
  /// `count` equal plain steps of length h, after which the ordinary step exists again.
  struct Bridge {
    double h = 0.0;
    int count = 0;
    NodeEnergy end = {};
    double miss = 0.0;     ///< relative, of the node law at the end
    double after = 0.0;    ///< length of the ordinary step that follows
    NodeEnergy next = {};  ///< at its end
    double slope = 0.0;    ///< of the law defect at `end`, by h
  };
  StepReport singular_step(const StepReport& ordinary);
  StepReport wait_step();
  [[nodiscard]] std::optional<StepReport> resumed_step(double misfit);
  StepReport waiting_step();
  StepReport long_bridge();
  StepReport start_bridge(const Bridge& bridge);
  StepReport bridge_step();
  StepReport flagged(StepReport report);
  [[nodiscard]] bool crossing_is_near(const StepReport& step);
  [[nodiscard]] bool bridge_now(const Bridge& bridge, const StepReport& ordinary, const NodeEnergy& next);
  [[nodiscard]] bool is_sooner(double bridge_and_step, double ordinary);
  [[nodiscard]] bool is_way_back(const Bridge& bridge);
  [[nodiscard]] bool is_bridged_before(const Bridge& bridge);
  [[nodiscard]] bool is_bridged_at_end(const Bridge& bridge);
  /// What `judge` says at the end of a step of length h, or `otherwise` if there is none; leaves all as it was.
  template <typename Judge>
  [[nodiscard]] bool seen_after(double h, bool otherwise, const Judge& judge);
  void measure_law(const NodeEnergy& node);
  [[nodiscard]] NodeEnergy law_node();
  [[nodiscard]] double law_power(double gamma) const;
  [[nodiscard]] double law_defect(const NodeEnergy& node) const;
  [[nodiscard]] double step_after(const Bridge& bridge) const;
  [[nodiscard]] double plain_length() const;
  [[nodiscard]] std::optional<NodeEnergy> plain_end(double h, int count, double accuracy);
  [[nodiscard]] std::optional<Bridge> find_bridge(int count, bool crossing);
  [[nodiscard]] std::optional<Bridge> refine_bridge(int count, double near_h, double near_defect, double far_h,
                                                    double far_defect);
  [[nodiscard]] bool law_holds_after(Bridge& bridge);
  void polish(Bridge& bridge);

  LevelScheme& scheme_;
  LevelOptions options_;
  double start_;
  double fixed_h_;
  CompensatedSum time_;
  std::size_t steps_ = 0;

  /// f' and f'' at a length, of which one step asks several times.
  [[nodiscard]] const StepPotential::Part& potential_at(double h) const {
    if (h != potential_length_) {
      potential_part_ = potential_.at(h);
      potential_length_ = h;
    }
    return potential_part_;
  }
  void set_potential(const StepPotential& potential) {
    potential_ = potential;
    potential_length_ = std::numeric_limits<double>::quiet_NaN();
  }

  StepPotential potential_;  ///< by set_potential()
  mutable StepPotential::Part potential_part_;
  mutable double potential_length_ = std::numeric_limits<double>::quiet_NaN();  ///< where that is
  std::optional<double> potential_price_;
  StepForecast forecast_;       ///< with a step potential
  Extrapolation slope_ratios_;  ///< dE/dh by differences over the scheme's, of steps that told it
  double since_ratio_ = 0.0;    ///< the time since the start of the newest of them
  double first_miss_ = std::numeric_limits<double>::infinity();  ///< |E_k - E| of first trials, on the last steps
  /// Of lengths foreseen, relative, on the last steps: the largest, older ones less.
  double misforeseen_ = 0.0;
  double price_abreast_ = std::numeric_limits<double>::infinity();  ///< LevelScheme::prepare_abreast()
  double left_of_miss_ = 1.0;  ///< of |E_k - E| after Newton's moves, beyond the tolerance, on the last steps
  double energy_ = std::numeric_limits<double>::quiet_NaN();
  double energy_scale_ = 0.0;
  double law_scale_ = 0.0;  ///< of the terms of the step that set E, f' among them
  double rounding_ = 0.0;
  double law_constant_ = 0.0;
  double step_constant_ = 0.0;  ///< |h^(s+1) Γ|, of the first step or as law_constant_ has it
  double last_step_ = 0.0;
  NodeEnergy last_node_{std::numeric_limits<double>::quiet_NaN(),
                        std::numeric_limits<double>::quiet_NaN()};  ///< the level before this one, for bridges
  double trial_step_ = 0.0;    ///< the step the scheme's trial level was last solved for
  double direction_ = 1.0;     ///< sign of dE/d|h| on the branch the run is on
  double regular_step_ = 0.0;  ///< the last step that met the law
  bool singular_ = false;      ///< inside a bridge, or waiting for the energy law to be met again
  int waited_ = 0;             ///< plain steps since a bridge was looked for in vain
  Bridge nearest_;             ///< of those that long_bridge() tried
  Bridge bridge_;              ///< under way while its count, the steps still to take, is not 0
  std::array<double, 2> slope_gamma_{
      std::numeric_limits<double>::quiet_NaN(),
      std::numeric_limits<double>::quiet_NaN()};  ///< of the last two steps, newest first
  std::array<Sample, 4> history_{};  ///< of the last steps that met the law, newest first; without a step potential
  std::size_t remembered_ = 0;
};

}  // namespace rubato
