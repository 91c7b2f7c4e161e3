#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include <rubato/base/state.hpp>
#include <rubato/base/status.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

/// What the choice of time levels reads at a level: the node energy H(z_k) and what the law of the scheme has as Γ,
/// -24 η (theory, section 8), which is LevelScheme::gamma_factor() times Γ.
struct NodeEnergy {
  double energy = 0.0;
  double gamma = 0.0;
};

/// What the choice of time levels (time_levels.hpp) needs from a time-stepping scheme, be it an orbit or a lattice.
///
/// A scheme stands at a *current* level. advance(h) solves its value equations (3.3) for a *trial* level at distance h;
/// accept() makes the trial level the current one. Trying again with another h starts from the trial already found.
class LevelScheme {
public:
  virtual ~LevelScheme() = default;

  /// Solves (3.3) for the step of length h ≠ 0. `accuracy` is the relative size of the last correction at which the
  /// iteration may stop; 0 asks for stagnation, that is for all that rounding allows.
  [[nodiscard]] virtual Status advance(double h, double accuracy) = 0;
  /// True if any accuracy leaves what rounding leaves: nothing is iterated, or always to the end.
  [[nodiscard]] virtual bool solves_fully() const { return false; }

  /// E_k of the trial step, (3.4).
  [[nodiscard]] virtual double discrete_energy() const = 0;
  /// How large E_k is, as a sum of terms that may cancel and without added constants, and its rounding error:
  /// the scale of the tolerance, and the error of h. Where E_k was last evaluated; at the current level if it has not
  /// been yet.
  [[nodiscard]] virtual formula::SumSize energy_size() = 0;
  /// For how many steps of fixed levels that serves, a multiple of tuning::size_period; with variable levels, for as
  /// many as it is multiples.
  [[nodiscard]] virtual std::size_t energy_size_period() const { return tuning::size_period; }
  /// Total derivative dE_k/dh along the solved step; -(h/4)Γ for the midpoint 𝕃, -s h^(s-1) (s+1)Γ/24 for order s.
  [[nodiscard]] virtual double discrete_energy_slope() const = 0;
  /// True if something is found for it that the step does not need: node energies, or rates.
  [[nodiscard]] virtual bool slope_costs_more() const { return !has_node_law(); }
  /// True if it is the leading term of the derivative alone, off by a factor that hardly depends on h.
  [[nodiscard]] virtual bool slope_to_leading_order() const { return false; }
  /// What E_k must equal when it is not one constant for the run (𝕃 depending on t explicitly), else nothing.
  [[nodiscard]] virtual std::optional<double> energy_target() const { return std::nullopt; }
  /// The exponent s of the step law h^(s+1) Γ = const.
  [[nodiscard]] virtual int order() const { return 2; }

  /// True if the Γ of node() governs this scheme: the step law, and the node law H - E = (s+1)/24 h^s Γ + …
  /// Not so for an arbitrary 𝕃.
  [[nodiscard]] virtual bool has_node_law() const { return true; }

  [[nodiscard]] virtual NodeEnergy node() = 0;       ///< at the current level
  [[nodiscard]] virtual int iterations() const = 0;  ///< solver iterations since the last accept()

  /// What node() has as Γ, over fᵀH_zz f (theory, section 3); NaN where it is no multiple of that.
  [[nodiscard]] virtual double gamma_factor() const { return 1.0; }

  /// True if node() knows Γ, the quantity that dE_k/dh of this scheme is proportional to; else it is NaN there.
  [[nodiscard]] virtual bool has_gamma() const { return has_node_law(); }

  /// After Status::undefined, or where Γ is not a number: why, for people; empty where nothing more is known.
  [[nodiscard]] virtual std::string failure_reason() const { return {}; }

  virtual void accept() = 0;

  /// All that continuing bit for bit from the current level needs.
  virtual void save(StateWriter& state) const = 0;
  virtual void restore(StateReader& state) = 0;
};

}  // namespace rubato
