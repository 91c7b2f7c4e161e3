#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/point_interpolation.hpp>
#include <rubato/pde/initial_level.hpp>

namespace rubato {

/// Formulas evaluated at the nodes of a lattice: initial data, exact solutions, densities of invariants.
///
/// The variables of the formulas' graph are understood by their names: a name of `fields`; an axis of the grid; `t`;
/// and dx(f), dy(f), dz(f) (nested as dx(dy(f))) for spectral derivatives of a field, to which a potential's slope is
/// added; and names of `numbers`, which are the same at every node.
class NodeFormula {
public:
  /// \throws std::invalid_argument for a variable that is none of these
  NodeFormula(std::shared_ptr<const formula::Graph> graph, std::vector<formula::Expression> outputs,
              std::vector<std::string> fields, const grids::Grid& grid, std::vector<std::string> numbers = {});
  ~NodeFormula();
  NodeFormula(NodeFormula&&) noexcept;
  NodeFormula& operator=(NodeFormula&&) noexcept;

  /// The values of each formula at every node. `values` holds one array for each of `fields` (null where no formula
  /// needs it).
  [[nodiscard]] std::vector<std::vector<double>> operator()(std::span<const double* const> values, double t,
                                                            const PotentialSlopes& slopes = {},
                                                            std::span<const double> numbers = {});
  /// At a level of a system whose fields these are.
  [[nodiscard]] std::vector<std::vector<double>> operator()(const LatticeLevel& level, double t,
                                                            std::span<const double> numbers = {});
  /// The value of each formula at one point: fields and their derivatives are interpolated there spectrally, x, y and z
  /// are its coordinates.
  [[nodiscard]] std::vector<double> at_point(const LatticeLevel& level, double t,
                                             const grids::PointInterpolation& point,
                                             std::span<const double> numbers = {});
  /// Σ ΔV of each formula over the nodes.
  [[nodiscard]] std::vector<double> integrals(const LatticeLevel& level, double t);

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato
