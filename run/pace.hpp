#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>

namespace rubato {

/// Says how many steps a run takes at once, before it looks at the clock, at what it has to show and to store: one if
/// steps are long, and of short ones so many that all else costs nothing beside them.
class Pace {
public:
  /// \param between looks about so long, or a step; with 0 a look at every step
  explicit Pace(std::chrono::steady_clock::duration between) : span_(std::min(between, longest)) {}

  [[nodiscard]] std::size_t steps() const { return steps_; }
  /// After these steps.
  void look() {
    const Clock::time_point now = Clock::now();
    steps_ = now - last_ >= span_ ? std::max<std::size_t>(steps_ / 2, 1) : std::min(2 * steps_, most_);
    last_ = now;
  }
  /// From now on one step at a time.
  void keep_to_one() { steps_ = most_ = 1; }

private:
  using Clock = std::chrono::steady_clock;
  /// A terminal sees progress without delay, and an interval between commits is kept. Ten times as long is seen.
  static constexpr std::chrono::steady_clock::duration longest = std::chrono::milliseconds(1);

  std::chrono::steady_clock::duration span_;
  std::size_t steps_ = 1, most_ = 256;
  Clock::time_point last_ = Clock::now();
};

}  // namespace rubato
