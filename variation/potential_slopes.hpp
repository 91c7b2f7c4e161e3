#pragma once

#include <cstddef>
#include <vector>

namespace rubato {

/// The linear parts of potentials, z = slope·x + periodic: what is added to D_x z. One value for each line of cells
/// along x (a single one in one dimension), for the fields that have a slope.
struct PotentialSlopes {
  std::vector<std::vector<double>> of_field;  ///< empty for a field without slope, else one value for each line

  [[nodiscard]] double at(int field, std::size_t line) const {
    const auto f = static_cast<std::size_t>(field);
    return f >= of_field.size() || of_field[f].empty() ? 0.0 : of_field[f][line];
  }
};

}  // namespace rubato
