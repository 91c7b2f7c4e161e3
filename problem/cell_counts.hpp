#pragma once

#include <rubato/problem/document.hpp>

namespace rubato {

/// Puts the number in the place of every `cells = "about N"` of [grid]: the one nearest to N that the scheme of
/// [scheme] takes and is quick with (LatticeMethod::count_near).
/// \return whether there was any \throws ProblemError if N is no whole number from 3 on
[[nodiscard]] bool choose_cells(Value& root);

}  // namespace rubato
