#pragma once

#include <algorithm>
#include <chrono>
#include <thread>

namespace rubato::ranks {

/// Waiting for what another rank does: short naps that grow while nothing happens, so that a rank that waits leaves its
/// processor to others, and answers soon where answers are asked for often.
class Naps {
public:
  using Duration = std::chrono::microseconds;
  void take() { std::this_thread::sleep_for(next()); }
  /// How long the next one is.
  Duration next() {
    const Duration nap = nap_;
    nap_ = std::min(2 * nap_, longest);
    return nap;
  }
  /// Something has happened.
  void restart() { nap_ = shortest; }

private:
  static constexpr Duration shortest{20}, longest{1000};
  Duration nap_ = shortest;
};

}  // namespace rubato::ranks
