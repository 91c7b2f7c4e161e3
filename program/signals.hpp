#pragma once

#include <atomic>
#include <string_view>

namespace rubato::program {

/// From now on SIGINT, SIGTERM and SIGHUP (unless it is ignored, as under nohup) set the flag returned, so that a run
/// can end with a whole record. A second signal ends the process at once.
[[nodiscard]] const std::atomic<bool>& catch_interrupts();

/// From now on a crash ends the program with a message that the records it reads, `files`, may be damaged, and the
/// status of that: HDF5 refuses most damaged files, but a few crash it.
void explain_crashes(std::string_view files);

/// Makes sure that standard input, output and error are open, if only on something that cannot be written: otherwise
/// the next file opened, such as a record, would be in the place of one that the caller closed, and get its messages.
void keep_standard_streams();

/// From now on a write beyond the allowed size of files (ulimit -f) fails, as it does on a full disk, and the reason is
/// told; otherwise it ends the process.
void survive_file_limits();

}  // namespace rubato::program
