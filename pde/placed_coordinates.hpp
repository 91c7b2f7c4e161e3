#pragma once

#include <span>
#include <vector>

#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// Where in a cell S is evaluated along one axis, as grids::coordinate() has it.
struct Within {
  static constexpr grids::Along node = grids::Along::identity;   ///< at the lower node
  static constexpr grids::Along centre = grids::Along::average;  ///< in the middle between two nodes
  static constexpr grids::Along next = grids::Along::next;       ///< at the upper node
};

/// The coordinates that S(z, x) names, at the places where a scheme evaluates S: the inputs of the system's codes that
/// follow the fields. One array of all cells for each; none where S names no coordinate.
class PlacedCoordinates {
public:
  PlacedCoordinates() = default;
  PlacedCoordinates(const MultisymplecticSystem& system, const grids::Grid& grid, const grids::BoxOperator& place);
  /// At the same place along all axes.
  PlacedCoordinates(const MultisymplecticSystem& system, const grids::Grid& grid, grids::Along place)
      : PlacedCoordinates(system, grid, grids::BoxOperator{place, place, place}) {}
  /// On a line, at these places.
  PlacedCoordinates(const MultisymplecticSystem& system, std::span<const double> along_x);

  [[nodiscard]] std::size_t count() const { return static_cast<std::size_t>(values_.fields()); }
  /// From cell `begin` on, into `inputs`, which holds count() pointers.
  void put(std::size_t begin, std::span<const double*> inputs) const {
    for (std::size_t c = 0; c < inputs.size(); ++c) {
      inputs[c] = values_.field(static_cast<int>(c)).data() + begin;
    }
  }
  /// Pointers to fields, all cells of them, with the coordinates appended; into `inputs`, which keeps its memory.
  ///@{
  [[nodiscard]] std::vector<const double*> after(std::span<const double* const> fields) const;
  std::span<const double* const> after(std::span<const double* const> fields, std::vector<const double*>& inputs) const;
  ///@}
  /// One field for each coordinate.
  [[nodiscard]] const grids::FieldSet& values() const { return values_; }
  [[nodiscard]] double value(std::size_t coordinate, std::size_t cell) const {
    return values_.field(static_cast<int>(coordinate))[cell];
  }

private:
  grids::FieldSet values_;
};

}  // namespace rubato
