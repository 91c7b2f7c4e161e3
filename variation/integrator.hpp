#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/variation/run_span.hpp>
#include <rubato/variation/time_levels.hpp>

namespace rubato {

/// What an orbit's options and a lattice's say of the choice of levels, in the same words.
/// \param has_usual whether a step potential is chosen where they say nothing of it, nor of singular points
/// \param energy_constant what the constant that was added to H, or to S, adds to discrete energies
template <typename Options>
[[nodiscard]] LevelOptions level_options(const Options& options, bool has_usual, double energy_constant) {
  return {.levels = options.levels,
          .on_singular = options.on_singular.value_or(OnSingular::plain),
          .tolerance = options.tolerance,
          .energy_constant = energy_constant,
          .potential = with_usual(options.potential, has_usual && !options.on_singular)};
}

/// Steps an orbit or a lattice, level by level: a scheme, and the levels that are chosen for it.
class Integrator {
public:
  Integrator() = default;
  Integrator(Integrator&&) noexcept = default;
  Integrator& operator=(Integrator&&) noexcept = default;
  virtual ~Integrator() = default;

  /// One step. Unless it succeeds nothing has changed.
  [[nodiscard]] virtual StepReport step() { return levels_->step(); }
  /// True if the present level is at or past `until` (a level within 1e-9 of a step of it counts as at it).
  [[nodiscard]] bool finished() const;

  [[nodiscard]] double t() const { return levels_->time(); }
  [[nodiscard]] NodeEnergy node();  ///< H(z_k), or 𝓔(z_k), and -24 η(z_k); NaN where the scheme has none
  /// The same with Γ = fᵀH_zz f itself (theory, section 3); NaN where -24 η is no multiple of it.
  [[nodiscard]] NodeEnergy reported_node();
  /// The same of H, or S, without the constant that was added to it.
  [[nodiscard]] NodeEnergy bare_node() { return level_scheme_->node(); }
  /// True if reported_node() has Γ.
  [[nodiscard]] bool has_gamma() const {
    return level_scheme_->has_gamma() && !std::isnan(level_scheme_->gamma_factor());
  }
  /// True if E_k is one constant for the run; if not (𝕃 depends on t), energy_balance() is what (3.4) leaves.
  [[nodiscard]] bool autonomous() const { return !level_scheme_->energy_target().has_value(); }
  [[nodiscard]] const TimeLevels& levels() const { return *levels_; }
  [[nodiscard]] TimeLevels& levels() { return *levels_; }
  [[nodiscard]] int order() const { return level_scheme_->order(); }
  /// What these options do badly although they can, or what is doubtful about the problem, with a remedy: sentences for
  /// people.
  [[nodiscard]] virtual std::vector<std::string> cautions() const { return {}; }
  /// After Status::undefined: what of the formula was not defined, where that is known.
  [[nodiscard]] std::string failure_reason() const { return level_scheme_->failure_reason(); }
  /// describe_failure() of a step that failed here.
  [[nodiscard]] std::string explain(const StepReport& failed);

  /// All that continuing bit for bit needs. restore() is for an integrator constructed from the same arguments.
  virtual void save(StateWriter& state) const;
  virtual void restore(StateReader& state);

protected:
  /// Begins the levels of `scheme`, which has to outlive this.
  /// \param node_constant what the added constant adds to node energies
  template <typename Options>
  void begin(LevelScheme& scheme, const Options& options, const LevelOptions& levels, double start,
             double node_constant) {
    level_scheme_ = &scheme;
    levels_ = std::make_unique<TimeLevels>(scheme, levels, start, options.step);
    until_ = options.until;
    forward_ = options.step > 0.0;
    node_constant_ = node_constant;
  }

private:
  LevelScheme* level_scheme_ = nullptr;
  std::unique_ptr<TimeLevels> levels_;
  double until_ = 0.0;
  bool forward_ = true;
  double node_constant_ = 0.0;
};

/// Returns one sentence on why a step failed at time t, with the values that matter and a remedy.
/// \param node at that level; its Γ is NaN where the scheme has none
/// \param order of the scheme
/// \param reason the part of the formula that was not defined, if known
[[nodiscard]] std::string describe_failure(const StepReport& report, double t, const NodeEnergy& node, double last_step,
                                           const LevelOptions& options, int order, std::string_view reason = {});

/// Returns the name of the number that stands for Γ where the scheme has none: "-(4/h) dE/dh" for order 2, and for
/// order s -24/(s(s+1) h^(s-1)) dE/dh, which is -24 η to leading order (theory, section 8).
[[nodiscard]] std::string slope_name(int order);

}  // namespace rubato
