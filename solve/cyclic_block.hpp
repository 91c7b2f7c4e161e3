#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include <rubato/base/status.hpp>

namespace rubato::grids {
class Slab;
}

namespace rubato::solve {

/// A matrix entry that varies from cell to cell: values[i] times `left` is added to entry (row, column) of L_i, times
/// `right` to that of R_i. Neither owns nor copies the values (one per cell).
struct CyclicEntry {
  int row = 0;
  int column = 0;
  double left = 1.0;
  double right = 1.0;
  const double* values = nullptr;
};

/// The cyclic block bidiagonal matrix of the box scheme: cell i couples its two nodes i and i + 1 (mod cells),
///
///     L_i z_i + R_i z_{i+1} = r_i,      L_i = left + Σ_e left_e values_e[i],   R_i = right + Σ_e right_e values_e[i].
///
/// `left` and `right` are the constant parts, block × block, row by row: for the box scheme M/h ∓ 2K/Δx up to a factor,
/// and the entries are those of S''(z̄_i) that are not constant. The last cell may have rows of its own, the conditions
/// at the two ends of a line: then its L and R are these, without the entries.
struct CyclicBidiagonal {
  int block = 0;
  std::size_t cells = 0;
  std::vector<double> left;
  std::vector<double> right;
  std::vector<CyclicEntry> entries = {};
  std::vector<double> last_left = {};  ///< empty where the last cell is as the others; not with a slab
  std::vector<double> last_right = {};

  [[nodiscard]] bool closes() const { return !last_left.empty(); }
};

/// constant + values[i] (values may be null).
struct CyclicCoefficient {
  double constant = 0.0;
  const double* values = nullptr;
};

/// Extra unknowns y and equations, `count` of each:
///
///     A z + B y = r,     C z + D y = s,
///
/// as they hold the mean of a potential or border a level equation on. B is columns[b·block + row] on cells, C is
/// rows[b·block + field] on nodes, D is corner[row·count + column]. A itself may be singular.
struct CyclicBorder {
  int count = 0;
  std::vector<CyclicCoefficient> columns;
  std::vector<CyclicCoefficient> rows;
  std::vector<double> corner;
};

/// Who looks at the residual of a solve.
enum class CyclicCheck {
  every_solve,
  /// The caller computes it, as Newton's method does at its next iterate anyway: saves a third of the time. Then
  /// neither refinement nor fallback happens unless the elimination breaks down, and values that are not finite are
  /// noticed only as far as they reach the last system (those of a matrix or right-hand side do).
  left_to_caller,
};

/// How a solve went.
struct CyclicOutcome {
  Status status = Status::success;
  double backward_error =
      0.0;  ///< the largest residual, relative to the size of its row and of the solution; 0 if left to the caller
  double rcond_estimate = 0.0;  ///< pivot ratio of the last, dense system: an order of magnitude
  bool refined = false;         ///< one step of iterative refinement was needed
  bool fallback = false;        ///< the general sparse LU was needed
};

/// Solves cyclic block bidiagonal systems in O(cells · block³) by orthogonal elimination.
///
/// The interior nodes of every chunk of about 16 cells are eliminated by Householder reflections of the 2·block rows
/// that hold them, which leaves a cyclic system of the same form with one row block per chunk; and so on, until one
/// node is left. All of it together is a QR factorisation of the matrix, hence backward stable whatever mixture of
/// growing and decaying modes the transfer matrices -R⁻¹L have; marching with them overflows. Chunks run side by side
/// in SIMD lanes (widest instruction set of the machine) and threads, with the same arithmetic for a chunk on every
/// machine and for every number of threads: results are equal bit by bit. Nothing of the elimination inside a chunk is
/// kept: the way back repeats it in cache, which is faster than fetching its factors from memory, and memory stays
/// below (2 block + borders + columns) · block / 7 doubles per cell. Right-hand sides known together should be solved
/// together.
///
/// The residual of every solve is computed (see CyclicCheck); above 1e-12 one refinement is made. With borders,
/// elimination takes the C rows along by ordinary elimination: where that fails (a kernel of A that lives on few nodes)
/// the bordered matrix goes to Eigen's SparseLU.
///
/// Ranks that share a line of cells (grids::Slab, with the parts of cyclic_parts()) eliminate their chunks each; what
/// is left of all is solved by rank 0, which sends back the nodes that separate them. The bits are those of one
/// process. All ranks solve at the same time, with the same borders, and find the same outcome. The general sparse LU
/// takes the whole, and is not shared: what needs it is ill_conditioned.
class CyclicBlockSolver {
public:
  /// \param cells of all ranks
  /// \param slab of the ranks that share them; null for one process. It has to live longer than the solver.
  /// Throws std::invalid_argument unless 1 <= block <= 16, cells >= 2, 0 <= borders <= 8, 1 <= max_columns <= 16;
  /// std::logic_error if the slab's parts are not those of cyclic_parts().
  CyclicBlockSolver(int block, std::size_t cells, int borders = 0, int max_columns = 1,
                    const grids::Slab* slab = nullptr);
  ~CyclicBlockSolver();
  CyclicBlockSolver(CyclicBlockSolver&&) noexcept;
  CyclicBlockSolver& operator=(CyclicBlockSolver&&) noexcept;

  /// Solves for `columns` right-hand sides at once. rhs[column·block + row] points to one value per cell,
  /// solution[column·block + field] to one per node; border_rhs and border_solution are border × columns, column by
  /// column. Solution and rhs may not overlap. Throws std::invalid_argument if shapes differ from those of
  /// construction.
  ///
  /// With a slab the matrix, its cells counted, and all arrays are those of this rank's part, and solutions have room
  /// for one node more, that behind the part.
  ///
  /// Status: undefined if the matrix or rhs holds a value that is not finite, singular if the matrix is (to rounding),
  /// ill_conditioned if the residual stays above 1e-9 even so.
  CyclicOutcome solve(const CyclicBidiagonal& matrix, const CyclicBorder& border, std::span<const double* const> rhs,
                      std::span<const double> border_rhs, std::span<double* const> solution,
                      std::span<double> border_solution, CyclicCheck check = CyclicCheck::every_solve);

  /// The same without borders.
  CyclicOutcome solve(const CyclicBidiagonal& matrix, std::span<const double* const> rhs,
                      std::span<double* const> solution, CyclicCheck check = CyclicCheck::every_solve);

  /// Doubles held per cell, all levels and workspaces.
  [[nodiscard]] double memory_per_cell() const;

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

/// out = rhs - A z - B y for one column: rhs[row], z[field] and out[row] as above. Any of rhs's pointers may be null
/// (0).
void cyclic_residual(const CyclicBidiagonal& matrix, const CyclicBorder& border, std::span<const double* const> rhs,
                     std::span<const double* const> z, std::span<const double> y, std::span<double* const> out);

}  // namespace rubato::solve
