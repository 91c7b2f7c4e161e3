#pragma once

#include <cstddef>
#include <span>

namespace rubato::solve {

/// Orthonormalises `count` columns in their order, by Gram and Schmidt, twice; `logarithms` gets ln r_ii of V = QR.
/// \return false if a column depends on those before it, or is not finite
[[nodiscard]] bool orthonormalise(std::span<double> columns, std::size_t count, std::span<double> logarithms);

}  // namespace rubato::solve
