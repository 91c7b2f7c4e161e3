#pragma once

#include <atomic>

namespace rubato::program {

/// From now on SIGINT and SIGTERM set the flag returned, so that a run can end with a whole record. A second signal
/// ends the process at once.
[[nodiscard]] const std::atomic<bool>& catch_interrupts();

}  // namespace rubato::program
