#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato {

/// Values of formulas of one graph, the value of variable number v being of(v). \return one number for each
[[nodiscard]] std::vector<double> values_at(std::span<const formula::Expression> formulas,
                                            const std::function<double(std::size_t)>& of);

/// Where random values of variables are taken, in this order: where functions of the language are mostly defined, and
/// where differences of them over h are small.
inline constexpr std::array<std::pair<double, double>, 2> ranges_of_values = {{{0.2, 1.2}, {0.68, 0.72}}};

/// True if a formula is 0, up to rounding beside the largest of `terms`, at several random values of its variables.
/// Where it is not defined it does not vanish.
[[nodiscard]] bool vanishes_at_random(formula::Expression formula, std::span<const formula::Expression> terms);

}  // namespace rubato
