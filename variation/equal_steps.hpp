#pragma once

#include <optional>

#include <rubato/variation/step_potential.hpp>

// Whether there is anything for steps to follow, and the potential that keeps them nearly equal where there is not: at
// order 4 and more, where η swings to both sides of zero on almost every orbit.

namespace rubato {

/// How many times the work for an error is with equal steps what it is with those that follow η, where the law has
/// the weakest potential with which they exist: f' = (s+1) μ |h|^s, the limit p → s of those that are tried. It adds μ
/// to η, η̃ = η + μ, and the step law (theory, section 3) says
///
///     |h|^s = D/((s+1) η̃),  D ∝ η̃^(1/(s+1)),  D = E - H(z_k).
///
/// Work is steps · max|D - D'|^(1/s), as where potentials are chosen; an η of one sign needs no μ. 1: nothing is
/// gained. About 1 for oscillations, chains and planets, several times that for eccentric orbits.
[[nodiscard]] double gain_of_following(const LookAhead& look);

/// How often η turned back, by more than a tenth of itself and by more than K would show.
[[nodiscard]] int turns_of_eta(const LookAhead& look);

/// True if an orbit has been seen to do again what it did: η turned a few times, and was not much larger in the second
/// half of the stretch than in the first.
[[nodiscard]] bool repeats(const LookAhead& look);

/// True if equal steps do as well as those that follow η, if η goes on as it was seen, and f' need be no large part of
/// the energy for that. Asked at order_with_zeros and more.
[[nodiscard]] bool equal_steps_do(const LookAhead& look);

/// The potential of steps that are nearly equal, and found in hardly more than two trials. f' is ten times what the
/// node energy was seen to be off by, (s+1)|η|h^s, or less, to be no more than a twentieth of the terms of K, but at
/// least a ten thousandth of them; where one step was all that was seen, a thousandth of the terms, or a hundred times
/// what it is off by. Its p = 4s is the largest that is tried elsewhere. Levels exist as long as s(s+1) h^s |η| < p f':
/// while the node energy is off by less than 4f'. Hypothesis: at least one η. \return none if f' would have to be a
/// larger part of the energy than that; of one step always
[[nodiscard]] std::optional<StepPotential> nearly_equal_steps(const LookAhead& look);

/// True if a run is too short for a look-ahead: at order 4 and more that costs more than it saves.
[[nodiscard]] bool is_short_run(int order, double first_step, double run_length);

}  // namespace rubato
