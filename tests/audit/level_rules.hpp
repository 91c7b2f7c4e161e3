#pragma once

#include <cstddef>

namespace audit {

/// What a problem says of its levels.
struct LevelRules {
  double start = 0.0, until = 0.0;
  double step = 0.0;  ///< the first one; 0 where the run chose it
  double tolerance = 1e-13;
  bool fixed = false;
  std::size_t every = 1;
};

}  // namespace audit
