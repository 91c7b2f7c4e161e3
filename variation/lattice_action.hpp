#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/stencil.hpp>

namespace rubato {

/// True if a formula is the constant 0: a term that need not be computed.
[[nodiscard]] inline bool is_zero(const formula::Expression& e) {
  return e.is_constant() && e.constant_value() == 0.0;
}

/// What a stencil does in time, over the slab between two levels.
enum class InTime {
  before,      ///< z_k
  after,       ///< z_{k+1}
  mean,        ///< (z_k + z_{k+1})/2
  difference,  ///< (z_{k+1} - z_k)/h
};

/// One operator of a stencil: from the values on the two levels of a slab to one number in each cell.
struct StencilOperator {
  InTime time = InTime::mean;
  grids::SpaceOperator space;

  bool operator==(const StencilOperator&) const = default;
};

/// The discrete action of a lattice (theory, sections 2 and 5; the paper's (5.1)–(5.5) carried out): a sum over the
/// cells of the slabs between levels,
///
///     𝕊 = Σ_slabs Σ_cells h ΔV L(L_o z),
///
/// of a density L that reads the fields through the operators L_o of a stencil. This is all that a scheme states:
/// values, levels, places and boundaries are varied by LatticeVariation.
///
/// L may read the coordinates of its cells besides, through operators as well: L_o x^ν, for media that are not the same
/// everywhere.
///
/// Among the operators are the differences D_ρ, ρ = t, x, y, z, that act on the nodes' coordinates, too. Where nodes
/// move, F_ρν = D_ρ x^ν is no longer the unit matrix, and derivatives become F⁻¹D: so are the coordinates varied. L is
/// a sum of parts, each with differences of its own (the triangles around a node, say), and a part has two kinds of
/// terms,
///
///     L = V(L_o z, D_ρ z) + Σ_μ Q^μ_μ,
///
/// of which V becomes det F · V(L_o z, F⁻¹Dz), and Q^μ_ρ, linear in differences along ρ as zᵀΛ_μ D_ρ z is, becomes
/// Σ_ρ det F (F⁻¹)_μρ Q^μ_ρ. (A product rule moves a difference within Q^μ_ρ without leaving its direction ρ, so that
/// this kind states what a function of D_ρ z alone does not.)
struct LatticeAction {
  /// A variable of L that stands for L_o z_f in a cell.
  struct Value {
    int field = 0;
    int op = 0;  ///< which of `operators`
    formula::Expression variable;
  };

  /// A variable of L that stands for L_o x^ν in a cell.
  struct Place {
    int axis = 0;  ///< 0 for x
    int op = 0;
    formula::Expression variable;
  };

  /// Q^μ_ρ for one μ, ρ = 0 … dimensions.
  struct OneForm {
    int mu = 0;
    std::vector<formula::Expression> along;
  };

  struct Part {
    std::vector<int> derivatives;  ///< D_ρ as numbers of `operators`: time, then the directions of space
    formula::Expression density;   ///< V
    std::vector<OneForm> forms;    ///< Q^μ; there may be several for one μ
    /// J^ν_ρ, ν·(1 + dimensions) + ρ, where they are stated and not derived from density and forms.
    std::vector<formula::Expression> currents;
  };

  std::shared_ptr<formula::Graph> graph;
  int fields = 0;
  int dimensions = 0;  ///< of space
  std::vector<Part> parts;
  /// Fields that live in the slab, not on its levels (multipliers, whose value no level determines): every operator in
  /// time gives that value. They are read from the upper level's fields, and varied with them.
  std::vector<bool> at_midpoints;
  std::vector<StencilOperator> operators;
  std::vector<Value> values;  ///< all that `value` of the builder was asked for
  std::vector<Place> places;  ///< all that `place` of the builder was asked for
  /// Variables of L that stand for h, Δx, Δy, Δz; empty where it names none. Then -∂(hL)/∂h is the energy of a cell.
  std::vector<formula::Expression> spacings;
  /// Fields whose value at the next node along x counts from this one, with a slope on the way; empty: none.
  std::vector<bool> potential;

  /// Σ_parts V + Σ_μ Q^μ_μ, on a rectangle.
  [[nodiscard]] formula::Expression lagrangian() const;
  /// J^ν_ρ = P_ρ·D_ν z + Q^ρ_ν - δ_ρν L of a part (LatticeVariation), ν·(1 + dimensions) + ρ; in J^ρ_ρ the terms Q^ρ_ρ
  /// cancel and are left out.
  [[nodiscard]] std::vector<formula::Expression> currents(const Part& part) const;
  /// J^t_t of all parts: -∂𝕊/∂h of a cell over its volume.
  [[nodiscard]] formula::Expression energy() const;
  /// L_o x^ν in every cell: its neighbours are where they are, not across the seam.
  void find_place(const Place& place, const grids::Grid& grid, std::span<double> out) const;

private:
  [[nodiscard]] std::size_t index_of(int field, int op) const;
  [[nodiscard]] formula::Expression current(const Part& part, std::span<const formula::Expression> first, int nu,
                                            int rho) const;
};

/// Makes the variables of a LatticeAction, so that the density is stated as a formula of them.
class LatticeActionBuilder {
public:
  /// Fields are called by number.
  /// \throws std::invalid_argument unless there are fields and 1 to 3 dimensions
  LatticeActionBuilder(int fields, int dimensions);

  [[nodiscard]] formula::Graph& graph() { return *action_.graph; }
  /// Adds an operator to the stencil, unless it is there. \return its number
  int add(const StencilOperator& op);
  /// Adds D_t, then D_x, … of the present part: one after the other. \return its number
  int add_derivative(const StencilOperator& op);
  /// Declares that a field lives in the slab.
  void set_at_midpoints(int field) { action_.at_midpoints[static_cast<std::size_t>(field)] = true; }
  /// L_o z_f.
  [[nodiscard]] formula::Expression value(int field, int op);
  /// D_ρ z_f, ρ = 0 for time.
  [[nodiscard]] formula::Expression derivative(int field, int rho) {
    return value(field, part_.derivatives.at(static_cast<std::size_t>(rho)));
  }
  /// L_o x^ν of the axis, 0 for x; the operator must be made of identities, averages and shifts.
  [[nodiscard]] formula::Expression place(int axis, int op);
  /// Adds Q^μ_ρ = along(ρ) for one μ.
  template <typename Along>
  void add_form(int mu, Along&& along) {
    LatticeAction::OneForm form{mu, {}};
    for (int rho = 0; rho <= action_.dimensions; ++rho) {
      form.along.push_back(along(rho));
    }
    part_.forms.push_back(std::move(form));
  }

  /// Ends a part of L and begins another.
  /// \throws std::invalid_argument unless there is a D_ρ for time and every direction of space
  void add_part(formula::Expression density);
  /// The action of all parts so far.
  [[nodiscard]] LatticeAction finish() { return std::move(action_); }
  /// The same after a last part.
  [[nodiscard]] LatticeAction finish(formula::Expression density) {
    add_part(density);
    return finish();
  }

private:
  LatticeAction action_;
  LatticeAction::Part part_;
};

}  // namespace rubato
