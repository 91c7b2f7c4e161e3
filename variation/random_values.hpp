#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato {

/// Values of formulas of one graph, the value of variable number v being of(v). \return one number for each
[[nodiscard]] std::vector<double> values_at(std::span<const formula::Expression> formulas,
                                            const std::function<double(std::size_t)>& of);

/// True if a formula is 0, up to rounding beside the largest of `terms`, at several random values of its variables,
/// between 0.2 and 1.2: where functions of the language are mostly defined. Where it is not defined it does not vanish.
[[nodiscard]] bool vanishes_at_random(formula::Expression formula, std::span<const formula::Expression> terms);

}  // namespace rubato
