#pragma once

#include <functional>
#include <optional>
#include <string>

#include <rubato/formula/expression.hpp>

namespace rubato {

/// A term of a formula that is not the same on both sides of the seam of a grid, with the values that it has there.
struct BrokenTerm {
  std::string term;
  double before = 0.0, after = 0.0;
};

/// The value of a variable before the seam.
using ValueOfVariable = std::function<double(const std::string& name)>;
/// The value of a variable behind the seam, made of those before it.
using ImageOfVariable = std::function<double(const std::string& name, const ValueOfVariable& before)>;

/// Looks for such a term at random values, on other branches (formula/branches.hpp); nothing where the formula is the
/// same.
[[nodiscard]] std::optional<BrokenTerm> find_broken_term(formula::Expression formula, const ImageOfVariable& image);

}  // namespace rubato
