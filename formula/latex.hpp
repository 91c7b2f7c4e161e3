#pragma once

#include <string>
#include <string_view>

#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// The expression as LaTeX, for mathematics mode: fractions, powers, functions by their usual signs, names of Greek
/// letters as these, and what follows the first _ of a name as its index ("u_xt", "potential_u").
[[nodiscard]] std::string to_latex(Expression expression);
/// A name alone.
[[nodiscard]] std::string latex_name(std::string_view name);

}  // namespace rubato::formula
