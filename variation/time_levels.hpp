#pragma once

#include <array>
#include <cmath>
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
  plain,  ///< steps of the last size, off the law, until it can be met again
  stop,   ///< end the run there
};

struct LevelOptions {
  Levels levels = Levels::variable;
  OnSingular on_singular = OnSingular::plain;
  double tolerance = 1e-13;       ///< of the level equation, relative to energy_scale()
  double condition_limit = 1e-2;  ///< a step whose condition exceeds it is refused: its energy law is only rounding
  double energy_constant = 0.0;   ///< to be added to the scheme's energies in what is reported on them
  StepPotentialChoice potential = {};
  double run_length = std::numeric_limits<double>::infinity();  ///< |until - start|; infinite if it is not known
  bool spares_look_ahead = false;  ///< in a short run (is_short_run), where one step serves (nearly_equal_steps)
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
  /// steps that meet it), and by δE, a bound of the rounding error of E_k. For the midpoint 𝕃 |h dE/dh| = h²|Γ|/4. NaN
  /// with fixed levels, where h is what was asked for.
  double condition = 0.0;
  int iterations = 0;
  bool off_law = false;  ///< a plain step, taken where the energy law has no solution

  /// Evidence for why a step is off the law, or failed: Γ of the step before and of this one, by the slopes dE/dh of
  /// both, as -24 dE/dh / (s(s+1) h^(s-1)). Of a failed step: of the last two, or Γ at the level that it failed from
  /// where the scheme has it. NaN where there is none.
  double gamma_before = std::numeric_limits<double>::quiet_NaN();
  double gamma_after = std::numeric_limits<double>::quiet_NaN();
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
/// level equation solvable where K_h alone has no solution. Where there is none all the same, plain steps are taken,
/// flagged as off the law, until it can be met again; `stop` ends the run there.
///
/// Where K does not depend on h, as for steps that are exact or at rest, no length is better than another: all are as
/// long as the first, and f' is 0. A step that is off E then is flagged.
///
/// A step that is not flagged meets E_k = E, to the tolerance or to what rounding in E_k leaves, whichever
/// is larger; the very numbers of its report are judged before it is taken. However large terms grow, as in a blow-up,
/// it is within a thousandth of those that E was set with. H has no preferred zero: what the tolerance is relative to,
/// and the rounding error of E_k, are properties of the terms that E_k is the sum of (LevelScheme::energy_size), not
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
  /// The largest size of E_k so far (LevelScheme::energy_size), added constants left out.
  [[nodiscard]] double energy_scale() const { return energy_scale_; }
  /// The largest of each part of the size of K_h so far (LevelScheme::energy_size), f' left out.
  [[nodiscard]] const formula::SumSize& sizes() const { return sizes_; }
  /// A bound of the rounding error of E_k, near the present level.
  [[nodiscard]] double energy_rounding() const { return rounding_; }
  [[nodiscard]] double last_step() const { return last_step_; }
  /// The step potential of the run; none before the first step.
  [[nodiscard]] const StepPotential& potential() const { return potential_; }
  /// cost_in_steps() of a potential that was chosen by a look-ahead. It is reported on a run that is restored, too, not
  /// by save(), whose layout records have.
  [[nodiscard]] std::optional<double> potential_cost() const { return potential_cost_; }
  void set_potential_cost(std::optional<double> cost) { potential_cost_ = cost; }
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
  StepReport steady_step();
  /// True if K was found not to depend on h, so that f' is 0 and every step as long as the first.
  [[nodiscard]] bool is_steady() const {
    return options_.potential.kind != StepPotentialChoice::Kind::none && !potential_.active();
  }
  StepReport plain_step(double h);
  StepReport ordinary_step(double guess);
  StepReport report(Status status, double h);
  void take(StepReport& report);
  void take_ordinary(StepReport& report);
  void set_energy(const StepReport& report, double terms = 0.0);
  [[nodiscard]] double solved_to() const;
  [[nodiscard]] double allowed_miss(const StepReport& step) const;
  [[nodiscard]] double gamma_of(const StepReport& step) const;
  /// Γ where -24 η is a multiple of it; else -24 η itself.
  [[nodiscard]] double reported_gamma(double law) const {
    return std::isnan(scheme_.gamma_factor()) ? law : law / scheme_.gamma_factor();
  }
  void add_evidence(StepReport& failed) const;

  [[nodiscard]] Status solve_level(double guess);

  // potential_levels.cpp: levels with a step potential (theory, section 9).
  void choose_potential();
  [[nodiscard]] Status solve_with_potential(double guess);
  [[nodiscard]] double foreseen_slope_ratio();

  // Where the step equation has no solution.
  [[nodiscard]] StepReport resumed();
  [[nodiscard]] double plain_length() const;
  [[nodiscard]] StepReport plain_instead(const StepReport& failed);
  [[nodiscard]] StepReport flagged(StepReport report);

  [[nodiscard]] double density_at(double time) const;
  [[nodiscard]] double predicted_step();
  [[nodiscard]] double law_step(double gamma) const;
  void remember(double h, double slope);
  void measure(double h);

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
  std::optional<double> potential_cost_;
  StepForecast forecast_;       ///< with a step potential
  Extrapolation slope_ratios_;  ///< dE/dh by differences over the scheme's, of steps that reported it
  double slope_ratio_ = 1.0;    ///< that the last trial was solved with
  double since_ratio_ = 0.0;    ///< the time since the start of the newest of them
  double first_miss_ = std::numeric_limits<double>::infinity();  ///< |E_k - E| of first trials, on the last steps
  double left_of_miss_ = 1.0;  ///< of |E_k - E| after Newton's moves, beyond the tolerance, on the last steps
  double energy_ = std::numeric_limits<double>::quiet_NaN();
  double energy_scale_ = 0.0;
  formula::SumSize sizes_;
  double law_scale_ = 0.0;  ///< of the terms of the step that set E, f' among them
  double rounding_ = 0.0;
  double step_constant_ = 0.0;  ///< |h^(s+1) Γ| of the first step
  double last_step_ = 0.0;
  double trial_step_ = 0.0;    ///< the step the scheme's trial level was last solved for
  double direction_ = 1.0;     ///< sign of dE/d|h| on the branch the run is on
  double regular_step_ = 0.0;  ///< the last step that met the law
  bool singular_ = false;      ///< the last step was off the law
  std::array<double, 2> slope_gamma_{
      std::numeric_limits<double>::quiet_NaN(),
      std::numeric_limits<double>::quiet_NaN()};  ///< of the last two steps, newest first
  std::array<Sample, 4> history_{};  ///< of the last steps that met the law, newest first; without a step potential
  std::size_t remembered_ = 0;
};

}  // namespace rubato
