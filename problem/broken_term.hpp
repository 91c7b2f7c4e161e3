#pragma once

#include <functional>
#include <optional>
#include <string>

#include <rubato/formula/changed_term.hpp>
#include <rubato/formula/expression.hpp>

namespace rubato {

/// The value of a variable before the seam.
using ValueOfVariable = std::function<double(const std::string& name)>;
/// The value of a variable behind the seam, made of those before it.
using ImageOfVariable = std::function<double(const std::string& name, const ValueOfVariable& before)>;

/// Looks for a term of a formula that is not the same on both sides of the seam of a grid, at random values; nothing
/// where the formula is the same.
[[nodiscard]] std::optional<formula::ChangedTerm> find_broken_term(formula::Expression formula,
                                                                   const ImageOfVariable& image);

}  // namespace rubato
