#pragma once

#include <rubato/base/spread.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/run/disagreements.hpp>
#include <rubato/run/shared_rows.hpp>

namespace rubato {

/// Everything of a lattice's record that its stored states determine, by a path independent of the run's solver:
///
/// - the grid, from the problem;
/// - at each stored level: the node energy, Γ (where every level is stored), totals, invariants, the exact solution;
///   the first is the problem's initial level;
/// - of each step between two of them: E_k, what they leave of the scheme's equation, the local laws in every cell and
///   their sizes; of steps that follow each other also the variational laws and the multisymplectic residual.
///
/// One level is in memory at a time; of a shared record each rank has its part of it, all call this, and rank 0 has the
/// findings. \return the residuals of the step equation \throws record::Error
[[nodiscard]] Spread check_lattice(const SharedRecord& record, const StoredLevels& levels, const Problem& problem,
                                   bool has_gamma, Disagreements& findings);

}  // namespace rubato
