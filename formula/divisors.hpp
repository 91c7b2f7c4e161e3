#pragma once

#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// Where a formula may have poles that an orbit cannot go round: factors of divisors, of bases of negative powers and
/// of what tan and csch divide by, that may change their sign. Squares, roots and absolute values stand for what they
/// are of, so that 1/|x - y| and 1/(x - y)^2 have x - y; 1/(x^2 + y^2) has none, since a point is gone round. Divisors
/// within loops are not seen.
[[nodiscard]] std::vector<Expression> divisors_of(Expression formula);

}  // namespace rubato::formula
