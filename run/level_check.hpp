#pragma once

#include <rubato/problem/problem.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/run/checkpoint_check.hpp>
#include <rubato/run/disagreements.hpp>

namespace rubato {

/// Whether what a record reports on its levels and steps fits together, and its problem, whatever the states are:
///
/// - times, steps and their numbers: t_{k+1} = t_k + h_k where both levels have a row; with fixed levels
///   t_k = start + k·step; the first step is the problem's; levels with a row, and with a state, are every n-th and the
///   last;
/// - flags: fixed levels have no steps off the law;
/// - the energy law: one E, set by the first step on it, and |E_k - E| within the tolerance, or within what rounding
/// leaves,
///   on every step that is not flagged as off it;
/// - no number is missing where there has to be one;
/// - the step potential's part of E_k is that of the potential in the checkpoint.
///
/// `checkpoint`: what the law's tolerance is relative to, and the step potential, as the checkpoint has them.
void check_levels(const record::Reader& reader, const StoredLevels& levels, const Problem& problem,
                  const CheckpointDisagreements& checkpoint, Disagreements& findings);

}  // namespace rubato
