#pragma once

#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// An error in a formula's text. what() is a complete message of several lines: what is wrong, the line of the formula
/// with a caret under the place, and, for a misspelt name, a suggestion. `offset` is the byte offset in the text.
class ParseError : public std::invalid_argument {
public:
  ParseError(std::string_view text, std::size_t offset, const std::string& reason);
  [[nodiscard]] std::size_t offset() const { return offset_; }
  [[nodiscard]] std::size_t line() const { return line_; }             ///< 1-based, in the formula
  [[nodiscard]] std::size_t column() const { return column_; }         ///< 1-based, in characters (UTF-8 code points)
  [[nodiscard]] const std::string& reason() const { return reason_; }  ///< one line, without the excerpt

private:
  std::size_t offset_, line_, column_;
  std::string reason_;
};

/// What a name in a formula stands for: the caller resolves names; std::nullopt means it is unknown.
using NameResolver = std::function<std::optional<Expression>(std::string_view name)>;

/// What a call of a name that is not a built-in function stands for, such as `dx(u)`; `argument` is parsed already.
using CallResolver =
    std::function<std::optional<Expression>(std::string_view name, std::span<const Expression> arguments)>;

struct ParseContext {
  NameResolver resolve;                      ///< required
  CallResolver call = {};                    ///< optional
  std::span<const std::string> known_names;  ///< for "did you mean …"
};

/// Reads a formula (docs/formulas.md): `+ - * / ^`, unary minus, parentheses, numbers, `pi`, the functions of the
/// language. `^` binds tighter than unary minus and associates to the right: -x^2 = -(x^2), 2^3^2 = 512.
/// `r[i]`, with an integer i that is known, is the name r1, r2, …; `sum(i, from, to, term)` the sum of the terms for
/// i = from, …, to, from left to right. `norm(r - s)` and `dot(r, s)` take vectors: r is r1, r2, … as far as there are
/// such names of one kind, variables or others, and r[2:4] a part of it. `where(a < b, f, g)` is f where the comparison
/// holds, else g. These words, and functions that yield (language.hpp), are so where nothing else has their name.
/// Nesting deeper than 1000 levels is an error, not a crash; long sums and products of any length are read.
/// \throws ParseError
[[nodiscard]] Expression parse(std::string_view text, Graph& graph, const ParseContext& context);

/// The same where every name is a variable of the graph listed in `names`.
[[nodiscard]] Expression parse(std::string_view text, Graph& graph, std::span<const std::string> names);

/// True if `name` matches `[A-Za-z_][A-Za-z0-9_]*` and is neither `pi` nor a function of the language.
[[nodiscard]] bool is_valid_name(std::string_view name);
/// True if `name` is a function of the language, or `pi`.
[[nodiscard]] bool is_reserved_name(std::string_view name);

/// The entry of `known` nearest to `name` (edit distance at most 2 and less than half the length), for "did you mean
/// …".
[[nodiscard]] std::optional<std::string> nearest_name(std::string_view name, std::span<const std::string> known);

}  // namespace rubato::formula
