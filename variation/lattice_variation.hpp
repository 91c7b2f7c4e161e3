#pragma once

#include <memory>
#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/variation/lattice_action.hpp>
#include <rubato/variation/potential_slopes.hpp>

namespace rubato {

/// The total variation of a lattice's action over one slab (theory, section 2): what LatticeAction states is varied
/// here, once for all schemes, in one to three dimensions.
///
/// | vary                     | gives                                                            | here              |
/// |--------------------------|------------------------------------------------------------------|-------------------|
/// | the values at a node     | discrete Euler–Lagrange equation: the sum over both slabs is 0   | values()          |
/// | the time of a level      | discrete energy E_k = -∂𝕊/∂h; the law is E_k = E_{k-1}           | energy()          |
/// | t or x of one node       | local laws of energy and momentum, the sum over both slabs       | coordinates()     |
/// | anything at a level      | boundary one-forms, and the two-form Ω of two tangent solutions  | two_form()        |
///
/// A slab's part at its lower level is distinguished from that at its upper level: at a level between two slabs the
/// variation is the upper part of the slab before it plus the lower part of the slab after it.
///
/// Currents of energy and momentum: with L = V + Σ_μ Q^μ_μ as in LatticeAction, for each of its parts, F_ρν = D_ρ x^ν
/// and P_ρ = ∂V/∂(D_ρ z),
///
///     J^ν_ρ := -∂(L of a cell)/∂F_ρν at F = I  =  P_ρ·D_ν z + Q^ρ_ν - δ_ρν L,
///
/// so that the variation by the place x^ν of a node is -Σ_ρ D_ρᵀ h ΔV J^ν_ρ + Σ_o L_oᵀ h ΔV ∂L/∂(L_o x^ν): theory's e,
/// f, m, g are J^t_t, J^t_x, J^x_t, J^x_x, and the last sum is the source where L names x.
class LatticeVariation {
public:
  /// One row of values for each quantity at the nodes of both levels of the slab: what it gives at t_k and at t_{k+1}.
  struct Parts {
    grids::FieldSet before, after;

    Parts(int rows, std::size_t nodes) : before(rows, nodes), after(rows, nodes) {}
  };

  /// \throws std::invalid_argument if the dimensions of action and grid differ
  LatticeVariation(LatticeAction action, const grids::Grid& grid);
  ~LatticeVariation();
  LatticeVariation(LatticeVariation&&) noexcept;
  LatticeVariation& operator=(LatticeVariation&&) noexcept;

  [[nodiscard]] const LatticeAction& action() const;

  /// Reads the slab from `before` to `after`, h apart: everything below is of this slab, and is computed when it is
  /// asked for: until then the fields that the action names have to stay as they are. Of potentials, which are slope·x
  /// + periodic, the fields hold the periodic part.
  void take(const grids::FieldSet& before, const grids::FieldSet& after, double h, const PotentialSlopes& slopes = {});
  void take(const grids::FieldSet&&, const grids::FieldSet&, double, const PotentialSlopes& = {}) = delete;
  void take(const grids::FieldSet&, const grids::FieldSet&&, double, const PotentialSlopes& = {}) = delete;
  void take(const grids::FieldSet&&, const grids::FieldSet&&, double, const PotentialSlopes& = {}) = delete;

  /// 𝕊 of the slab.
  [[nodiscard]] double action_value();
  /// E = -∂𝕊/∂h.
  [[nodiscard]] double energy();
  /// ∂𝕊/∂z_f(node), row f.
  void values(Parts& out);
  /// ∂𝕊/∂x^ν(node), row ν, 0 for time.
  void coordinates(Parts& out);
  /// J^ν_ρ in every cell in field ν·(1 + dimensions) + ρ, the sum over the parts of L. Stays until the next take().
  [[nodiscard]] const grids::FieldSet& currents();
  /// ∂L/∂x^ν in every cell where L reads a coordinate, into out.field(ν); 0 in the other rows.
  void sources(grids::FieldSet& out);

  /// The variation of values() along u, a variation of the values at frozen levels: row f.
  void tangent(const Parts& u, Parts& out);
  /// Ω(U, V) at the nodes, Uᵀδ_V(∂𝕊/∂z) - Vᵀδ_U(∂𝕊/∂z), in row 0. Over both levels it sums to 0 for any U and V (the
  /// second variation is symmetric), and at a node between two slabs for solutions U, V of the linearised equation: the
  /// multisymplectic law.
  void two_form(const Parts& u, const Parts& v, Parts& out);

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato
