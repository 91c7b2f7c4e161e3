#pragma once

// Internal to the room: the only header that knows FFTW.

#include <fftw3.h>

#include <memory>
#include <mutex>

namespace rubato::grids {

/// FFTW's planner has global state.
inline std::mutex& planner_lock() {
  static std::mutex lock;
  return lock;
}

struct DestroyPlan {
  void operator()(fftw_plan plan) const {
    const std::lock_guard guard(planner_lock());
    fftw_destroy_plan(plan);
  }
};
using Plan = std::unique_ptr<fftw_plan_s, DestroyPlan>;

/// make() under the lock.
template <class Make>
Plan make_plan(Make&& make) {
  const std::lock_guard guard(planner_lock());
  return Plan(make());
}

}  // namespace rubato::grids
