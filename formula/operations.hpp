#pragma once

#include <string_view>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>

/// What is known of each operation of the formula language; of functions, the rows of operations.inc.
namespace rubato::formula {

/// The arguments of a function: one, two, two or more of the same kind; a number n, the order, and x; u and a number m.
enum class Form { one, two, several, order, parameter };
[[nodiscard]] constexpr int arity_of(Form form) {
  return form == Form::one ? 1 : 2;
}

enum class Symmetry { none, even, odd };

struct OperationTraits {
  std::string_view name;
  int arity = 0;
  Form form = Form::two;
  Symmetry symmetry = Symmetry::none;
  bool is_called = false;  ///< of a function: none of the machine's own instructions does it
};
[[nodiscard]] const OperationTraits& traits_of(Operation operation);
/// Of a function's instruction.
[[nodiscard]] Form form_of(OpCode code);

}  // namespace rubato::formula
