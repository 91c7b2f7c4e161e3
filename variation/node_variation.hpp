#pragma once

#include <array>
#include <initializer_list>
#include <map>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/variation/lattice_action.hpp>
#include <rubato/variation/level_values.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// The variation of an action at one node as formulas of the node and its neighbours, for schemes that solve a row of
/// the discrete Euler–Lagrange equation by formulas, too: what LatticeVariation computes in passes over the lattice is
/// here one formula, in which what cells have in common is computed once. For stencils of box operators; those with a
/// spectral derivative read all nodes.
///
/// With 𝕊 = h ΔV Σ L, where ΔV is the volume of a cell:
///
/// | formula          | of                                                                                   |
/// |------------------|--------------------------------------------------------------------------------------|
/// | values(level, f) | ∂𝕊/∂z_f(node)/ΔV at one of the two levels of the slab                                |
/// | at_rest(f)       | momentum + h force = ∂𝕊/∂z_f(node)/ΔV at the lower level if both are the upper level |
/// | energy()         | -∂𝕊/∂h/ΔV, the part of a cell                                                        |
/// | currents(part)   | J^ν_ρ in a cell, what the variation of places is made of (CoordinateVariation)       |
class NodeVariation {
public:
  enum class Level { before, after };

  /// \throws std::invalid_argument if the dimensions of action and grid differ, or the stencil has a spectral
  /// derivative
  NodeVariation(LatticeAction action, const grids::Grid& grid);

  [[nodiscard]] formula::Expression values(Level level, int field);
  struct AtRest {
    formula::Expression momentum, force;  ///< both without h
  };
  [[nodiscard]] AtRest at_rest(int field);
  [[nodiscard]] formula::Expression energy();
  /// The same of a slab of no length at the upper level, in which every field moves at the rate that its momentum
  /// there, ∂𝕊/∂z_f(node)/ΔV = momenta[f], says, as the action's own node alone has it. Invalid where the action names
  /// h, or a momentum is not linear in its rate, and in that alone.
  /// \param first_spare of so many arrays beside the fields as there are fields, which nothing is read of
  [[nodiscard]] formula::Expression energy_of_level(std::span<const formula::Expression> momenta, int first_spare);

  /// A formula at a node so much further.
  [[nodiscard]] formula::Expression at_node(formula::Expression formula, const std::array<int, 3>& further);
  /// A formula of which the sum over all nodes is wanted alone: its terms, each at the place where its first node is
  /// the node itself, and each once. Σ formula = Σ (of_slab + of_lower + of_upper).
  struct Summed {
    formula::Expression of_slab;   ///< reads both levels, or h
    formula::Expression of_lower;  ///< of the lower level alone, as a formula of the upper one
    formula::Expression of_upper;  ///< of the upper level alone, or of none
  };
  [[nodiscard]] Summed in_sum(formula::Expression formula);
  /// The same formula, of which each term counts where it is between walls: see NodeFormulas.
  [[nodiscard]] formula::Expression between_walls(formula::Expression formula) {
    return formulas_.between_walls(formula);
  }
  /// ∂𝕊/∂z_f(node)/ΔV at one of the two levels, of the terms of L between walls alone.
  [[nodiscard]] formula::Expression values_between_walls(Level level, int field);
  [[nodiscard]] formula::Expression along_axis(const PlaceNumbers& numbers) { return formulas_.along_axis(numbers); }

  /// In the cell of the node, or one so far from it: J^ν_ρ of a part, as LatticeAction::currents() orders them;
  /// ∂L/∂(L_o x^ν).
  ///@{
  [[nodiscard]] std::vector<formula::Expression> currents(const LatticeAction::Part& part,
                                                          std::array<int, 3> cell = {});
  [[nodiscard]] formula::Expression by_place(const LatticeAction::Place& place, std::array<int, 3> cell = {});
  ///@}
  /// A formula of the action's variables in the cell of the node, or one so far from it.
  [[nodiscard]] formula::Expression in_cell(formula::Expression formula, std::array<int, 3> cell = {}) {
    return in_nodes(std::array{formula}, cell, Motion::between_levels).front();
  }
  [[nodiscard]] const LatticeAction& action() const { return action_; }

  /// What formulas are made of: z_f at a node that is so far from this one; a difference of z_f there along an axis, of
  /// potentials their slope as well; and h.
  ///@{
  [[nodiscard]] formula::Expression node(Level level, int field, std::array<int, 3> offset = {}) {
    return formulas_.node(array_of(level, field), offset);
  }
  [[nodiscard]] formula::Expression difference(Level level, int field, int axis, bool forward);
  [[nodiscard]] formula::Expression step() const { return h_; }
  [[nodiscard]] formula::Expression rate() const { return rate_; }  ///< 1/h
  ///@}
  /// The first of the arrays beside the fields and the places of nodes; and δ_a⁺ of one of these.
  ///@{
  [[nodiscard]] int first_other() const { return 2 * action_.fields + places_.fields(); }
  [[nodiscard]] formula::Expression difference_of_other(int array, int axis);
  ///@}
  [[nodiscard]] NodeFormulas::Weights weights(const grids::SpaceOperator& op) const { return formulas_.weights(op); }
  [[nodiscard]] formula::Graph& graph() { return formulas_.graph(); }
  /// A node's value of an array beside the fields, numbered from 0.
  [[nodiscard]] formula::Expression other(int array, std::array<int, 3> offset = {}) {
    return formulas_.node(first_other() + array, offset);
  }
  /// What formulas so far are made of. Fields of the lower level are the arrays from 0, of the upper one from fields.
  [[nodiscard]] std::span<const NodeInput> inputs() const { return formulas_.inputs(); }
  /// Those of them that a formula depends on.
  [[nodiscard]] std::vector<NodeInput> inputs_of(formula::Expression formula) const {
    return formulas_.inputs_of(formula);
  }
  /// The number of h among the uniform ones.
  static constexpr int number_of_h = 0;
  /// Keeps what formulas have of one level alone, in arrays after so many others: see LevelValues.
  [[nodiscard]] LevelValues keep(int others, std::span<const formula::Expression> always,
                                 std::initializer_list<std::vector<formula::Expression>*> formulas);
  /// The same of the lower level: see the second form of LevelValues.
  [[nodiscard]] LevelValues keep_of_lower(int others, std::vector<formula::Expression>& formulas);

  /// Such formulas as code.
  [[nodiscard]] NodeCode code(std::span<const formula::Expression> outputs) const { return formulas_.code(outputs); }
  /// Lets code read the slab from `before` to `after`, h apart, and other arrays, all of which have to stay there.
  void read(NodeCode& code, const grids::FieldSet& before, const grids::FieldSet& after, double h,
            const PotentialSlopes& slopes, std::initializer_list<const grids::FieldSet*> others = {}) const;

private:
  using Offset = std::array<int, 3>;
  enum class Motion { between_levels, none, at_rates };

  [[nodiscard]] int array_of(Level level, int field) const;
  [[nodiscard]] formula::Expression in_space(Level level, int field, const grids::SpaceOperator& op, Offset cell,
                                             bool with_slope);
  [[nodiscard]] formula::Expression value(const LatticeAction::Value& value, Offset cell, Motion motion);
  [[nodiscard]] formula::Expression place(std::size_t number, Offset cell);
  [[nodiscard]] std::vector<formula::Expression> in_nodes(std::span<const formula::Expression> formulas, Offset cell,
                                                          Motion motion);
  [[nodiscard]] std::span<const formula::Expression> derivatives_in(Offset cell, Motion motion);
  /// Of differences in time, and of all else without h.
  [[nodiscard]] AtRest parts(Level level, int field, Motion motion);

  LatticeAction action_;
  NodeFormulas formulas_;
  formula::Expression h_, rate_;                  ///< h and 1/h
  std::vector<formula::Expression> derivatives_;  ///< ∂L/∂(L_o z), in the variables of the action
  std::map<std::tuple<Offset, Motion>, std::vector<formula::Expression>> in_cells_;
  grids::FieldSet places_;
  int first_rate_ = 0;  ///< of the arrays beside the fields, for Motion::at_rates
};

}  // namespace rubato
