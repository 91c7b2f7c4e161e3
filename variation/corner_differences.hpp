#pragma once

#include <vector>

#include <rubato/variation/corner_density.hpp>

namespace rubato {

/// True if L is the same where a constant is added to the field: it reads differences of corners alone.
[[nodiscard]] bool reads_differences(const CornerDensity& density, int field);

/// L as it reads differences alone of some fields, where divergences can be taken from it that do this: what is taken
/// is Σ_c a_c f_c g_c with Σ_c a_c = 0, as ½ (φ w)_x is of ½ (φ w_x - φ_x w), and no row of the variation or energy
/// knows of it. \param of_fields one entry for each field; empty: none
[[nodiscard]] CornerDensity by_differences(CornerDensity density, const std::vector<bool>& of_fields);

}  // namespace rubato
