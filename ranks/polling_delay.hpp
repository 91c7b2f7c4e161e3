#pragma once

#include <algorithm>
#include <chrono>
#include <thread>

namespace rubato::ranks {

/// The delay between two polls for what another rank does. It doubles while nothing happens, up to a millisecond: a
/// rank that waits leaves its processor to others, and still answers frequent messages quickly.
class PollingDelay {
public:
  using Duration = std::chrono::microseconds;
  void wait() { std::this_thread::sleep_for(next()); }
  /// Returns the delay before the next poll.
  Duration next() {
    const Duration delay = delay_;
    delay_ = std::min(2 * delay_, longest);
    return delay;
  }
  /// Starts again with the shortest delay, after a message.
  void restart() { delay_ = shortest; }

private:
  static constexpr Duration shortest{20}, longest{1000};
  Duration delay_ = shortest;
};

}  // namespace rubato::ranks
