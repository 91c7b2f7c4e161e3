#pragma once

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/mirror_signs.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// The rows of a step of euler-box that give their field explicitly, and its energy, each as one formula of a node and
/// its neighbours. With R(z) = ∇S - Σ_a (K₊δ_a⁺ - K₊ᵀδ_a⁻) z:
///
///     kick:   z_c at the new level = z_c + h R_r(z)/M₊(r, c)                  where M₊ has the entry (r, c),
///     solve:  z_f at the new level = z_f - R_r(z')/(S''(r, f) + M₊(f, r)/h)   where S'' is constant there:
///
/// z' is the new level, in which z_f is still that of the old one, so that one correction is the solution. A field is
/// *derived* where its own row gives it from neighbours, S''(f, f) z_f = -R_f(z with z_f = 0): formulas have this in
/// its place, so that no step reads or writes it. On a grid with ghosts of walls, kicks and solves leave what walls
/// hold as it is, and of the energy the terms count that are between the walls.
class EulerBoxFormulas {
public:
  /// \param derived fields whose row is linear in the field alone, and differentiates none of them
  /// \throws SchemeRefusal if the grid has ghosts of walls, and the rows are not the same in a mirror
  EulerBoxFormulas(const MultisymplecticSystem& system, const grids::Grid& grid, std::vector<int> derived);

  [[nodiscard]] const std::vector<int>& derived() const { return derived_; }
  [[nodiscard]] NodeCode kick(int row, int column);
  [[nodiscard]] NodeCode solve(int row, int field);
  /// A constraint S''(r, f) z_f = -R_r(z with z_f = 0) with S'' constant, at the level `after`.
  [[nodiscard]] NodeCode constraint(int row, int field);
  /// Of the level `after`: the density of energy S - Σ_a zᵀK₊δ_a⁺z, and 0, which becomes NaN with a field that is not
  /// finite.
  [[nodiscard]] NodeCode energy();

  /// Lets code read two levels. \param factor h/M₊ of a kick, 1/(S'' + M₊/h) of a solve
  void read(NodeCode& code, double factor, const grids::FieldSet& before, const grids::FieldSet& after) const;

private:
  enum class Level { before, after };
  /// A field at a level, so many nodes further.
  using FieldAt = std::function<formula::Expression(int field, const std::array<int, 3>& offset)>;
  [[nodiscard]] FieldAt of(Level level);
  [[nodiscard]] formula::Expression difference(const FieldAt& z, int field, const grids::SpaceOperator& op);
  /// R of a row.
  [[nodiscard]] formula::Expression row(int number, const FieldAt& z);
  [[nodiscard]] formula::Expression constraint(int row, int field, const FieldAt& z);
  [[nodiscard]] formula::Expression in_place_of_fields(formula::Expression formula, const FieldAt& z);
  [[nodiscard]] bool is_derived(int field) const;
  void check_walls() const;
  /// A change of a field, 0 where a wall holds it.
  [[nodiscard]] formula::Expression where_loose(int field, formula::Expression change);

  MultisymplecticSystem system_;
  grids::Grid grid_;
  std::optional<FieldMirrors> mirrors_;  ///< of ghosts of walls
  NodeFormulas formulas_;
  std::vector<int> derived_;
  std::vector<formula::Expression> gradient_;  ///< ∇S
  grids::FieldSet coordinates_;
};

}  // namespace rubato
