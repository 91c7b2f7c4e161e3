#pragma once

#include <string>

#include <rubato/run/run.hpp>

namespace rubato {

struct CheckOptions {
  /// Takes every step again, from the start, and compares all rows bit by bit: as long as the run was. Bits may differ
  /// between machines whose elementary functions round differently.
  bool replay = false;
  /// As RunOptions::ranks: they share the check of a lattice that they could have run, each with its part of every
  /// level (a replay is taken by rank 0 alone, and so is what cannot be shared).
  ranks::Communicator* ranks = nullptr;
};

/// Recomputes everything of a record that its stored states determine, and compares: check_levels, check_orbit,
/// check_lattice. Also compares the statistics in the checkpoint, and the checksum of every dataset, which finds that a
/// number was altered but not which.
///
/// Where numbers disagree the outcome's status is ExitStatus::contradiction, and Outcome::disagreements names them. Its
/// figures are those of the record, with what was recomputed in place of what disagrees; with the residual of the step
/// equation in addition. What could not be recomputed is reported in its warnings: with `every` > 1 steps between
/// stored states, but for their checksums; iterations.
///
/// The record is read level by level. It may be that of a run still going, or of one that was killed.
/// \throws record::Error if it cannot be read, or its datasets do not fit together; Interrupted where an Interruptible
/// of this thread asks for it
[[nodiscard]] Outcome check(const std::string& file, const CheckOptions& options = {});

}  // namespace rubato
