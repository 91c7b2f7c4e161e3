#pragma once

#include <optional>

#include <rubato/formula/expression.hpp>

namespace rubato {

/// ∫ e du in closed form: sums of multiples of 1, u, and powers, sqrt, exp, log, sin, cos, tan, sinh, cosh and tanh of
/// a u + b, of min and max of 0 and a u + b, of polynomials divided by powers of a u + b, and of u times any of these
/// with u² in place of u.
[[nodiscard]] std::optional<formula::Expression> antiderivative(formula::Expression e, formula::Expression u);

}  // namespace rubato
