#pragma once

#include <memory>
#include <string>
#include <vector>

#include <rubato/formula/expression.hpp>
#include <rubato/variation/lattice_action.hpp>

namespace rubato {

/// A density L that reads the values at the corners of one cell of a slab: the action is Σ h ΔV L over the cells.
///
/// Corners are numbered by their bits: bit a is set at the upper node along axis a, bit `dimensions` at the upper
/// level. So are they named: FIELD_01 is the field at the lower level and the upper node, in the plane FIELD_001 with
/// level, y, x.
struct CornerDensity {
  std::shared_ptr<formula::Graph> graph;
  int fields = 0;
  int dimensions = 0;
  std::vector<formula::Expression> corners;   ///< variables: field·2^(1 + dimensions) + corner
  std::vector<formula::Expression> spacings;  ///< h, dx, dy, dz
  std::vector<formula::Expression> places;    ///< x, y, z of the lower node
  formula::Expression L;

  [[nodiscard]] int corner_count() const { return 2 << dimensions; }
  [[nodiscard]] formula::Expression corner(int field, int number) const {
    return corners[static_cast<std::size_t>(field * corner_count() + number)];
  }
  /// True if L names a corner of the field.
  [[nodiscard]] bool names(int field) const;
  /// True if L names the place along the axis.
  [[nodiscard]] bool names_place(int axis) const;
  /// True if L depends on the corners of a field at one level only by their sums with those at the other: then a value
  /// in the middle of the step takes the place of both.
  [[nodiscard]] bool reads_middle(int field) const;
  /// True if -∂(hL)/∂h, or no row of the variation by a field's lower corners, joins two levels: no length of the next
  /// step can be solved for.
  [[nodiscard]] bool energy_reads_one_level() const;
};

/// The equation of a cell, R_f = ∂L/∂z̄_f - Σ_ρ C_ρ D_ρ z for each field, where L reads the means z̄ of the corners and
/// their mean differences D_ρ z alone and ∂L/∂(D_ρ z) = C_ρ z̄ with constants C_ρ: then the variation by the values of a
/// node is the mean of R over the cells around it, up to a factor, as for the box. Empty for other densities.
[[nodiscard]] std::vector<formula::Expression> cell_equations(const CornerDensity& density);

/// The suffix of a corner: "00", "01", … as FIELD_00.
[[nodiscard]] std::string corner_suffix(int number, int dimensions);
/// The names of an L: FIELD_00 … of every field in the order of CornerDensity::corners, then h, dx, …, then x, ….
[[nodiscard]] std::vector<std::string> corner_names(const std::vector<std::string>& fields, int dimensions);
/// A density with variables of these names, without its L.
[[nodiscard]] CornerDensity corner_variables(const std::vector<std::string>& fields, int dimensions);

/// The action that a density states. Currents are those of cells with D_ρ z the mean differences of their corners:
/// J^ν_ν = -∂(h ΔV L)/∂H_ν / (ΔV h/H_ν) with H_t = h, H_x = Δx, …, and J^ν_ρ = ∂L/∂(D_ρ z)·D_ν z for ν ≠ ρ.
/// \param at_midpoints fields that live in the slab, each corner at both levels the same value
/// \param potential fields that may have a slope
[[nodiscard]] LatticeAction corner_action(const CornerDensity& density, const std::vector<bool>& at_midpoints,
                                          const std::vector<bool>& potential);

}  // namespace rubato
