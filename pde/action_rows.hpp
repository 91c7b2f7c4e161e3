#pragma once

#include <functional>
#include <initializer_list>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/stated_action.hpp>
#include <rubato/variation/node_variation.hpp>

namespace rubato {

/// What the variation of an action by the values at a node gives a step to solve: one row for each field that the
/// action names, as formulas of a node and its neighbours.
///
/// The discrete Euler–Lagrange equation at a level joins two slabs. It is stepped in momentum form,
///
///     ∂𝕊/∂z_k + π_k = 0,      π_{k+1} = ∂𝕊/∂z_{k+1},                          (of one slab, over ΔV)
///
/// and π_k is, for each field by itself and in this order:
///
/// | π_k of a field f                  | where |
/// |-----------------------------------|-------------------------------------------------------------------------------|
/// | G(z_k)                            | ∂𝕊/∂z_1 - ∂𝕊/∂z_0 = G(z_0) + G(z_1): the one-step form, whose solutions are
/// those of the two-step form without its parasite (theory, section 2.1) | | -∂𝕊/∂z_k, its row is that of k+1  |
/// ∂𝕊/∂z_k reads no upper level: a constraint of each level, steps being equal   | | ∂𝕊/∂z_k of the slab before | that
/// reads its upper level alone                                              | | m v_k                             | v
/// is the field that M couples with f alone, and the action does not name it  | | kept from step to step            |
/// otherwise: the two-step form                                                  |
///
/// Where the one-step rows of all fields are means of the equation R of the cells around a node (cell_equations), and
/// every number of cells is odd, the rows are R: averages have an inverse there, and rounding does not meet it twice.
///
/// Fields that the action does not name follow: v = π/m, and w of any row Σ_a K_a δ_a z = c w + b by one-sided
/// differences, forward where K₊ has the entry. Fields that live in the slab have the row ∂𝕊/∂z = 0.
class ActionRows {
public:
  struct Row {
    int field = 0;
    formula::Expression row;           ///< 0 for a step
    formula::Expression lower, upper;  ///< ∂𝕊/∂z_f/ΔV at the two levels
    formula::Expression momentum;      ///< π of the lower level's fields; invalid: kept
    int kept = -1;                     ///< the number of a momentum that is kept
    int momentum_field = -1;           ///< the field v that π is a multiple of
    bool in_slab = false, is_one_step = false;
  };
  struct Derived {
    int field = 0;
    formula::Expression value;  ///< at the upper level
    std::size_t turn = 0;       ///< after those of the turns before, which it reads
  };

  /// \param two_step keep all momenta that the one-step form has as G
  /// \throws std::invalid_argument naming a field that the action neither names nor gives, or by whose values the
  /// variation is not defined at any of the values tried
  ActionRows(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated,
             bool two_step = false);

  [[nodiscard]] const MultisymplecticSystem& system() const { return system_; }
  [[nodiscard]] const grids::Grid& grid() const { return grid_; }
  [[nodiscard]] NodeVariation& variation() { return variation_; }
  [[nodiscard]] const NodeVariation& variation() const { return variation_; }
  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }
  [[nodiscard]] const std::vector<Derived>& derived() const { return derived_; }
  [[nodiscard]] int kept() const { return kept_; }
  [[nodiscard]] bool has_late_rows() const { return has_late_rows_; }
  /// True if one level is enough to begin from with the accuracy of the steps: no momentum is kept, and where one is a
  /// field the action is the same backward in time.
  [[nodiscard]] bool begins_from_one_level() const { return kept_ == 0 && !(has_momentum_fields_ && !symmetric_); }
  [[nodiscard]] bool is_symmetric() const { return symmetric_; }  ///< 𝕊 of a step is minus that of the step back
  [[nodiscard]] bool has_one_step_form() const { return has_one_step_form_; }
  [[nodiscard]] bool has_momentum_fields() const { return has_momentum_fields_; }
  /// True if the action names every field that levels have.
  [[nodiscard]] bool names_all() const { return derived_.empty(); }

  /// A row ∂𝕊/∂z_k + π_k where both levels are the lower one.
  [[nodiscard]] formula::Expression at_rest(const Row& row);

  /// Arrays beside the fields, in this order: kept momenta; a direction at the lower level, one value for each field;
  /// the same at the upper level.
  ///@{
  [[nodiscard]] formula::Expression kept_momentum(int number) { return variation_.other(number); }
  [[nodiscard]] int lower_direction(int field) const { return kept_ + field; }
  [[nodiscard]] int upper_direction(int field) const { return kept_ + system_.field_count() + field; }
  ///@}
  /// The derivative of a formula along the directions of the fields at the lower level, the upper one, or both.
  ///@{
  [[nodiscard]] formula::Expression along_lower(formula::Expression formula) { return along(formula, true, false); }
  [[nodiscard]] formula::Expression along_upper(formula::Expression formula) { return along(formula, false, true); }
  [[nodiscard]] formula::Expression along_both(formula::Expression formula) { return along(formula, true, true); }
  ///@}
  /// Lets code read the slab from `before` to `after` and the arrays beside the fields.
  void read(NodeCode& code, const grids::FieldSet& before, const grids::FieldSet& after, double h,
            const PotentialSlopes& slopes, std::initializer_list<const grids::FieldSet*> others) const {
    variation_.read(code, before, after, h, slopes, others);
  }
  [[nodiscard]] formula::Expression step() const { return variation_.step(); }
  /// ∂formula/∂h.
  [[nodiscard]] formula::Expression by_step(formula::Expression formula) {
    return formula::derivative(formula, variation_.step());
  }
  /// The variables of a formula that are values of fields at the upper level, or of fields in the slab.
  [[nodiscard]] std::vector<NodeInput> upper_inputs(formula::Expression formula) const;
  /// A formula with the upper level in the lower one's place, or the other way round.
  ///@{
  [[nodiscard]] formula::Expression raised(formula::Expression formula);
  [[nodiscard]] formula::Expression lowered(formula::Expression formula);
  ///@}
  /// Values of formulas at a place: of(input) for each of their variables.
  [[nodiscard]] std::vector<double> values(std::span<const formula::Expression> formulas,
                                           const std::function<double(const NodeInput&)>& of) const;

  /// Values at which rows are looked at: z_f at random in centres[f] ± width, and other inputs in 0.7 ± width.
  struct Probe {
    std::vector<double> centres;
    double width = 0.5;
    [[nodiscard]] bool is_narrow() const { return width < 0.5; }
    [[nodiscard]] double draw(std::mt19937_64& random, int field = -1) const {
      const double centre = field < 0 ? 0.7 : centres[static_cast<std::size_t>(field)];
      return std::uniform_real_distribution<double>(centre - width, centre + width)(random);
    }
  };
  /// Those of some at which all rows are defined, at least one; h is as large as the others are there.
  [[nodiscard]] const std::vector<Probe>& probes() const { return probes_; }

private:
  void find_probes(const StatedAction& stated);
  [[nodiscard]] formula::Expression along(formula::Expression formula, bool lower, bool upper);
  [[nodiscard]] bool is_in_slab(int field) const { return system_.structure().at_midpoints(field); }
  [[nodiscard]] bool reads_upper(formula::Expression formula) const { return !upper_inputs(formula).empty(); }
  [[nodiscard]] bool reads_lower(formula::Expression formula) const;
  [[nodiscard]] bool has_level_momentum(const Row& row) const;
  [[nodiscard]] std::optional<int> momentum_field(const StatedAction& stated, int field) const;
  void find_momentum(const StatedAction& stated, bool two_step, Row& row);
  void factor(std::span<const formula::Expression> equations);
  void find_derived(const StatedAction& stated);
  [[nodiscard]] std::optional<Derived> difference_field(const std::vector<bool>& known, int row);

  MultisymplecticSystem system_;
  grids::Grid grid_;
  NodeVariation variation_;
  std::vector<Row> rows_;
  std::vector<Derived> derived_;
  std::vector<Probe> probes_;
  int kept_ = 0;
  bool has_late_rows_ = false, has_momentum_fields_ = false, has_one_step_form_ = false, symmetric_ = false;
};

}  // namespace rubato
