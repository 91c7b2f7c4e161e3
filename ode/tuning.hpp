#pragma once

#include <cstddef>
#include <limits>

#include <rubato/base/limits.hpp>
#include <rubato/variation/tuning.hpp>

/// \file
/// The numbers of this room that were tuned, or chosen, with their reasons: here, so that a reader who changes one sees
/// the others. Those of the search for levels are in variation/tuning.hpp.

/// Boundary-value problems (boundary_value.cpp, end_conditions.cpp).
namespace rubato::tuning::boundary_value {

/// Of free levels: the smallest |η| beside the largest at which the pure law is taken.
inline constexpr double margin = 0.05;
/// Else (μ beside the largest |η|): the bracket η + μ then varies by a factor of 3.
inline constexpr double weight_of_potential = 2.0;
/// From this order on following the motion gains nothing: f' so many times what the node energy is off by, ...
inline constexpr int first_high_order = 4;
inline constexpr double nearly_equal = 20.0;
/// ... and at least so much of the energy, so that the level equation distinguishes steps beyond rounding.
inline constexpr double least_potential = 1e-3;
/// Where the bracket of a stated potential vanishes: a start of the levels, no more.
inline constexpr double smallest_bracket = 1e-2;
/// |∇H| beside 1 + |H_zz| at what counts as an equilibrium, and |Re λ| beside the largest |λ| as off the imaginary
/// axis.
inline constexpr double at_rest = 1e-9;
inline constexpr double hyperbolic = 1e-6;
/// An eigenvalue of the second variation of a periodic orbit, in units of its mass times h/T², that counts as 0: those
/// of long waves are 40, and rounding leaves 1e-16 (T/h)².
inline constexpr double vanishing = 1e-4;
/// Beside the largest of its kind, what the range of a coordinate or momentum counts as that hardly moves (step_error).
inline constexpr double least_range = 1e-3;
/// Of the largest residual, where the solution is for an estimate of errors.
inline constexpr double loose_tolerance = 1e-9;

}  // namespace rubato::tuning::boundary_value

/// Directions that conditions leave open (open_directions.cpp).
namespace rubato::tuning::open_directions {

/// Singular values, where 1 is that of the slowest function of the time: below the first they are rounding errors,
/// below the second small; those of a well-posed problem are seldom below 1e-3.
inline constexpr double rounding = 1e-8, small_value = 0.2;
/// A small one to which half the step leaves none within this factor, up or down, consists of truncation errors: at
/// order 2 these fall to a quarter.
inline constexpr double settling = 0.6;
/// Of the duration or the energy, beside them, along a direction as large as the orbit: what is less is the phase,
/// along which both change by truncation errors.
inline constexpr double visible_change = 1e-2;
/// Of a condition in a combination that vanishes, beside the largest.
inline constexpr double least_share = 1e-3;
/// Of a large system so many are looked at.
inline constexpr std::size_t most_directions = 16;

}  // namespace rubato::tuning::open_directions

/// Branches of solutions (continuation.cpp).
namespace rubato::tuning::continuation {

/// The first step, as a part of the way of the parameter.
inline constexpr double first_parts = 20.0;
/// Steps grow where Newton's method takes few iterations (the start counts), and shrink where it takes many.
inline constexpr std::size_t quick_iterations = 5, slow_iterations = 8;
inline constexpr double growth = 1.5;
/// A correction beside the step: beyond that another branch may have been met.
inline constexpr double most_correction = 0.5;
inline constexpr double least_step = 1e-9;  ///< beside the unknowns
/// A fold's place beside the step that found it, and the slope of the parameter there: it is off by the square of that.
inline constexpr double fold_accuracy = 1e-9;
inline constexpr int most_fold_iterations = 40;

}  // namespace rubato::tuning::continuation

/// Darboux matrices (darboux.cpp).
namespace rubato::tuning::darboux {

/// Ratio of the last pivot to the largest below which a matrix counts as singular.
inline constexpr double singular_limit = 1e-13;
/// Relative asymmetry that is blamed on rounding.
inline constexpr double symmetry_tolerance = 1e-10;

}  // namespace rubato::tuning::darboux

/// The first step of an orbit (first_step.cpp).
namespace rubato::tuning::first_step_of_orbit {

inline constexpr std::size_t most_first_steps = 2000;

}  // namespace rubato::tuning::first_step_of_orbit

/// The Taylor map of a flow (flow_map.cpp).
namespace rubato::tuning::flow_map {

inline constexpr int most_parts = 64;
/// Size of a part's last term beside its first at which the part counts as resolved. It need not be small: the map is
/// a start and a direction for an iteration that corrects it.
inline constexpr double resolved = 1e-3;
/// The same for a tangent, beside the displaced vector.
inline constexpr double tangent_resolved = 0.1;

}  // namespace rubato::tuning::flow_map

/// Γ of Gauss collocation (gauss_function.cpp).
namespace rubato::tuning::gauss_function {

inline constexpr int most_stage_iterations = 50;

}  // namespace rubato::tuning::gauss_function

/// Steps of Gauss collocation (gauss_scheme.cpp).
namespace rubato::tuning::gauss {

inline constexpr int most_gauss_iterations = 100;
/// A fixed-point iteration that shrinks its corrections by less gives way to Newton's. By how much is a matter of what
/// both cost, up to this (corrections that shrink by less than half count as rounding): to digits_to_go digits by the
/// first, or in newton_corrections by the second.
inline constexpr double slowest_contraction = 0.5;
inline constexpr double digits_to_go = 14.0, newton_corrections = 5.0;
/// What they cost, in nanoseconds or so: a sweep over the stages besides its formulas, an instruction of these and the
/// product of a row with the tableau for all stages side by side, and of Newton's corrections one for each eigenvalue
/// and an operation.
inline constexpr double cost_of_sweep = 50.0, cost_of_instruction = 0.7, cost_of_row = 6.0;
inline constexpr double cost_of_part = 300.0, cost_of_operation = 0.3;
/// Newton's iteration stays while steps are at least this part of the one that asked for it.
inline constexpr double back_to_fixed_point = 0.5;
/// And so many of them at most: what was too slow in a step may not be in those that follow, and a try costs some
/// sweeps.
inline constexpr int most_by_newton = 16;
/// What the next correction would mend, relative, by the contraction seen so far, at which a trial that is not the last
/// is solved well enough.
inline constexpr double loose_leftover = 0.5 * std::numeric_limits<double>::epsilon();
/// A correction larger than this shows how fast corrections contract, and one larger than the second about how fast.
inline constexpr double measurable = 1e-13, visible = 4e-15;
/// Corrections of this size are lost in rounding.
inline constexpr double lost_correction = 0.5 * std::numeric_limits<double>::epsilon();
/// Relative change of h that asks for another matrix.
inline constexpr double refactor_ratio = 0.03;
/// A step that no start leads to is approached from one so many times shorter, a power of two.
inline constexpr double shortest_approach = 64.0;
/// Trial steps at one level that are kept to begin others from, and the largest weight that one may have.
inline constexpr std::size_t most_trials = 4;
inline constexpr double farthest_extrapolation = 20.0;

}  // namespace rubato::tuning::gauss

/// The start of a generating step (generating_continuation.cpp).
namespace rubato::tuning::generating_start {

/// Size of the last two orders beside the whole at which the series is still of use as a start.
inline constexpr double converged = 1e-3;

}  // namespace rubato::tuning::generating_start

/// Steps of generating functions (generating_scheme.cpp).
namespace rubato::tuning::generating {

/// Where the tangent is poor, on coarse steps, corrections shrink by little: an accurate step is worth some more of
/// them.
inline constexpr int most_generating_iterations = 100;
/// Relative size of the displacement whose flow is differenced for a tangent: small beside what it bends over, large
/// beside rounding.
inline constexpr double displacement = 1e-5;
/// What that leaves of a tangent undetermined, relative: ε over a displacement of 1e-5 of a step, 1e-10 of curvature.
inline constexpr double displacement_error = 1e-9;
/// Up to this relative size of a residual a tangent of a few orders corrects it to far below rounding. It cannot be
/// left out: what is smooth in a correction, however small, adds up in one direction for the whole run.
inline constexpr double small_residual = 1e-13;
/// Up to this one the displacement leaves no more of a tangent's rounding errors than a tenth of an ε of the state.
inline constexpr double large_residual = 1e-6;
/// A correction at least this large shows, by the next one, how fast corrections contract.
inline constexpr double measurable_correction = 1e-12;
/// Relative size of a correction that rounding alone may make.
inline constexpr double rounding = 8.0 * epsilon;
/// How much larger than its estimate the contraction of a correction is taken to be.
inline constexpr double rate_margin = 10.0;
/// Relative change of h within a level that asks for a new φ^(s+1).
inline constexpr double tail_ratio = 0.05;
/// Orders of the Taylor step that a run starts from: those of the scheme and some more, since it goes a whole step from
/// its centre and the generating function only half of one.
inline constexpr int extra_flow_order = 3;
/// Highest orders of the flow whose tangent corrects residuals, and small ones.
inline constexpr int most_tangent_order = 10;
inline constexpr int small_tangent_order = 4;

}  // namespace rubato::tuning::generating

/// Chains (hessian_band.cpp).
namespace rubato::tuning::band {

/// How many times less work elimination in a band has to take: its loops are short.
inline constexpr double band_gain = 8.0;

}  // namespace rubato::tuning::band

/// Parasites of two-step schemes (integrate.cpp).
namespace rubato::tuning::parasites {

/// Rounding in the eigenvalues of a parasite that neither grows nor decays; multiple ones are the roots of it.
inline constexpr double growth_tolerance = 1e-6;

}  // namespace rubato::tuning::parasites

/// Steps of a Lagrangian (lagrangian_scheme.cpp).
namespace rubato::tuning::of_lagrangian {

inline constexpr int most_newton_iterations = 50;
/// Corrections beyond the domain of L are halved so often.
inline constexpr int most_halvings = 20;
/// A polynomial that is farther than this part of the largest increments of the run from where its iteration began may
/// be another solution than the step.
inline constexpr double lagrangian_farthest = 0.5;
inline constexpr int lagrangian_finest_approach = 16;

}  // namespace rubato::tuning::of_lagrangian

/// Velocities from momenta (legendre.cpp).
namespace rubato::tuning::legendre {

inline constexpr int most_legendre_iterations = 100;
inline constexpr int most_legendre_halvings = 60;
/// What is left of ∂L/∂q̇ = p, beside its terms, when it is rounding for certain; what no longer shrinks may be more,
/// which is_rounding() decides.
inline constexpr double legendre_rounding = 4.0 * epsilon;
/// Pivots of the scaled matrix that differ by more are those of a singular one.
inline constexpr double least_pivot_ratio = 1e-13;

}  // namespace rubato::tuning::legendre

/// Orbits side by side (many_orbits.cpp).
namespace rubato::tuning::many_orbits {

/// As many as keep a step's numbers in the fastest cache.
inline constexpr std::size_t most_side_by_side = 128;

}  // namespace rubato::tuning::many_orbits

/// Holonomic constraints (constraints.cpp and the constrained schemes).
namespace rubato::tuning::constraints {

/// Iterations of Newton's method for the multipliers; three are usual.
inline constexpr int most_multiplier_iterations = 50;
/// Rounding errors of coordinates, or velocities, that a start may be off the constraints by: formulas have some.
inline constexpr double roundings_of_start = 8.0;
/// The same of a step, where the multipliers are off by what is left over the length of the step. Mostly less is left.
inline constexpr double roundings_of_step = 1.0;
/// A matrix of multipliers serves as long as what is left shrinks by that.
inline constexpr double slowest_multipliers = 0.01;
/// What an iteration may leave where it stagnates, relative to the largest coordinate or velocity.
inline constexpr double stagnant_constraint = 1e-12;
/// Pivots of the multipliers' matrix that differ by more are those of dependent constraints.
inline constexpr double least_multiplier_pivot = 1e-13;
/// Gradients of length 1 that are closer to dependent ones are taken for dependent.
inline constexpr double least_independence = 1e-10;

}  // namespace rubato::tuning::constraints

/// Steps of the midpoint rule (midpoint_scheme.cpp).
namespace rubato::tuning::midpoint {

inline constexpr int most_midpoint_iterations = 50;

}  // namespace rubato::tuning::midpoint

/// Splittings side by side (splitting_lanes.cpp).
namespace rubato::tuning::lanes_of_splitting {

/// Steps between two questions whether to go on.
inline constexpr std::size_t steps_between_questions = 1024;

}  // namespace rubato::tuning::lanes_of_splitting

/// Newton's matrices of stages (stage_newton.cpp).
namespace rubato::tuning::stage_newton {

/// Below this an eigenvalue is real, whose imaginary part is rounding; others are larger than 1.
inline constexpr double real_to = 1e-6;
/// What an operation within a band takes longer than one of a whole matrix: its loops are short.
inline constexpr double band_operation = 3.0;

}  // namespace rubato::tuning::stage_newton

/// Tangents of stages (stage_tangent.cpp).
namespace rubato::tuning::stage_tangent {

inline constexpr int most_sweeps = 60;
/// Sweeps that shrink their changes less than that leave the work to a dense matrix, unless these are at stagnation
/// already: some units in the last place, relative to the largest entry.
inline constexpr double slowest = 0.5, stagnation = 1e-14;
/// Where changes shrink steadily the sweep that would come next is left out if it changed less than that, relative.
inline constexpr double beneath = 0.25 * std::numeric_limits<double>::epsilon();

}  // namespace rubato::tuning::stage_tangent

/// Two-step schemes (two_step_scheme.cpp).
namespace rubato::tuning::two_step {

inline constexpr int most_iterations = 50;
/// Corrections by Newton's own matrix, renewed each time, that do not shrink: rounding is all that is left.
inline constexpr int rounding_stalls = 3;
/// Units in the last place of the terms of a row that some products and sums round at.
inline constexpr double roundings = 16.0;

}  // namespace rubato::tuning::two_step
