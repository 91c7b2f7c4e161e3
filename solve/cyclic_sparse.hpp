#pragma once

#include <span>

#include <rubato/solve/cyclic_block.hpp>

namespace rubato::solve {

/// True if every coefficient and right-hand side is finite.
bool cyclic_is_finite(const CyclicBidiagonal& matrix, const CyclicBorder& border, std::span<const double* const> rhs,
                      std::span<const double> border_rhs);

/// Solves the bordered cyclic system with Eigen's general SparseLU (partial pivoting, column ordering COLAMD): ten to a
/// hundred times slower than CyclicBlockSolver and with far more memory, but with no condition on A. Arguments as
/// there. Status::singular if no pivot is found.
Status solve_cyclic_by_sparse_lu(const CyclicBidiagonal& matrix, const CyclicBorder& border,
                                 std::span<const double* const> rhs, std::span<const double> border_rhs,
                                 std::span<double* const> solution, std::span<double> border_solution);

}  // namespace rubato::solve
