#pragma once

#include <rubato/problem/problem.hpp>

namespace rubato {

inline constexpr int most_threads = 1024;

/// The number of OpenMP threads of the calling thread while this exists. Results do not depend on it.
class ThreadCount {
public:
  /// \param threads 0: OpenMP's number (OMP_NUM_THREADS, or all processors)
  /// \throws std::invalid_argument if there are more than `most_threads` (OpenMP would end the process if it could not
  /// start them)
  explicit ThreadCount(int threads);
  /// The same for the run of one problem: without a number, neither here nor in OMP_NUM_THREADS, an orbit and a small
  /// lattice have one thread.
  ThreadCount(int threads, const Problem& problem);
  ThreadCount(const ThreadCount&) = delete;
  ThreadCount& operator=(const ThreadCount&) = delete;
  ~ThreadCount();

private:
  int before_;
};

}  // namespace rubato
