#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/pde/action_kernel.hpp>
#include <rubato/pde/action_newton.hpp>
#include <rubato/pde/action_rows.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/wall_drives.hpp>
#include <rubato/variation/level_values.hpp>
#include <rubato/variation/node_pass.hpp>

namespace rubato {

/// Steps by the rows of an action. Where they can be put into an order in which each gives one field node by node, they
/// are solved one after the other by formulas, in one pass over the lattice that finds what follows, and the energies,
/// too (NodePass); else all together by Newton's method, with sparse matrices factored by Eigen, and what they do not
/// determine is held (ActionKernel).
///
///     step.begin(level);                                 // the level that steps are taken from
///     step.advance(h, level, kept, accuracy, after);     // as often as lengths are tried
///     step.energy();
///     step.move();                                       // `after` is what the next step is taken from
///
/// E = Σ ΔV (e(z_k, z_{k+1}) + a(z_k) + b(z_{k+1})) is summed up as it stands there: Σ a is known from the step before.
class ActionStep {
public:
  /// \param h a length of the steps, for the search for what rows do not determine
  /// \throws std::invalid_argument as ActionRows and find_kernel()
  ActionStep(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated, double h,
             bool two_step = false);
  ActionStep(const ActionStep&) = delete;
  ActionStep& operator=(const ActionStep&) = delete;

  [[nodiscard]] const ActionRows& rows() const { return rows_; }
  [[nodiscard]] bool is_explicit() const { return !stages_.empty(); }
  /// Of an explicit step: how many ghosts beyond a wall it makes wrong, and what follows from the new level.
  [[nodiscard]] std::size_t lost_at_walls() const { return stages_.size() + 1; }
  /// What no row determines and every step holds: "the mean of phi", "the sawtooth (-1)^i of u".
  [[nodiscard]] std::vector<std::string> held() const;

  /// Fields of the first level that M does not move and the action names, by their rows where both levels are this
  /// one; then those that follow by differences. Where the rows do not determine them they stay as they are.
  void constrain(double h, LatticeLevel& level);
  /// Fields that follow from others by differences at a level: steps neither read nor write them.
  void write(LatticeLevel& level);
  /// The fields that write() gives, and all others.
  ///@{
  [[nodiscard]] const std::vector<int>& written() const { return written_; }
  [[nodiscard]] const std::vector<int>& found() const { return found_; }
  ///@}

  /// The next steps are taken from this level. Collective where ranks share the lattice, as all steps are.
  void begin(const LatticeLevel& level);
  /// The level h after `before`, with the momenta that are fields, into `after`, whose fields are where Newton's method
  /// begins. \param kept the momenta that are kept. \param accuracy relative size of the last correction at which
  /// Newton's method may stop; 0: stagnation
  [[nodiscard]] Status advance(double h, const LatticeLevel& before, const grids::FieldSet& kept, double accuracy,
                               grids::FieldSet& after);
  /// The energies of a step to a level that is there, and the momenta of that which are fields into `momenta`.
  void derive(double h, const LatticeLevel& before, const grids::FieldSet& after, grids::FieldSet& momenta);
  /// Some nodes of the upper level have changed.
  void renew(const LatticeLevel& level, std::span<const grids::NodeRange> ranges);
  /// The upper level is the lower one from now on.
  void move();

  /// Lets walls give fields their values at a time, of the next level. Hypothesis: they do
  void drive(double t);
  [[nodiscard]] bool is_driven() const { return driven_nodes_.has_value(); }
  /// What the walls that do so do in a step: before the middle of the step, and after it (theory, section 12).
  struct Work {
    double before = 0.0, after = 0.0;
  };
  [[nodiscard]] Work work(double h, const LatticeLevel& before, const grids::FieldSet& after);

  /// E_k = -∂𝕊/∂h of the last step.
  [[nodiscard]] double energy() const { return volume_ * (of_slab_ + below_.of_energy); }
  /// True if steps find 𝓔 of their levels, too: E of a step of length 0 with the rates that the momenta there say.
  [[nodiscard]] bool finds_energy_of_levels() const { return finds_energy_of_levels_; }
  /// 𝓔 of the level that steps are taken from; of that which the last one led to.
  ///@{
  [[nodiscard]] double energy_at_begin() const { return volume_ * below_.energy; }
  [[nodiscard]] double energy_at_end() const { return volume_ * above_.energy; }
  ///@}
  /// E of a step of length h that rests at a level.
  [[nodiscard]] double energy_at_rest(double h, const LatticeLevel& level);
  /// How large the terms of E are, and its rounding error.
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

private:
  using Expression = formula::Expression;
  /// Code that is made when it is first needed.
  using LateCode = std::optional<NodeCode>;
  /// Fields that rows give.
  struct Stage {
    std::vector<int> fields;
    std::vector<Expression> values;
    std::size_t reach;  ///< along the last axis
    LateCode tangent, by_step;
  };
  /// Fields that follow by differences, or as momenta, of one turn.
  struct Turn {
    std::vector<int> fields;
    std::vector<Expression> values;
    bool is_momenta;
    LateCode value, tangent;
  };
  struct Implicit {
    ActionEquations equations;
    ActionKernel kernel;
    std::optional<ActionNewton> newton;
  };
  struct Codes {
    LateCode row, keep, imply, on_walls, along_upper, along_lower, by_step, forms;
  };
  /// Of a level, over ΔV: its part of E as a lower level, and 𝓔.
  struct OfLevel {
    double of_energy = 0.0, energy = 0.0;
  };

  void find_held();
  /// The new value of a field, or of a wall that holds it.
  [[nodiscard]] Expression where_loose(int field, Expression value);
  [[nodiscard]] int place_of_driven(int field) const;
  void find_stages();
  void find_turns();
  void prepare_pass();
  [[nodiscard]] Expression energy_of_level();
  [[nodiscard]] std::size_t reach(std::span<const Expression> formulas) const;
  template <class Formulas>
  [[nodiscard]] NodeCode& made(LateCode& code, const Formulas& formulas) {
    if (!code) {
      code = rows_.variation().code(formulas());
    }
    return *code;
  }
  /// A formula for each row.
  template <class Of>
  [[nodiscard]] NodeCode& made_of_rows(LateCode& code, const Of& of) {
    return made(code, [&] {
      std::vector<Expression> formulas;
      std::ranges::transform(rows_.rows(), std::back_inserter(formulas), of);
      return formulas;
    });
  }
  template <class Of>
  void keep_by(LateCode& code, const Of& of, double h, const LatticeLevel& before, const grids::FieldSet& after,
               grids::FieldSet& kept);
  [[nodiscard]] std::vector<Expression> forms_of_rows();
  void read(NodeCode& code, double h, const LatticeLevel& before, const grids::FieldSet& after,
            const grids::FieldSet& kept) const;
  /// Evaluates the pass from a stage on. \return whether all is finite
  bool evaluate(std::size_t first_stage, double h, const LatticeLevel& before, const grids::FieldSet& kept,
                const grids::FieldSet& after, grids::FieldSet& out);
  /// Solves (∂row/∂upper) direction = -right, into upper_, where `right` is a code of one output for each row.
  [[nodiscard]] bool solve_linear(NodeCode& right, double h, const LatticeLevel& before, const grids::FieldSet& kept,
                                  const grids::FieldSet& after);
  /// The fields of a stage at the upper level of a direction.
  void make_directions();
  void move_direction(NodeCode& code, const Stage& stage);

  ActionRows rows_;
  std::vector<Stage> stages_;
  std::optional<Implicit> implicit_;
  /// For each field the product of numbers of places that is 0 on walls that hold it, else 1; invalid where none does.
  std::vector<Expression> is_loose_;
  std::optional<DrivenNodes> driven_nodes_;
  grids::FieldSet driven_;  ///< what walls hold the fields of driven_nodes_ at
  std::vector<Turn> turns_;
  std::vector<int> momenta_, written_, found_;  ///< fields
  Codes codes_;
  NodePass pass_;  ///< the stages, then what follows and the energies
  NodePass begin_, rest_, size_, slope_;
  LevelValues levels_;  ///< functions of the lower level
  bool finds_energy_of_levels_ = false;
  std::size_t place_of_lower_ = 0;  ///< among the sums of the pass
  OfLevel below_, above_;
  double of_slab_ = 0.0;           ///< E over ΔV, without the lower level's part
  grids::FieldSet lower_, upper_;  ///< of directions, without nodes before make_directions()
  grids::FieldSet row_values_;     ///< of Newton's method
  std::size_t nodes_;
  grids::FieldSet no_momenta_;
  double volume_;
};

}  // namespace rubato
