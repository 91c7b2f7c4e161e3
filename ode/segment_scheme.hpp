#pragma once

#include <span>

#include <rubato/variation/level_scheme.hpp>

namespace rubato {

/// A time-stepping scheme for an orbit: what TimeLevels needs, and the state z = (q, p).
class SegmentScheme : public LevelScheme {
public:
  [[nodiscard]] virtual std::size_t dimension() const = 0;          ///< 2n
  [[nodiscard]] virtual std::span<const double> state() const = 0;  ///< z_k, rounded to double
};

}  // namespace rubato
