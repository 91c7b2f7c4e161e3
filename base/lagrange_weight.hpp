#pragma once

#include <cstddef>

namespace rubato {

/// Lagrange's weight Π_{j≠i} (at - t_j)/(t_i - t_j) of the i-th of `count` samples, times `scale`.
/// \param time_of t_j, for j < count; all different
template <typename TimeOf>
[[nodiscard]] double lagrange_weight(std::size_t i, std::size_t count, double at, const TimeOf& time_of,
                                     double scale = 1.0) {
  double weight = scale;
  for (std::size_t j = 0; j < count; ++j) {
    if (j != i) {
      weight *= (at - time_of(j)) / (time_of(i) - time_of(j));
    }
  }
  return weight;
}

}  // namespace rubato
