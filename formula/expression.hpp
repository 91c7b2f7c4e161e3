#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <unordered_map>
#include <vector>

/// The user's formulas: one hash-consed graph from which values, derivatives and Taylor series are taken.
namespace rubato::formula {

/// What a node of the graph computes from its arguments.
enum class Operation : std::uint8_t {
  constant,
  variable,
  add,
  subtract,
  multiply,
  divide,
  negate,
  power,
#define RUBATO_FUNCTION(id, ...) id,
#include <rubato/formula/operations.inc>
  where_positive,  ///< b where a > 0, else 0
  where_negative,  ///< 0 where a > 0, else b; both are undefined where a is
  list,            ///< the list a (or the constant 0, an empty one), then b
  loop,            ///< all outputs of the loop number `value` of the graph (loop.hpp), of the list of arguments a
  component,       ///< output number `value` of the loop a
};

/// Number of arguments of an operation: 0, 1 or 2.
[[nodiscard]] int arity(Operation operation);
/// The name a user writes: "sin", "+", …
[[nodiscard]] std::string_view name(Operation operation);

using NodeIndex = std::uint32_t;

struct Node {
  Operation operation;
  NodeIndex a = 0;     ///< first argument; for a variable, its number
  NodeIndex b = 0;     ///< second argument
  double value = 0.0;  ///< of a constant; the number of a loop or a component
};

class Graph;
struct Loop;

/// A formula: a node of a graph. Copied freely; valid while its graph lives.
///
/// Arithmetic and the functions of the formula language are overloaded for it (found by argument-dependent look-up), so
/// that a generic lambda called with Expressions records itself in the graph.
class Expression {
public:
  Expression() = default;
  Expression(Graph* graph, NodeIndex index) : graph_(graph), index_(index) {}
  [[nodiscard]] Graph* graph() const { return graph_; }
  [[nodiscard]] NodeIndex index() const { return index_; }
  [[nodiscard]] bool valid() const { return graph_ != nullptr; }
  [[nodiscard]] bool is_constant() const;
  [[nodiscard]] bool is_constant(double value) const;  ///< bitwise for zero: -0 is not 0
  [[nodiscard]] double constant_value() const;         ///< throws std::invalid_argument unless is_constant()
  friend bool operator==(const Expression&, const Expression&) = default;

private:
  Graph* graph_ = nullptr;
  NodeIndex index_ = 0;
};

/// The arena in which expressions live. A node is made after its arguments, so indices are a topological order, and
/// equal nodes are made once (hash-consing), so common subexpressions are shared by construction.
///
/// Simplifications never change the domain of a formula: `x + 0`, `1*x`, `x/1`, `x^1`, `--x` and constant folding (when
/// the result is finite) are made; `0*x`, `x - x`, `x/x` and `sqrt(x)^2` are left as they stand.
/// Not thread-safe while being added to; const use from many threads is.
class Graph {
public:
  Graph();
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;

  /// The variable called `name`, made at its first mention. Variables are numbered in the order they are made.
  Expression variable(std::string_view name);
  Expression constant(double value);
  Expression make(Operation operation, Expression a);
  Expression make(Operation operation, Expression a, Expression b);
  /// The outputs of `loop` at these arguments, each as an expression.
  std::vector<Expression> make(const std::shared_ptr<const Loop>& loop, std::span<const Expression> arguments);
  /// The node of a list, a loop or a component of `source`, at these arguments of this graph.
  Expression make(const Graph& source, const Node& node, Expression a, Expression b);
  /// Loop of a node `loop`, and its arguments.
  ///@{
  [[nodiscard]] const std::shared_ptr<const Loop>& loop(const Node& node) const;
  [[nodiscard]] std::vector<Expression> arguments(const Node& node);
  ///@}
  [[nodiscard]] bool has_loops() const { return !loops_.empty(); }

  [[nodiscard]] std::size_t size() const { return nodes_.size(); }
  [[nodiscard]] const Node& node(NodeIndex index) const { return nodes_[index]; }
  [[nodiscard]] std::size_t variable_count() const { return variable_names_.size(); }
  [[nodiscard]] const std::string& variable_name(std::size_t number) const { return variable_names_[number]; }

  /// The node `operation(a, b)` as it stands, if it has been made already.
  [[nodiscard]] std::optional<NodeIndex> find(Operation operation, NodeIndex a, NodeIndex b) const;

private:
  [[nodiscard]] std::size_t slot_of(const Node& node) const;
  NodeIndex intern(const Node& node);
  double number_of(const std::shared_ptr<const Loop>& loop);
  void grow_table();
  Expression at(NodeIndex index) { return {this, index}; }
  void check_owner(Expression a) const;
  Expression make_add(Expression a, Expression b);
  Expression make_subtract(Expression a, Expression b);
  Expression make_multiply(Expression a, Expression b);
  Expression make_divide(Expression a, Expression b);
  Expression make_power(Expression a, Expression b);
  Expression first_orientation(Expression a);
  Expression make_bessel(Operation operation, Expression order, Expression x);
  void check_elliptic_parameter(Expression m) const;

  std::vector<Node> nodes_;
  std::vector<NodeIndex> table_;  ///< open-addressed hash table of the nodes; its size is a power of two
  std::vector<std::string> variable_names_;
  std::unordered_map<std::string, NodeIndex> variables_;
  std::vector<std::shared_ptr<const Loop>> loops_;
};

// ---- building -------------------------------------------------------------------------------------------------------

Expression operator+(Expression a, Expression b);
Expression operator-(Expression a, Expression b);
Expression operator*(Expression a, Expression b);
Expression operator/(Expression a, Expression b);
Expression operator-(Expression a);
Expression operator+(Expression a);

template <typename Number>
concept Scalar = std::is_arithmetic_v<Number>;

Expression constant_like(Expression a, double value);  ///< a constant in the graph of `a`

// clang-format off
template <Scalar N> Expression operator+(Expression a, N b) { return a + constant_like(a, static_cast<double>(b)); }
template <Scalar N> Expression operator+(N a, Expression b) { return constant_like(b, static_cast<double>(a)) + b; }
template <Scalar N> Expression operator-(Expression a, N b) { return a - constant_like(a, static_cast<double>(b)); }
template <Scalar N> Expression operator-(N a, Expression b) { return constant_like(b, static_cast<double>(a)) - b; }
template <Scalar N> Expression operator*(Expression a, N b) { return a * constant_like(a, static_cast<double>(b)); }
template <Scalar N> Expression operator*(N a, Expression b) { return constant_like(b, static_cast<double>(a)) * b; }
template <Scalar N> Expression operator/(Expression a, N b) { return a / constant_like(a, static_cast<double>(b)); }
template <Scalar N> Expression operator/(N a, Expression b) { return constant_like(b, static_cast<double>(a)) / b; }

template <typename T> Expression& operator+=(Expression& a, T b) { return a = a + b; }
template <typename T> Expression& operator-=(Expression& a, T b) { return a = a - b; }
template <typename T> Expression& operator*=(Expression& a, T b) { return a = a * b; }
template <typename T> Expression& operator/=(Expression& a, T b) { return a = a / b; }
// clang-format on

Expression pow(Expression base, Expression exponent);
Expression pow(Expression base, double exponent);
/// The functions of operations.inc. Bessel's are of an integer order n, Jacobi's of the parameter m = k².
/// \throws std::invalid_argument if n is no integer or larger than 1000, and unless 0 <= m <= 1
///@{
#define RUBATO_DECLARE_one(name) Expression name(Expression a);
#define RUBATO_DECLARE_two(name) Expression name(Expression a, Expression b);
#define RUBATO_DECLARE_several(name) Expression name(Expression a, Expression b);
#define RUBATO_DECLARE_order(name) Expression name(double n, Expression x);
#define RUBATO_DECLARE_parameter(name) Expression name(Expression u, double m);
#define RUBATO_FUNCTION(id, name, form, ...) RUBATO_DECLARE_##form(name)
#include <rubato/formula/operations.inc>
#undef RUBATO_DECLARE_one
#undef RUBATO_DECLARE_two
#undef RUBATO_DECLARE_several
#undef RUBATO_DECLARE_order
#undef RUBATO_DECLARE_parameter
///@}

/// A comparison: `difference` > 0, or, `or_equal`, not its opposite > 0.
struct Condition {
  Expression difference;
  bool or_equal = false;
};
// clang-format off
inline Condition operator>(Expression a, Expression b) { return {a - b}; }
inline Condition operator<(Expression a, Expression b) { return {b - a}; }
inline Condition operator>=(Expression a, Expression b) { return {b - a, true}; }
inline Condition operator<=(Expression a, Expression b) { return {a - b, true}; }
template <Scalar N> Condition operator>(Expression a, N b) { return a > constant_like(a, static_cast<double>(b)); }
template <Scalar N> Condition operator<(Expression a, N b) { return a < constant_like(a, static_cast<double>(b)); }
template <Scalar N> Condition operator>=(Expression a, N b) { return a >= constant_like(a, static_cast<double>(b)); }
template <Scalar N> Condition operator<=(Expression a, N b) { return a <= constant_like(a, static_cast<double>(b)); }
// clang-format on
/// `a` where the condition holds, else `b`; undefined where a side of the condition is. Only the one that holds need be
/// defined, and so are its derivatives, which know nothing of a jump between the two: a formula is as smooth as `a` and
/// `b` fit together.
Expression where(Condition condition, Expression a, Expression b);

// ---- using ----------------------------------------------------------------------------------------------------------

/// Infix text that parse() reads back to the same expression (numbers with 17 significant digits).
[[nodiscard]] std::string to_string(Expression expression);

/// Numbers of the variables on which `expression` depends, ascending.
[[nodiscard]] std::vector<std::size_t> variables_of(Expression expression);

/// `expression` with each `from[i]` (variables, or other parts, of its graph) replaced by `to[i]`, the largest parts
/// first; all `to` in one graph, which may be another one: then every variable not replaced is carried over by name.
[[nodiscard]] Expression substitute(Expression expression, std::span<const Expression> from,
                                    std::span<const Expression> to);
/// The same for several expressions at once, sharing what they share. `into` is the graph of the results.
[[nodiscard]] std::vector<Expression> substitute(std::span<const Expression> expressions, Graph& into,
                                                 std::span<const Expression> from, std::span<const Expression> to);

/// Gradient of `expression` with respect to `variables` by one reverse sweep; the entry of a variable on which it does
/// not depend is the constant 0. At kinks (`abs`, `min`, `max`, `sign`) the mean of the one-sided derivatives is taken.
[[nodiscard]] std::vector<Expression> gradient(Expression expression, std::span<const Expression> variables);

/// Upper triangle, row by row, of the Hessian with respect to `variables` (size n): n(n+1)/2 expressions, by one
/// reverse sweep that pushes second-order adjoints. An entry that vanishes identically is the constant 0. The entries
/// share their parts with each other and with the gradient.
[[nodiscard]] std::vector<Expression> hessian_upper(Expression expression, std::span<const Expression> variables);

/// An entry of a Hessian: row <= column, the places of two variables.
struct HessianEntry {
  std::size_t row, column;
  Expression value;
};
/// The entries of hessian_upper() that do not vanish identically, row by row: of a chain their number grows like n.
[[nodiscard]] std::vector<HessianEntry> hessian_entries(Expression expression, std::span<const Expression> variables);

/// Derivative of `expression` with respect to one variable: gradient() of one variable.
[[nodiscard]] Expression derivative(Expression expression, Expression variable);

}  // namespace rubato::formula
