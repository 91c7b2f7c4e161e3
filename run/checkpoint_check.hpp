#pragma once

#include <rubato/figures/stored.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/run/disagreements.hpp>
#include <rubato/run/lattice_ranks.hpp>
#include <rubato/run/observed_run.hpp>

namespace rubato {

struct CheckpointDisagreements {
  bool is_checked = false;  ///< false for a record of an earlier version
  /// What the tolerance of the energy law is relative to, as the run had it; 0 where the checkpoint does not show.
  double energy_terms = 0.0;
  StepPotential potential = {};
};

/// Whether the checkpoint belongs to the rest of the record: the statistics, made anew of /levels and /laws, or, where
/// not every level has a row, within what these bound; time, energies and state of the level it is at. Restores
/// `observed` to it.
/// \param leader of the ranks that share the observed; null for none
[[nodiscard]] CheckpointDisagreements check_checkpoint(const record::Reader& reader, const StoredLevels& levels,
                                                       const figures::Names& names, ObservedRun& observed,
                                                       const LatticeLeader* leader, Disagreements& findings);

/// The number of stored states, from the first one on and up to row `last`, that the run taken again gives to the bit.
[[nodiscard]] std::size_t reproduced_states(const record::Reader& reader, const StoredLevels& levels,
                                            const Problem& problem, std::size_t last);

/// Takes every step of the record again and compares all rows, and the checkpoint at the end, bit by bit.
void replay(const record::Reader& reader, const StoredLevels& levels, const Problem& problem, Disagreements& findings);

}  // namespace rubato
