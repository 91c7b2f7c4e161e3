#pragma once

#include <span>
#include <string_view>

#include <rubato/formula/expression.hpp>

/// The words of the formula language, in tables: what the parser knows is what `rubato help formulas` prints.
namespace rubato::formula {

/// A function; `variadic` takes two or more arguments.
struct Function {
  std::string_view name;
  Operation operation;
  std::string_view meaning;
  std::string_view domain = "";  ///< where it is defined, if not everywhere
  bool variadic = false;
  std::string_view arguments = "x";  ///< as help writes them
  /// True if it gives way: a problem may have something of that name, and then it is no function there. So are all that
  /// came later than the first ones, and files that were written before them are read as they were.
  bool yields = false;
};
[[nodiscard]] std::span<const Function> functions();

/// A word that is read like a function, but takes more than formulas: sum, where, norm, dot, and what is made of known
/// numbers. All of them give way.
struct Word {
  std::string_view name;
  std::string_view arguments;
  std::string_view meaning;
};
[[nodiscard]] std::span<const Word> words();

/// An operator between two operands. The greater its strength, the tighter it binds.
struct Operator {
  char symbol;
  int strength;
  bool to_the_right;  ///< a op b op c is a op (b op c)
  std::string_view meaning;
};
[[nodiscard]] std::span<const Operator> operators();
/// A minus sign before an operand binds looser than ^, and tighter than everything else.
inline constexpr int strength_of_sum = 1;
inline constexpr int strength_of_product = 2;
inline constexpr int strength_of_power = 3;

struct Constant {
  std::string_view name;
  double value;
  std::string_view meaning;
};
[[nodiscard]] std::span<const Constant> constants();

/// The entry of that name or symbol; null if there is none.
///@{
[[nodiscard]] const Function* find_function(std::string_view name);
[[nodiscard]] const Word* find_word(std::string_view name);
[[nodiscard]] const Operator* find_operator(char symbol);
[[nodiscard]] const Constant* find_constant(std::string_view name);

/// What to write here for a name that other languages have, such as pow or ln; empty if there is nothing to say.
[[nodiscard]] std::string_view foreign_advice(std::string_view name);
///@}

}  // namespace rubato::formula
