#pragma once

#include <cstddef>
#include <limits>

/// \file
/// The numbers of this room that were tuned, or chosen, with their reasons: here, so that a reader who changes one sees
/// the others. Those of the search for levels are in variation/tuning.hpp.

/// Cyclic block systems (cyclic_block.cpp).
namespace rubato::tuning::cyclic_block {

inline constexpr std::size_t residual_block = 512;  ///< cells whose residual is computed together, in first-level cache
inline constexpr double refine_above = 1e-12;
inline constexpr double unacceptable_backward_error = 1e-9;

/// Longer chunks repeat less work, shorter ones keep a group of them in second-level cache: 8 lanes × 16 slots of
/// 4 d² doubles are 16 kB · d².
constexpr std::size_t cells_per_chunk(int block) {
  return block <= 4 ? 16 : 8;
}
/// Cells that a rank has at the last level that it eliminates on its own, where there are as many: parts then differ by
/// 6 % at most.
inline constexpr std::size_t cells_of_rank = 16;

}  // namespace rubato::tuning::cyclic_block

/// Newton's method with corrections of least norm (damped_newton.cpp).
namespace rubato::tuning::damped_newton {

/// Damping s beside a matrix of entries about 1 (DampedLeastSquares). At the least one a direction in which solutions
/// are not isolated keeps seven digits free of rounding; a direction with the singular value 1e-6 converges by a factor
/// of 1e-6 an iteration.
inline constexpr double least_damping = 1e-9;
/// More than the least one is tried, by this factor and up to the most, where no part of a correction helps.
inline constexpr double damping_factor = 100.0, most_damping = 0.1;
/// Of a correction that is tried.
inline constexpr double least_fraction = 1e-3;
/// Residuals of size 1 that count as 0: an iteration that tends to u = 0 has no rounding error to stop at.
inline constexpr double least_residual = 1e-20;

}  // namespace rubato::tuning::damped_newton

/// Singular vectors of sparse matrices (singular_vectors.cpp).
namespace rubato::tuning::singular_vectors {

/// s beside entries about 1: values below it count as 0.
inline constexpr double damping = 1e-9;
/// Each divides what is mixed in of the first value left out by the square of its ratio.
inline constexpr int iterations = 6;

}  // namespace rubato::tuning::singular_vectors

/// Dense systems (dense_solver.cpp).
namespace rubato::tuning::dense {

inline constexpr int largest_unblocked = 16;

}  // namespace rubato::tuning::dense

/// Small matrices (small_matrices.cpp).
namespace rubato::tuning::small_matrices {

inline constexpr int equilibration_sweeps = 12;    ///< each takes the root of the ratio that is left
inline constexpr double cancelled_product = 1e-9;  ///< of the sum of |terms|

}  // namespace rubato::tuning::small_matrices

/// The Fourier preconditioner (fourier_preconditioner.cpp).
namespace rubato::tuning::preconditioner {

inline constexpr double deficient_below = 1e-13;
/// Sizes of rows or columns of which the smallest is so small a part of the largest: a wave may have less of an entry
/// than the largest over all waves, and pivots are smaller than entries. 10⁴ of deficient_below for both.
inline constexpr double scaled_below = 1e-9;
/// Smaller ones are rows of zeros: 4/h² with h the rounding of what the equation takes time for has ε²/4 beside it.
inline constexpr double zero_below = 1e-32;
inline constexpr std::size_t piece = 128;  ///< modes multiplied together, in first-level cache

}  // namespace rubato::tuning::preconditioner
