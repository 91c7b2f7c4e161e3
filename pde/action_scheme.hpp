#pragma once

#include <memory>
#include <optional>

#include <rubato/pde/action_step.hpp>
#include <rubato/pde/corner_energy.hpp>
#include <rubato/pde/lattice_method.hpp>

namespace rubato {

/// 𝓔 of a level, with the constant of S, where steps of an action do not find it: E of a step that rests,
/// z_{k+1} = z_k, where the action is one of the phase space; else, where momenta are fields, that of the system at the
/// nodes (CornerEnergy).
class ActionEnergy {
public:
  ActionEnergy(const MultisymplecticSystem& system, const grids::Grid& grid, const ActionRows& rows, double h);
  [[nodiscard]] double operator()(ActionStep& step, const LatticeLevel& level);

private:
  std::optional<CornerEnergy> at_corners_;
  double h_, constant_;
};

/// The second level of an action whose steps do not begin from one: that which is given, or one step of the box, or of
/// the Fourier scheme where the box cannot take the grid.
class ActionStart {
public:
  /// \param next a level that is given, `next->h` after the first
  ActionStart(const MultisymplecticSystem& system, const grids::Grid& grid, std::shared_ptr<const SecondLevel> next)
      : system_(system), grid_(grid), next_(std::move(next)) {}
  /// Completes a level that is given: fields that M does not move follow from the others. \throws std::invalid_argument
  /// if one that L names is missing
  void complete(ActionStep& step, const LatticeLevel& first);

  [[nodiscard]] bool is_given() const { return next_ != nullptr; }
  /// The fields that the action names, into `after`. Status::not_converged if another length is asked for than that of
  /// the level that is given.
  [[nodiscard]] Status operator()(double h, const LatticeLevel& first, const ActionRows& rows, grids::FieldSet& after);

private:
  MultisymplecticSystem system_;
  grids::Grid grid_;
  std::shared_ptr<const SecondLevel> next_;
  std::unique_ptr<LatticeMethod> method_;
  std::optional<LatticeLevel> first_;   ///< as `method_` has it
  std::optional<LatticeLevel> second_;  ///< what is given, completed
};

/// The step of an action, by its rows or, from the first level, by an ActionStart.
class ActionMap {
public:
  /// \throws std::invalid_argument as ActionStep
  ActionMap(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated,
            std::shared_ptr<const SecondLevel> next, const LatticeLevel& first, double first_step);

  [[nodiscard]] ActionStep& step() { return *step_; }
  [[nodiscard]] const ActionRows& rows() const { return step_->rows(); }
  [[nodiscard]] ActionEnergy& energy() { return *energy_; }
  /// True if the step from the first level is not one of the rows.
  [[nodiscard]] bool needs_start() const { return start_.is_given() || !rows().begins_from_one_level(); }
  [[nodiscard]] ActionStart& start() { return start_; }
  /// What the constant of S adds to E, which has none of its own.
  [[nodiscard]] double energy_constant() const { return constant_; }
  [[nodiscard]] grids::FieldSet room_for_momenta() const { return {rows().kept(), grid_.size()}; }

private:
  grids::Grid grid_;
  double constant_;
  ActionStart start_;
  std::unique_ptr<ActionStep> step_;
  std::optional<ActionEnergy> energy_;
};

/// A scheme from an action alone (ActionRows): its steps, discrete energy E_k = -∂𝕊/∂h and slope dE/dh, with fixed
/// levels or variable ones.
[[nodiscard]] std::unique_ptr<LatticeScheme> make_action_scheme(const MultisymplecticSystem& system,
                                                                const grids::Grid& grid, const StatedAction& stated,
                                                                std::shared_ptr<const SecondLevel> next,
                                                                LatticeLevel first, double first_step);
/// The equation that it solves. Where momenta are kept, steps have to be judged one after the other from `first`; with
/// first_step = 0 they are not, and nothing but their energy is reported.
[[nodiscard]] std::unique_ptr<StepEquation> make_action_equation(const MultisymplecticSystem& system,
                                                                 const grids::Grid& grid, const StatedAction& stated,
                                                                 std::shared_ptr<const SecondLevel> next,
                                                                 const LatticeLevel& first, double first_step);
/// Null where momenta are kept.
[[nodiscard]] std::unique_ptr<TangentStep> make_action_tangents(const MultisymplecticSystem& system,
                                                                const grids::Grid& grid, const StatedAction& stated);
/// Local laws: those of `inner`, and of two tangent solutions (ω_{k+1} - ω_k)/h - Ω/(h ΔV) at every node, with
/// ω = Σ_f (U_f δ_Vπ_f - V_f δ_Uπ_f) of a level and Ω the two-form of the slab's action there, at both levels together
/// a divergence in space.
[[nodiscard]] std::unique_ptr<LawEvaluator> make_action_laws(std::unique_ptr<LawEvaluator> inner,
                                                             std::vector<int> named_fields);

}  // namespace rubato
