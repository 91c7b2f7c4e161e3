#pragma once

#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/outcome.hpp>
#include <rubato/grids/grid.hpp>

namespace rubato {

/// A square linear system on a lattice, one block of equations for each cell, one of unknowns for each node:
///
///     B A c + Σ_a C_a D_a c + Σ_e values_e(cell) (row_e, column_e) A c = r,
///
/// A and D_a as the discretisation has them. The Jacobian of a step is one, B = (2/h)M - (S'')_constant, C_a = K_a, and
/// so is that of the constraints of a level.
struct CellMatrix {
  struct Entry {
    int row = 0;
    int column = 0;
    double factor = 1.0;
    const double* values = nullptr;  ///< one for each cell
  };
  Eigen::MatrixXd mean;                     ///< B
  std::vector<Eigen::MatrixXd> difference;  ///< C_a
  std::vector<Entry> entries;

  [[nodiscard]] int size() const { return static_cast<int>(mean.rows()); }
};

/// The conditions that make a system with a kernel of constant vectors solvable: column b of `columns` times an unknown
/// y_b is added to the equations of every cell, and the mean over all nodes of Σ_f pins(b, f) c_f is to be 0.
struct KernelConditions {
  Eigen::MatrixXd pins;     ///< conditions × unknowns
  Eigen::MatrixXd columns;  ///< equations × conditions

  [[nodiscard]] int count() const { return static_cast<int>(pins.rows()); }
};

/// Solves systems of one shape.
class CellSolver {
public:
  virtual ~CellSolver() = default;
  /// rhs: one array for each equation; solution: one for each unknown, not overlapping rhs. `y` receives the unknowns
  /// of the conditions.
  [[nodiscard]] virtual Status solve(const CellMatrix& matrix, const KernelConditions& conditions,
                                     std::span<const double* const> rhs, std::span<double* const> solution,
                                     std::span<double> y) = 0;
};

/// The box in one dimension: cyclic block elimination, O(cells).
[[nodiscard]] std::unique_ptr<CellSolver> make_cyclic_cell_solver(const grids::Grid& grid, int size, int conditions);

}  // namespace rubato
