#pragma once

#include <optional>
#include <string>
#include <vector>

#include <rubato/pde/moving_frame.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/nodal_view.hpp>
#include <rubato/pde/node_formula.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// The grid of a problem; of a thread that has a slab its part.
[[nodiscard]] grids::Grid present_grid(const Problem& problem);

/// A quantity of a lattice that is reported at a time: a number, or one for each node.
class LatticeQuantity {
public:
  /// \throws ProblemError for fields that exist in the middle of steps only
  LatticeQuantity(const Problem& problem, const OutputQuantity& quantity, const MultisymplecticSystem& system,
                  const grids::Grid& grid);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] bool is_field() const { return is_field_; }
  /// \param level of the frame, where there is one; the quantity is of the laboratory
  [[nodiscard]] std::vector<double> at(const LatticeLevel& level, double t);

private:
  std::string name_;
  bool is_field_ = false;
  std::optional<NodeFormula> integrands_, value_;
  std::optional<grids::PointInterpolation> point_;
  std::optional<LaboratoryView> laboratory_;
  std::optional<NodalView> nodal_;  ///< where the formula names fields between nodes
};

}  // namespace rubato
