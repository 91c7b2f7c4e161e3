#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/pde/action_kernel.hpp>
#include <rubato/pde/action_newton.hpp>
#include <rubato/pde/action_rows.hpp>
#include <rubato/pde/initial_level.hpp>

namespace rubato {

/// Steps by the rows of an action. Where they can be put into an order in which each gives one field node by node, they
/// are solved one after the other by formulas; else all together by Newton's method, with sparse matrices factored by
/// Eigen, and what they do not determine is held (ActionKernel).
class ActionStep {
public:
  /// \param h a length of the steps, for the search for what rows do not determine
  /// \throws std::invalid_argument as ActionRows and find_kernel()
  ActionStep(const MultisymplecticSystem& system, const grids::Grid& grid, const CornerDensity& density, double h,
             bool two_step = false);
  ActionStep(const ActionStep&) = delete;
  ActionStep& operator=(const ActionStep&) = delete;

  [[nodiscard]] const ActionRows& rows() const { return rows_; }
  [[nodiscard]] bool is_explicit() const { return !stages_.empty(); }
  /// What no row determines and every step holds: "the mean of phi", "the sawtooth (-1)^i of u".
  [[nodiscard]] std::vector<std::string> held() const;

  /// Fields of the first level that M does not move and the density names, by their rows where both levels are this
  /// one; then those that follow by differences. Where the rows do not determine them they stay as they are.
  void constrain(double h, LatticeLevel& level);

  /// The level h after `before`, into `after`, whose fields are where the search begins. \param kept the momenta that
  /// are kept. \param accuracy relative size of the last correction at which Newton's method may stop; 0: stagnation
  [[nodiscard]] Status solve(double h, const LatticeLevel& before, const grids::FieldSet& kept, double accuracy,
                             grids::FieldSet& after);
  /// Fields that the density does not name, at the upper level; and the energy density of the step.
  void derive(double h, const LatticeLevel& before, grids::FieldSet& after);
  /// E_k = -∂𝕊/∂h of the step that derive() or measure() has seen last.
  [[nodiscard]] double energy() const;
  /// E of a step of length h that rests at a level.
  [[nodiscard]] double energy_at_rest(double h, const LatticeLevel& level);
  /// How large the terms of E are, and what rounding makes of it.
  [[nodiscard]] formula::SumSize energy_size(double h, const LatticeLevel& before, const grids::FieldSet& after);
  /// dE/dh along the solved step, total. NaN where it cannot be found.
  [[nodiscard]] double energy_slope(double h, const LatticeLevel& before, const grids::FieldSet& kept,
                                    const grids::FieldSet& after);
  /// Momenta of the upper level, to be kept.
  void keep(double h, const LatticeLevel& before, const grids::FieldSet& after, grids::FieldSet& kept);
  /// The same of the lower level: those that lead to the upper one.
  void imply(double h, const LatticeLevel& before, const grids::FieldSet& after, grids::FieldSet& kept);
  /// What two levels leave of each row, over h, into the rows of their fields; of fields that follow the difference.
  void measure(double h, const LatticeLevel& before, const LatticeLevel& after, const grids::FieldSet& kept,
               grids::FieldSet& out);

  /// The largest residual of a row over the largest ∂𝕊/∂z of its field.
  [[nodiscard]] double relative_miss(double h, const LatticeLevel& before, const LatticeLevel& after,
                                     const grids::FieldSet& kept);

  /// U at the upper level of a solution of the linearised rows. \param forms receives δ∂𝕊/∂z at both levels and δπ at
  /// both, one array for each row in this order. Hypothesis: no momentum is kept
  [[nodiscard]] Status tangent(double h, const LatticeLevel& before, const LatticeLevel& after,
                               const grids::FieldSet& u_before, grids::FieldSet& u_after, grids::FieldSet& forms);

  /// Another level is the lower one from now on.
  void leave_level();

private:
  struct Stage {
    std::vector<int> fields;
    NodeCode values, tangent, by_step;
  };
  void find_stages();
  void find_turns();
  void find_energy(double h, const LatticeLevel& before, const grids::FieldSet& after);
  /// The fields that follow, of the upper level `after`, into `out`.
  void follow(double h, const LatticeLevel& before, const grids::FieldSet& after, grids::FieldSet& out);
  void compile();
  void read(NodeCode& code, double h, const LatticeLevel& before, const grids::FieldSet& after,
            const grids::FieldSet& kept) const;
  [[nodiscard]] Status solve_by_stages(double h, const LatticeLevel& before, const grids::FieldSet& kept,
                                       grids::FieldSet& after);
  /// Solves (∂row/∂upper) direction = -right, into upper_, where `right` is a code of one output for each row.
  [[nodiscard]] bool solve_linear(NodeCode& right, double h, const LatticeLevel& before, const grids::FieldSet& kept,
                                  const grids::FieldSet& after);

  ActionRows rows_;
  ActionEquations equations_;
  ActionKernel kernel_;
  std::vector<Stage> stages_;
  std::optional<ActionNewton> newton_;
  /// Fields that follow, of one turn.
  struct Turn {
    std::vector<int> fields;
    NodeCode values, tangent;
  };
  std::vector<Turn> turns_;
  NodeCode energy_code_, row_code_, keep_, imply_, size_code_, slope_code_;
  NodeCode row_along_upper_, row_along_lower_, row_by_step_, forms_code_;
  bool has_tangents_ = false;
  grids::FieldSet density_, lower_, upper_, row_values_;
  grids::FieldSet no_momenta_;
  double volume_;
};

}  // namespace rubato
