#pragma once

#include <cstddef>
#include <type_traits>

namespace rubato {

/// Lagrange's weight Π_{j≠i} (at - t_j)/(t_i - t_j) of the i-th of `count` samples, times `scale`: ℓ_i(at).
/// \param time_of t_j, for j < count; all different
template <typename Real, typename TimeOf>
[[nodiscard]] Real lagrange_weight(std::size_t i, std::size_t count, Real at, const TimeOf& time_of,
                                   std::type_identity_t<Real> scale = 1) {
  Real weight = scale;
  for (std::size_t j = 0; j < count; ++j) {
    if (j != i) {
      weight *= (at - time_of(j)) / (time_of(i) - time_of(j));
    }
  }
  return weight;
}

}  // namespace rubato
