#pragma once

#include <atomic>
#include <stdexcept>

namespace rubato {

/// Work was asked to end before it had a result. What throws it leaves everything as it was before that work.
class Interrupted : public std::runtime_error {
public:
  Interrupted() : std::runtime_error("interrupted") {}
};

/// While one lives, long work of this thread that stores nothing, such as a look-ahead, ends where a flag is set.
class Interruptible {
public:
  /// \param flag null: nothing ends
  explicit Interruptible(const std::atomic<bool>* flag) : before_(present()) { present() = flag; }
  ~Interruptible() { present() = before_; }
  Interruptible(const Interruptible&) = delete;
  Interruptible& operator=(const Interruptible&) = delete;

  /// True if the flag of this thread's innermost one is set.
  [[nodiscard]] static bool asked() { return present() != nullptr && present()->load(std::memory_order_relaxed); }

  /// That flag, for threads that share the work; null for none.
  [[nodiscard]] static const std::atomic<bool>* flag() { return present(); }

  /// \throws Interrupted if it is
  static void end_if_asked() {
    if (asked()) {
      throw Interrupted();
    }
  }

private:
  static const std::atomic<bool>*& present() {
    thread_local const std::atomic<bool>* flag = nullptr;
    return flag;
  }
  const std::atomic<bool>* before_;
};

}  // namespace rubato
