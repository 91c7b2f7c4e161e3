#pragma once

#include <optional>
#include <stdexcept>
#include <vector>

#include <rubato/base/state.hpp>

namespace rubato {

/// A function f of the step alone, subtracted from the discrete action (theory, section 9): A - f(h). No value equation
/// changes, so that the map is the same; the discrete energy becomes K_h + f'(h). Like a spring in the direction of
/// time it resists long steps, and where the law of K_h alone has no solution this one still has:
///
///     f'(h) = strength · (|h| / length)^exponent.
struct StepPotential {
  double strength = 0.0;  ///< signed; 0 for no potential
  double length = 1.0;    ///< about the largest step
  double exponent = 2.0;  ///< p, greater than the order

  [[nodiscard]] bool active() const { return strength != 0.0; }
  /// f'(h), what it adds to the discrete energy, an even function of h.
  [[nodiscard]] double energy(double h) const;
  /// f''(h) = p f'(h)/h; 0 at h = 0, where a step is none.
  [[nodiscard]] double slope(double h) const { return at(h).slope; }
  /// Both, for one power.
  struct Part {
    double energy = 0.0, slope = 0.0;
  };
  [[nodiscard]] Part at(double h) const;
  /// A bound of the rounding error of f'(h), which is `energy`.
  [[nodiscard]] double rounding_of(double energy) const;

  void save(StateWriter& state) const;
  void restore(StateReader& state);
};

/// How the step potential of a run is chosen.
struct StepPotentialChoice {
  enum class Kind {
    none,
    automatic,  ///< by a look-ahead (choose_step_potential)
    given,      ///< f' = σ (s+1)|η_0| h_0^s (h/(κ h_0))^p, with σ the sign of η_0, of the first step h_0
    stated,     ///< `potential` itself
    usual,      ///< automatic, unless something else is said of the places where the law has no solution
  };
  Kind kind = Kind::none;
  double kappa = 0.0;                                 ///< given: κ h_0 is about the largest step
  double exponent = 0.0;                              ///< given: p
  std::optional<double> largest_step = std::nullopt;  ///< automatic: κ h_0 is at most this
  StepPotential potential = {};                       ///< stated
};

/// The choice with Kind::usual made what it stands for.
[[nodiscard]] StepPotentialChoice with_usual(const StepPotentialChoice& choice, bool usual_is_automatic);

/// Numbers of a step potential that make none: p not greater than the order of the scheme, or κ not positive.
class StepPotentialError : public std::invalid_argument {
public:
  using std::invalid_argument::invalid_argument;
};

/// What a look-ahead saw of an orbit: η in the middle of each of its steps, from dK/d|h| = s(s+1)|h|^(s-1) η (theory,
/// section 8).
struct LookAhead {
  int order = 2;
  double step = 0.0;              ///< |h_0|, of the run's first step
  std::vector<double> time = {};  ///< |t - t_0| of the middles, increasing
  std::vector<double> eta = {};
  double duration = 0.0;     ///< |t - t_0| at the end of the last step
  double energy_size = 0.0;  ///< of the terms of K: what a potential has to be seen beside where η vanishes
  double first_size = 0.0;   ///< the same of the first step: beside a larger f' they would be lost; 0 if not known
  double tolerance = 1e-13;  ///< that levels will be solved to, relative to energy_size
  double rounding = 0.0;     ///< bound of the rounding error of K

  [[nodiscard]] double largest_eta() const;  ///< max |η|
  /// What the node energy is off by in a step of that length with that η, (s+1)|η|h^s (theory, section 8).
  [[nodiscard]] double off(double value, double length) const;
  /// The time that η[i] stands for: from half way to the one before to half way to the next.
  [[nodiscard]] double time_of(std::size_t i) const;
  /// What |h dE/dh| has to be, to distinguish one step from another.
  [[nodiscard]] double resolved_slope() const;
  /// The smallest |η| that K reports on in a first step: its |h dE/dh| there is that.
  [[nodiscard]] double least_resolved() const;
  /// True if K depends on h at all: else every first step leaves K and H the same, to a tenth of the tolerance or to
  /// rounding.
  [[nodiscard]] bool depends_on_step() const;
  /// True if K distinguishes one step from another, anywhere.
  [[nodiscard]] bool knows_step() const;
};

/// The potential for an orbit that was looked along. At order 4 and more that of steps that are nearly equal, where
/// equal ones do as well as those that follow η (equal_steps.hpp). Else both signs, two exponents, and lengths from
/// steps that are nearly equal to steps that hardly feel it are tried; those count with which all levels are forecast
/// to exist, with a margin. What their steps are worth is steps · max|D - D_0|^(1/s), the number of steps it takes for
/// an error. Of those not much worse than the best, and at order 4 and more, or where η did something new in the second
/// half of the stretch, of those that would last if it changed its sign as well, one that is hardly felt is taken; if
/// there is none the weakest of those about as good as the best. Hypothesis: at least one η, all finite.
[[nodiscard]] StepPotential choose_step_potential(const LookAhead& look, std::optional<double> largest_step);

/// How many times as many steps a potential takes over the stretch of a look-ahead as the law does without one, whose
/// steps are, by the step law (theory, section 3), h_0 (|η_0|/|η|)^(1/(s+1)); 1 where K hardly knows h.
[[nodiscard]] double cost_in_steps(const LookAhead& look, const StepPotential& potential);

/// Both, as the choice has forecast the steps already.
struct CostedPotential {
  StepPotential potential;
  double cost_in_steps = 1.0;
};
[[nodiscard]] CostedPotential choose_costed_potential(const LookAhead& look, std::optional<double> largest_step);

/// The potential of StepPotentialChoice::Kind::given.
[[nodiscard]] StepPotential make_step_potential(const LookAhead& look, double kappa, double exponent);

/// The strength rounded to six binary digits, within 1.6 %: rounding in η changes no potential, nor do units that
/// differ by powers of two.
[[nodiscard]] double rounded_strength(double strength);

}  // namespace rubato
