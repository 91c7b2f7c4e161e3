#pragma once

namespace rubato {

/// Which way a step or a branch leads: -1 for negative x, else 1.
inline double sign(double x) {
  return x < 0.0 ? -1.0 : 1.0;
}

}  // namespace rubato
