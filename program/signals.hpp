#pragma once

#include <atomic>
#include <string_view>

namespace rubato::program {

/// How SIGINT, SIGTERM and SIGHUP reach a run.
struct Interruption {
  std::atomic<bool> asked = false;    ///< set by the first signal while the run is storing levels
  std::atomic<bool> storing = false;  ///< set by the run; where it is not, a signal ends the process at once
};

/// From now on SIGINT, SIGTERM and SIGHUP (unless it is ignored, as under nohup) set `asked` of what is returned, so
/// that a run can end with a whole record; while no run stores levels they end the process at once, with status 130,
/// since there is nothing to lose. So does a second signal.
[[nodiscard]] Interruption& catch_interrupts();

/// From now on a crash ends the program with a message that the records it reads, `files`, may be damaged, and the
/// status of that: HDF5 refuses most damaged files, but a few crash it.
void explain_crashes(std::string_view files);

/// Makes sure that standard input, output and error are open, if only on something that cannot be written: otherwise
/// the next file opened, such as a record, would be in the place of one that the caller closed, and get its messages.
void keep_standard_streams();

/// From now on a write beyond the allowed size of files (ulimit -f) fails, as it does on a full disk, and the reason is
/// reported; otherwise it ends the process.
void survive_file_limits();

}  // namespace rubato::program
