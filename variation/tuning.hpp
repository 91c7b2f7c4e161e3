#pragma once

#include <array>
#include <cstddef>
#include <limits>

/// \file
/// The numbers that were tuned, or chosen, in the search for levels, with their reasons: here, so that a reader who
/// changes one sees the others. Tolerances of a single formula stand beside it.

namespace rubato::tuning {

/// Accuracy asked of a step whose length will still change: Newton's next correction of h squares the error anyway.
inline constexpr double loose = 1e-6;

// The equation E_k = E of a regular step (level_equation.cpp)

/// A root this many times longer or shorter than the step law predicts is on another branch.
inline constexpr double largest_ratio = 4.0;
/// Trial lengths per step. A regular step takes 2 or 3; the rest is for finding out that there is no root.
inline constexpr int most_trials = 60;

// The equations of a step, whatever the scheme

/// E_k is distinguished from its neighbours by terms of order h^s, and its slope with it: a trial that is not the last
/// is solved nearly as well as the last.
inline constexpr double loosest_trial = 1e-13;
/// What the next correction would mend, relative, at which a step is solved: leftovers, of one sign, must not add up.
inline constexpr double least_leftover = 1e-3 * std::numeric_limits<double>::epsilon();
/// A step this many times longer or shorter than the last one is not begun from its polynomial.
inline constexpr double longest_continuation = 3.0;

// Levels (time_levels.cpp)

/// Part of the tolerance to which equations are solved.
inline constexpr double margin = 0.1;
/// What a step may be off E by however large its terms have become, beside those that E was set with.
inline constexpr double largest_miss_of_terms = 1e-3;
/// The terms of E are at least this part of what the first step adds to H.
inline constexpr double least_terms = 1e-2;
/// Steps for which the size of the energy's terms serves, with fixed levels; and of a large state (small_state), whose
/// bound of rounding takes as long as some steps. With variable levels a sixteenth: 1 and 6.
inline constexpr std::size_t size_period = 16, large_size_period = 96;

// Where the next step is looked for first (step_forecast.cpp, extrapolation.cpp)

/// How much an error foreseen counts one step later.
inline constexpr double memory = 0.5;

/// No step is foreseen to be this many times longer or shorter than the last one.
inline constexpr double largest_foresight = 1.25;
inline constexpr int most_forecast_iterations = 8;
inline constexpr double forecast_accuracy = 1e-10;
/// A forecast is solved to this part of what it is off by itself, or at least so well.
inline constexpr double small_uncertainty = 0.03, coarse_forecast = 1e-4;

// The first step by a tolerance (first_step.cpp)

/// The tolerance trials begin with, and the factor from one to the next.
inline constexpr double coarse_tolerance = 1e-3;
inline constexpr double refinement = 1e-2;
inline constexpr int most_first_trials = 16;
/// A trial whose deviation is this part of the tolerance is good enough; the next one aims at its upper third.
inline constexpr double least_part = 0.7;
inline constexpr double aim = 0.9;
/// Change of the step from one trial to the next: where the law does not hold yet it is not to be trusted further.
inline constexpr double largest_rise = 4.0;
inline constexpr double largest_cut = 0.1;

// Steps off the law (time_levels.cpp)

/// A step that is off E by so many times the terms that E was set with has another energy altogether.
inline constexpr double another_energy = 1e3;
/// The first step that meets the pure law again may differ from the step law by this factor: one farther off would let
/// the amplitude of H - E wander away.
inline constexpr double largest_misfit = 1.5;

// What is said of steps off the law (off_law_causes.cpp)

/// How many steps ahead a zero of Γ explains why a step does not exist: the step law has h grow without bound there.
inline constexpr double steps_ahead = 3.0;
/// A sign change from one Γ to another this many times larger is no crossing of a simple zero: those are balanced.
inline constexpr double largest_crossing_ratio = 16.0;

// The look-ahead of a step potential (look_ahead.cpp; theory, section 9)

/// What a look-ahead sees at least, in first steps: a period of what an orbit does is some dozens of steps that resolve
/// it.
inline constexpr double least_stretch = 400.0;
/// Steps it takes at most, if the state is as small as an orbit's, and if it is large.
inline constexpr std::size_t most_steps = 3200, most_large_steps = 400;
/// At order_with_zeros and more it looks after so many first steps, and again whenever it has seen twice as much,
/// whether it has seen enough to take equal steps; with strides of which a look has eight at least. Where K shows
/// nothing by the second look it is enough if no longer strides can be taken; as they can far out on an eccentric
/// orbit, where as many first steps are looked through for what is to come.
inline constexpr double first_look = 16.0, second_look = 32.0, strides_in_look = 8.0;
inline constexpr double longest_stretch_untold = 6400.0;
/// And no stride is longer than one that takes more than this part of the iterations that shorter ones do.
inline constexpr double saving = 0.9;
/// Values of a state beyond which it is not small.
inline constexpr std::size_t small_state = 100;
/// |η| largest beyond this part of the stretch: more is to come.
inline constexpr double seen_before = 0.9;
/// So much of the largest |η| the second half has to see again: an eccentric orbit that sets out from its pericentre
/// will come back to it.
inline constexpr double come_back = 0.1;
/// By so much the stretch has grown when it is looked at again.
inline constexpr double look_again = 1.1;
/// Where the terms of K are so many times those of the first step the motion has blown up, and what is beyond would
/// only overflow.
inline constexpr double blown_up = 1e100;
/// η is wanted to two digits.
inline constexpr double look_ahead_accuracy = 1e-5;
/// Change of η from one step to the next, relative to the larger, with which steps may become twice as long; beyond
/// which a long step is taken again, half as long; and after how many steps the longer ones are tried once more. A
/// longer step has an error of η that is four times as large: so it stays a few hundredths.
inline constexpr double hardly_changed = 0.05, changed_much = 0.2;
inline constexpr int steps_until_tried_again = 8;
inline constexpr double longest_stride = 1024.0;
/// A stride that leaves the energy off by this part of its terms shows nothing of the motion: it passes over it.
inline constexpr double off_much = 0.1;
/// A stride that takes more than so many iterations, and so many times those of a shorter one for the same time, is not
/// tried again, nor is a longer one: where a fixed point no longer contracts there are thousands in a step.
inline constexpr int many_iterations = 100;
inline constexpr double dear = 2.0;

// The choice of a step potential (step_potential.cpp)

/// A forecast goes on in strides of steps that are alike: so many to a stretch between two steps of the look-ahead,
/// over which η changes by a tenth or so, and to a turn of what is made of it.
inline constexpr double strides_in_piece = 8.0, strides_in_turn = 128.0;
/// Between the ends of a stride, relative; else it was too long, and steps go on one by one.
inline constexpr double alike_change = 0.03;
/// A step of a forecast is solved for when Newton's method moves it by no more than this part of itself.
inline constexpr double last_forecast_move = 1e-5;
/// Newton's iterations for it: as a rule two or three.
inline constexpr int most_forecast_steps = 20;
/// |ln(h_{k+1}/h_k)| up to which the levels' leading order is believed.
inline constexpr double believed_change = 0.2;
/// The levels have to exist for an η that much larger, too: the orbit will meet what the look-ahead did not.
inline constexpr double eta_margin = 1.5;
/// h dE/dh has to be this part of the terms of K: rounding in these then moves h by 1e-6 of itself at most. Or so many
/// times the tolerance that levels are solved to, for what that leaves to move h by a thousandth at most; E_k is met
/// much better than to it (TimeLevels::solved_to).
inline constexpr double least_slope = 1e-10, least_slope_by_tolerance = 10.0;
/// κ tried: from steps as long as the orbit lets them be to steps that are nearly equal.
inline constexpr double largest_kappa = 48.0, least_kappa = 0.5, kappa_ratio = 1.4;
/// κ where none of them is forecast to last.
inline constexpr double last_resort = 0.5;
/// How large f' may become, beside what the node energy is off with equal steps.
inline constexpr double largest_part = 4.0;
/// And beside the size of the terms of K, which is |K| or some hundredths of the sum of their magnitudes.
inline constexpr double most_of_terms = 30.0;
/// K does not depend on h where all that a first step makes of K - H is this part of the tolerance of the levels.
inline constexpr double unfelt_by_levels = 0.1;
/// Potentials are as good as the best up to this part of its work.
inline constexpr double as_good = 0.1;
/// So much more work may one be that is hardly felt, as the law without a potential is.
inline constexpr double cost_of_the_law = 0.5;
/// A potential of this part of what the node energy is off with equal steps is hardly felt.
inline constexpr double unfelt = 1e-3;
/// How far η may leave what the first half of the stretch of a look-ahead has shown, for the second to have nothing
/// new.
inline constexpr double nothing_new = 0.5;
/// So many times η is made to change its sign and back, to see whether levels would last where it does so unseen.
inline constexpr double unseen_turns = 6.0;
/// From this order on that is asked of every potential.
inline constexpr double order_with_zeros = 4.0;
/// Where the node energy hardly changes, this part of what it is off with equal steps counts for its change.
inline constexpr double negligible = 0.01;
/// Where η vanishes, K is the same for every h, and the potential alone distinguishes one step from another: f' is at
/// least this part of the terms of K then, well above their rounding errors.
inline constexpr double least_strength = 1e-6, least_strength_by_tolerance = 100.0;

// Steps that are nearly equal (equal_steps.cpp)

/// A run of fewer first steps than so many times least_stretch is short: a look-ahead would cost a quarter of it and
/// more.
inline constexpr double short_run = 4.0;
/// A gain by following η that is worth a choice among many potentials, which allow for steps that change fast
/// and for what was not seen, and so seldom gain more than half of it.
inline constexpr double worth_following = 1.5;
/// A stretch shows what repeats where η turned so often, by more than this part of itself, and was no more than so many
/// times larger in its second half.
inline constexpr int turns_of_repetition = 4;
inline constexpr double turn_of_eta = 0.1, growth_of_repetition = 1.5;
/// f' of nearly equal steps where a look-ahead saw them: this part of the terms of K, so that levels exist until the
/// node energy is off by four times that, whatever is to come; or so many times what it was seen to be off by, but no
/// more than a part of the terms that is half of what a user is warned of, if that is so many times what was seen.
inline constexpr double stiff_part = 1e-4, stiff_margin = 10.0, most_stiff_part = 0.05, least_stiff_margin = 2.0;
/// And where one step was all that was seen: this part of the terms of K, a hundredth of what a user is warned of, and
/// at least so many times what the node energy was off by.
inline constexpr double stiff_part_of_first = 1e-3, stiff_margin_of_first = 100.0;

// Levels with a step potential (potential_levels.cpp)

inline constexpr int most_potential_trials = 40;
/// A root this many times longer or shorter than foreseen is not taken.
inline constexpr double farthest_root = 2.0;
/// How far one trial may be from the last, and how near they are for a secant to be a slope.
inline constexpr double longest_move = 1.25, nearby = 0.05;
/// An h off by this part of itself is as good as exact: the motion's own terms, which it moves by as much of what they
/// change in a step, are rounded by more.
inline constexpr double unfelt_in_step = 1e-12;
/// What a loosely solved step leaves of E_k, beside h dE/dh: E_k is reported to first order in what the step is off by.
inline constexpr double loose_energy = 1e-9;
/// A move that is hardly more than that may be the last; before it, loosely solved steps show as much and cost less.
inline constexpr double last_move = 10.0 * loose_energy;
/// Differences that stand out from their errors so far show what the scheme's slope is off by, if that is within:
inline constexpr double standing_out = 1e3, largest_slope_ratio = 1.25;
/// Newton's moves that leave more of a miss than this part are made with a slope that is far off.
inline constexpr double slow = 0.5;

}  // namespace rubato::tuning
