#pragma once

#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>

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
  /// Between walls, where the last node's cell is none: its equations are last_left c_N + last_right c_0 = r instead.
  Eigen::MatrixXd last_left, last_right;

  [[nodiscard]] int size() const { return static_cast<int>(mean.rows()); }
};

/// What makes a system with a kernel of constant vectors solvable: an unknown y_b times column b of `columns` is added
/// to the equations of every cell, and the mean over the nodes of Σ_f pins(b, f) c_f is to be 0. In more than one
/// dimension a kernel vector that no C_a of a direction sees may vary in that direction: then y_b is one unknown for
/// each line of cells, and the mean over each line is held.
struct KernelConditions {
  Eigen::MatrixXd pins;     ///< conditions × unknowns
  Eigen::MatrixXd columns;  ///< equations × conditions
  Eigen::MatrixXd kernel;   ///< unknowns × conditions: the constant vectors c with Bc = 0, entries included
  Eigen::MatrixXd left;     ///< equations × conditions: those with lᵀB = 0

  [[nodiscard]] int count() const { return static_cast<int>(pins.rows()); }
};

/// Solves systems of one shape.
class CellSolver {
public:
  virtual ~CellSolver() = default;
  /// rhs: one array for each equation; solution: one for each unknown, not overlapping rhs. `y` receives the unknowns
  /// of the conditions, y[b·lines + line], lines = n_y n_z. On a slab (grids::Slab) all ranks solve, and find the
  /// solution at the nodes that they own; in ghosts as well where finds_ghosts().
  [[nodiscard]] virtual Status solve(const CellMatrix& matrix, const KernelConditions& conditions,
                                     std::span<const double* const> rhs, std::span<double* const> solution,
                                     std::span<double> y) = 0;
  [[nodiscard]] virtual bool finds_ghosts() const { return false; }
  /// Forgets what was kept from the last solves, so that the next ones do not depend on them.
  virtual void forget() {}
  /// True if the next solves look at their residuals themselves (as they do at first), or leave that to the caller.
  virtual void check_residuals(bool) {}
  /// The relative error that the next solutions may have; a direct solver has that of rounding in any case.
  virtual void set_tolerance(double) {}
  /// About the relative error of the last solution, 0 where it is that of rounding.
  [[nodiscard]] virtual double error() const { return 0.0; }
};

/// What Newton's method needs of a linear solve: its next correction squares the error, so no more than that.
inline constexpr double newton_tolerance = 1e-9;

/// For the box in one dimension cyclic block elimination, O(cells); in more, and at nodes, by the inverse of the matrix
/// with the entries' means, block by block in Fourier space, and GMRES for what the entries differ from their means
/// where that is not small, to the relative error `tolerance`; where residuals are checked, to that residual.
[[nodiscard]] std::unique_ptr<CellSolver> make_cell_solver(const grids::Grid& grid, Collocation collocation, int size,
                                                           int conditions, double tolerance);
[[nodiscard]] std::unique_ptr<CellSolver> make_cyclic_cell_solver(const grids::Grid& grid, int size, int conditions);
[[nodiscard]] std::unique_ptr<CellSolver> make_gmres_cell_solver(const grids::Grid& grid, Collocation collocation,
                                                                 int size, double tolerance);

}  // namespace rubato
