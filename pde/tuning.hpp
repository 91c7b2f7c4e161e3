#pragma once

#include <cstddef>
#include <limits>

#include <rubato/base/limits.hpp>
#include <rubato/variation/tuning.hpp>

/// \file
/// The numbers of this room that were tuned, or chosen, with their reasons: here, so that a reader who changes one sees
/// the others. Those of the search for levels are in variation/tuning.hpp.

/// Transforms of fields (wave_rows.cpp).
namespace rubato::tuning::wave_rows {

/// Beyond so many nodes fields are transformed one after the other, in the memory of one.
inline constexpr std::size_t nodes_of_one_transform = 4096;

}  // namespace rubato::tuning::wave_rows

/// The sweep over cells (cell_sweep.cpp).
namespace rubato::tuning::cell_sweep {

/// Quantities of a node that are summed over the grid together.
inline constexpr int rows_by_node = 4;

}  // namespace rubato::tuning::cell_sweep

/// Steps by the rows of an action (action_step.cpp).
namespace rubato::tuning::action_step {

/// Operations behind a value of the energy's density whose rounding errors add up; twice as many make levels accept
/// twice the deviation where that is all rounding.
inline constexpr double roundings = 8.0;

}  // namespace rubato::tuning::action_step

/// Newton's method for them (action_newton.cpp). Corrections are relative to the largest value of their field.
namespace rubato::tuning::action_newton {

inline constexpr int most_iterations = 50;
inline constexpr double action_enough = 2.0 * epsilon;  ///< a correction of which nothing is left
inline constexpr double action_rounding = 1e-8;         ///< below this a correction that no longer falls is rounding
inline constexpr double linear_rounding = 1e-6;         ///< the same of directions
inline constexpr double stall = 0.3;                    ///< of the last correction: it no longer falls
inline constexpr double slow = 0.1;                     ///< of the last correction: the matrix is made anew
inline constexpr double action_nearby = 0.03;           ///< steps that differ by this share a matrix
inline constexpr double part_of_others = 0.01;          ///< of the largest field, in units of each: what counts as size
inline constexpr int krylov_restart = 30;               ///< vectors that GMRES keeps
inline constexpr double krylov_tolerance = 1e-9;        ///< of a correction; the next one mends what is left
inline constexpr double krylov_acceptable = 1e-3;       ///< the same where GMRES stagnates
inline constexpr double diverged = 1e6;                 ///< corrections of so many times a field lead nowhere

}  // namespace rubato::tuning::action_newton

/// Steps of euler-box (euler_box_map.cpp).
namespace rubato::tuning::euler_box {

inline constexpr int most_map_iterations = 50;

}  // namespace rubato::tuning::euler_box

/// Which fields follow from others (field_structure.cpp).
namespace rubato::tuning::field_structure {

inline constexpr double rank_threshold = 1e-10;    ///< of the largest singular value
inline constexpr double support_threshold = 1e-7;  ///< of a unit vector's components
inline constexpr double cancelled = 1e-13;         ///< of the sum of |terms|

}  // namespace rubato::tuning::field_structure

/// Stages of a slab by fixed-point iteration (gauss_step.cpp).
namespace rubato::tuning::gauss_step {

inline constexpr int most_slab_iterations = 200;
/// What the next correction would mend, relative, at which nothing but rounding is left.
inline constexpr double enough = 0.25 * epsilon;
/// Stages that the next correction would move by this are as good as enough where it is made without looking at it.
inline constexpr double nearly_enough = 4.0 * epsilon;
/// Matrices of a step that differs by this, relative, serve: what is left of them is mended with them.
inline constexpr double nearby = 1e-10;
/// Where the iteration contracts, the rounding error of a stage's values enters the next ones with a factor below one;
/// the transforms and the rest of S add some units in the last place of these values.
inline constexpr double roundings = 16.0;
/// Corrections that shrink less than this lead nowhere within most_slab_iterations.
inline constexpr double no_contraction = 0.9;
inline constexpr int patience = 8;
/// Fixed-point iteration is tried again in steps so many times shorter than one in which it did not contract, and now
/// and then, since it depends on the solution, too.
inline constexpr double contracts_again = 0.5;
inline constexpr int newton_steps = 32;
/// |λ|/h may move by this part of WaveResolvent::reach before the resolvent is made anew.
inline constexpr double drift_in_reach = 0.5;
/// Matrices of more are no sooner read than made: 2 MB.
inline constexpr std::size_t most_entries_of_maps = 131072;

}  // namespace rubato::tuning::gauss_step

/// The same by Newton's method (gauss_step_newton.cpp).
namespace rubato::tuning::slab_newton {

inline constexpr int most_slab_corrections = 40;
inline constexpr int krylov_vectors = 60, most_krylov_iterations = 240;
/// A correction is solved for as well as the last one was large, between these: the next squares what is left.
inline constexpr double coarsest_solve = 1e-2, finest_solve = 1e-8;
/// The shortest part of a correction that is taken where the whole one makes the residual larger.
inline constexpr double shortest_part = 1.0 / 64.0;
/// Corrections below this are taken whole.
inline constexpr double small_correction = 1e-6;
/// Newton's corrections square: those below that mend nothing are rounding, which a long step makes more of, about as
/// much as h² ε for a motion that nothing holds back.
inline constexpr double certainly_rounding = 1e-7;
inline constexpr int most_doublings = 30;
/// Of what rounding explains, the part that may be left.
inline constexpr double unfelt_part = 0.01;
/// A correction of this size beside the increments is rounding.
inline constexpr double newton_done = 0.25 * std::numeric_limits<double>::epsilon();

}  // namespace rubato::tuning::slab_newton

/// Whether initial fields agree (initial_agreement.cpp).
namespace rubato::tuning::initial_agreement {

/// Of second and, for euler-box, of first differences.
inline constexpr double second_share = 0.5;
inline constexpr double first_share = 0.75;
inline constexpr double rounding_share = 1e-9;

}  // namespace rubato::tuning::initial_agreement

/// The first level (initial_level.cpp).
namespace rubato::tuning::initial_level {

inline constexpr int most_level_iterations = 30;
/// A correction, relative to the field, that is certainly nothing but rounding; and one, relative to the last, that
/// mends nothing.
inline constexpr double rounding_correction = 1e-15;
inline constexpr double stall = 0.25;
/// Rounding errors of a constraint: a dozen products and sums, half a unit in the last place each, of terms that may be
/// larger than what they add up to; derivatives by transforms round as much.
inline constexpr double solved = 64.0 * epsilon;

}  // namespace rubato::tuning::initial_level

/// Means along x that the first level has to have (mean_conditions.cpp).
namespace rubato::tuning::mean_conditions {

/// Of the largest value: what solutions of a line leave that are cut off at the ends of a period.
inline constexpr double cut_tails = 1e-3;

}  // namespace rubato::tuning::mean_conditions

/// Sawtooths of the first level (initial_sawtooths.cpp).
namespace rubato::tuning::sawtooths {

/// One step gives linear constraints; others converge as Newton's method does.
inline constexpr int most_passes = 20;
/// Of the largest value of a field: what is left of an amplitude once it is 0 to rounding.
inline constexpr double no_amplitude = 1e-15;

}  // namespace rubato::tuning::sawtooths

/// Krylov solver of cells (gmres_cell_solver.cpp).
namespace rubato::tuning::krylov {

inline constexpr int restart = 20;
/// Change of the constants, relative, beyond which the matrix with the entries' means is inverted anew.
inline constexpr double stale = 1e-5;
/// Corrections, after the first solution, where the residual is looked at.
inline constexpr int most_refinements = 5;

}  // namespace rubato::tuning::krylov

/// The velocity at the start (box_lattice.cpp).
namespace rubato::tuning::box_start {

/// Length of the two short steps, relative to the first step.
inline constexpr double start_ratio = 1e-2;

}  // namespace rubato::tuning::box_start

/// Levels of the box scheme (box_lattice.cpp).
namespace rubato::tuning::box_lattice {

inline constexpr int most_iterations = 20;
/// Corrections after which a linear solve that went wrong is thought of; a regular step takes 2 to 4.
inline constexpr int careful_after = 6;
/// Accuracy of a trial beside the cube of its relative distance from the last one.
inline constexpr double trial_accuracy = 1e-3;
inline constexpr double finest_trial = 1e-13;
/// Correction of a trial, relative, beside its distance from the last one: what shifting it leaves.
inline constexpr double expected_correction = 1e-2;
/// The residual, relative to the terms of its row, at which nothing but rounding is left.
inline constexpr double residual_floor = 4.0 * epsilon;
/// The backward error that a step may be accepted with: a dozen products and sums of each row and some evaluations
/// within ∇S, half a unit in the last place each, of terms that may be a few times what is left of them.
inline constexpr double solved = 64.0 * epsilon;
/// Beside the correction before it, one that is as large as this mends nothing: Newton's method squares them.
inline constexpr double stall = 0.25;

}  // namespace rubato::tuning::box_lattice

/// Laws at nodes (node_laws.cpp).
namespace rubato::tuning::node_laws {

/// Blocks of cells that a thread takes at once.
inline constexpr std::size_t blocks_at_once = 8;

}  // namespace rubato::tuning::node_laws

/// Whether fields are periodic (periodicity.cpp).
namespace rubato::tuning::periodicity {

inline constexpr std::size_t shortest_line = 20;
inline constexpr std::size_t nearest = 4;  ///< a stencil of five nodes reaches 2 to each side of a break
inline constexpr std::size_t farthest = 10;
inline constexpr double standing_out = 10.0;
inline constexpr double beyond_inside = 4.5;  ///< a kink between two nodes gives a quarter of what one at a node gives
inline constexpr double of_second_difference = 0.02;
inline constexpr double rounding_of_values = 1e-12;

}  // namespace rubato::tuning::periodicity

/// Loops over stages (stage_loops.cpp).
namespace rubato::tuning::stage_loops {

/// Rows whose sums stay in registers.
inline constexpr int rows_at_once = 8;
/// Beside squares of stages, the rounding error of a sum of them that is 0; and beside squares that are 0.
inline constexpr double rounding_of_squares = 256.0 * epsilon * epsilon;
inline constexpr double least_square = 1e-300;
/// A recurrence is taken where the polynomial missed the last stage by so many times more: an error that passes through
/// 0 there shows nothing.
inline constexpr double caution = 8.0;

}  // namespace rubato::tuning::stage_loops

/// The exact inverse per wave (wave_resolvent.cpp).
namespace rubato::tuning::wave_resolvent {

/// A pivot this much smaller than the largest means a matrix without inverse.
inline constexpr double singular = 1e-13;
/// A coefficient this much smaller than what it is the sum of, on so many waves, is zero on all: between what rounding
/// leaves of one, 1e-14, and coefficients that are small on many waves.
inline constexpr double rounding_of_coefficients = 1e-12;
inline constexpr std::size_t sampled_waves = 256, few_waves = 4096;

}  // namespace rubato::tuning::wave_resolvent

/// The kernel of the linear part (kernel_conditions.cpp).
namespace rubato::tuning::kernel_conditions {

/// A vector with this part of its size, or less, off a space is counted as in it: between rounding, 1e-15, and the
/// smallest ratio of wave numbers, 1e-7.
inline constexpr double off_range = 1e-9;

}  // namespace rubato::tuning::kernel_conditions

/// Splittings of waves (wave_splitting.cpp).
namespace rubato::tuning::wave_splitting {

/// Steps of one composition have at most nine different drifts, and those to the Gauss points of a step as many each;
/// where tables are long, such steps make them anew.
inline constexpr std::size_t most_propagators = 64, propagators_of_many_waves = 24;
inline constexpr std::size_t many_waves = 4096;
/// Cosines and sines of so many different drifts, and of so many angles, are found at once, where waves are few.
inline constexpr std::size_t most_drifts = 9, angles_at_once = 1024;

}  // namespace rubato::tuning::wave_splitting

/// Whether an equation is well posed (well_posedness.cpp).
namespace rubato::tuning::well_posedness {

inline constexpr double cancelled_entry = 1e-13;  ///< of the sum of |terms|
inline constexpr double significant = 1e-6;       ///< of the largest term of the polynomial on some circle
inline constexpr double shorter = 64.0;           ///< the waves at the far end, beside the shortest of the grid
inline constexpr double least_growth = 4.0;       ///< of the rate up to there
inline constexpr double beside_sigma = 1e-3;      ///< Re σ beside |σ|: multiple roots have real parts from rounding
inline constexpr std::size_t sample_states = 16;

}  // namespace rubato::tuning::well_posedness
