#include <rubato/formula/expression.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/loop.hpp>
#include <rubato/formula/operations.hpp>
#include <rubato/formula/special.hpp>

namespace rubato::formula {

namespace {

constexpr std::array<OperationTraits, 8> arithmetic{
    {{"constant", 0}, {"variable", 0}, {"+", 2}, {"-", 2}, {"*", 2}, {"/", 2}, {"-", 1}, {"^", 2}}};
enum class Is { called, machine };
constexpr std::array functions_of_users = {
#define RUBATO_FUNCTION(id, name, form, is, symmetry, ...) \
  OperationTraits{#name, arity_of(Form::form), Form::form, Symmetry::symmetry, Is::is == Is::called},
#include <rubato/formula/operations.inc>
};
static_assert(arithmetic.size() == static_cast<std::size_t>(Operation::power) + 1);
static_assert(arithmetic.size() + functions_of_users.size() == static_cast<std::size_t>(Operation::where_positive));
constexpr std::array<OperationTraits, 5> others{
    {{"where", 2}, {"where", 2}, {"list", 2}, {"loop", 1}, {"component", 1}}};

constexpr NodeIndex no_node = std::numeric_limits<NodeIndex>::max();

bool same_node(const Node& x, const Node& y) {
  return x.operation == y.operation && x.a == y.a && x.b == y.b &&
         std::bit_cast<std::uint64_t>(x.value) == std::bit_cast<std::uint64_t>(y.value);
}

std::size_t hash(const Node& node) {
  // Multiply-and-fold by odd constants: every input bit reaches the low bits that the table uses.
  const auto mix = [](std::uint64_t h) {
    h *= 0x9e3779b97f4a7c15U;
    return h ^ (h >> 32U);
  };
  std::uint64_t h = mix((std::uint64_t{node.a} << 32U) | node.b);
  h = mix(h ^ std::bit_cast<std::uint64_t>(node.value));
  return static_cast<std::size_t>(mix(h + static_cast<std::uint64_t>(node.operation)));
}

}  // namespace

const OperationTraits& traits_of(Operation operation) {
  const auto number = static_cast<std::size_t>(operation);
  const std::size_t of_table = number - arithmetic.size();
  return number < arithmetic.size()             ? arithmetic[number]
         : of_table < functions_of_users.size() ? functions_of_users[of_table]
                                                : others[of_table - functions_of_users.size()];
}

int arity(Operation operation) {
  return traits_of(operation).arity;
}

std::string_view name(Operation operation) {
  return traits_of(operation).name;
}

double apply(Operation operation, double a, double b) {
  switch (operation) {
    case Operation::constant:
    case Operation::variable: break;
    case Operation::add: return a + b;
    case Operation::subtract: return a - b;
    case Operation::multiply: return a * b;
    case Operation::divide: return a / b;
    case Operation::negate: return -a;
    case Operation::power:
      return std::pow(a, b);
// clang-format off
#define RUBATO_FUNCTION(id, name, form, is, symmetry, value, ...) case Operation::id: return value;
#include <rubato/formula/operations.inc>
      // clang-format on
    case Operation::where_positive: return where_positive(a, b);
    case Operation::where_negative: return where_negative(a, b);
    case Operation::list:
    case Operation::loop:
    case Operation::component: break;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

// ---- Expression -----------------------------------------------------------------------------------------------------

bool Expression::is_constant() const {
  return graph_ != nullptr && graph_->node(index_).operation == Operation::constant;
}

bool Expression::is_constant(double value) const {
  return is_constant() &&
         std::bit_cast<std::uint64_t>(graph_->node(index_).value) == std::bit_cast<std::uint64_t>(value);
}

double Expression::constant_value() const {
  if (!is_constant()) {
    throw std::invalid_argument("constant_value: the expression is not a constant");
  }
  return graph_->node(index_).value;
}

// ---- Graph ----------------------------------------------------------------------------------------------------------

Graph::Graph() : table_(64, no_node) {}

/// The place in the table where `node` is, or where it would go.
std::size_t Graph::slot_of(const Node& node) const {
  const std::size_t mask = table_.size() - 1;
  std::size_t slot = hash(node) & mask;
  while (table_[slot] != no_node && !same_node(nodes_[table_[slot]], node)) {
    slot = (slot + 1) & mask;
  }
  return slot;
}

void Graph::grow_table() {
  table_.assign(2 * table_.size(), no_node);
  for (NodeIndex index = 0; index < nodes_.size(); ++index) {
    table_[slot_of(nodes_[index])] = index;
  }
}

NodeIndex Graph::intern(const Node& node) {
  const std::size_t slot = slot_of(node);
  if (table_[slot] != no_node) {
    return table_[slot];
  }
  if (nodes_.size() >= no_node) {
    throw std::length_error("a formula graph holds at most 4294967295 nodes");
  }
  const auto index = static_cast<NodeIndex>(nodes_.size());
  nodes_.push_back(node);
  table_[slot] = index;
  if (2 * nodes_.size() > table_.size()) {
    grow_table();
  }
  return index;
}

std::optional<NodeIndex> Graph::find(Operation operation, NodeIndex a, NodeIndex b) const {
  const NodeIndex index = table_[slot_of({operation, a, b})];
  return index == no_node ? std::nullopt : std::optional(index);
}

Expression Graph::variable(std::string_view name) {
  const auto [entry, is_new] = variables_.try_emplace(std::string(name), NodeIndex{0});
  if (is_new) {
    const auto number = static_cast<NodeIndex>(variable_names_.size());
    variable_names_.emplace_back(name);
    entry->second = intern({Operation::variable, number});
  }
  return at(entry->second);
}

Expression Graph::constant(double value) {
  if (!std::isfinite(value)) {
    throw std::invalid_argument(fmt::format("a constant of a formula must be finite, got {}", value));
  }
  return at(intern({Operation::constant, 0, 0, value}));
}

void Graph::check_owner(Expression a) const {
  if (a.graph() != this) {
    throw std::invalid_argument(a.valid() ? "expressions of different graphs cannot be combined"
                                          : "an empty expression cannot be an argument");
  }
}

/// For an argument of an even function: of x - y and y - x, the one that was made first, so that both are shared.
Expression Graph::first_orientation(Expression a) {
  const Node node = nodes_[a.index()];
  if (node.operation == Operation::negate) {
    return at(node.a);
  }
  if (node.operation == Operation::subtract) {
    if (const auto reversed = find(Operation::subtract, node.b, node.a); reversed && *reversed < a.index()) {
      return at(*reversed);
    }
  }
  return a;
}

Expression Graph::make(Operation operation, Expression a) {
  check_owner(a);
  if (arity(operation) != 1) {
    throw std::invalid_argument(fmt::format("'{}' does not take one argument", name(operation)));
  }
  const Node node = nodes_[a.index()];
  if (node.operation == Operation::constant) {
    if (const double value = apply(operation, node.value); std::isfinite(value)) {
      return constant(value);
    }
  }
  if (operation == Operation::negate) {
    if (node.operation == Operation::negate) {
      return at(node.a);
    }
    // -(c·x) and -(c/x) keep their sign in the constant.
    if ((node.operation == Operation::multiply || node.operation == Operation::divide) && at(node.a).is_constant()) {
      return make(node.operation, constant(-nodes_[node.a].value), at(node.b));
    }
  } else if (traits_of(operation).symmetry == Symmetry::even) {
    a = first_orientation(a);
  } else if (traits_of(operation).symmetry == Symmetry::odd && node.operation == Operation::negate) {
    return -make(operation, at(node.a));
  }
  return at(intern({operation, a.index()}));
}

Expression Graph::make(Operation operation, Expression a, Expression b) {
  check_owner(a);
  check_owner(b);
  if (arity(operation) != 2) {
    throw std::invalid_argument(fmt::format("'{}' does not take two arguments", name(operation)));
  }
  if (operation >= Operation::bessel_j && operation <= Operation::bessel_k) {
    return make_bessel(operation, a, b);
  }
  if (operation >= Operation::jacobi_sn && operation <= Operation::jacobi_am) {
    check_elliptic_parameter(b);
  }
  if (a.is_constant() && b.is_constant()) {
    const double value = apply(operation, a.constant_value(), b.constant_value());
    if (std::isfinite(value)) {
      return constant(value);
    }
  }
  switch (operation) {
    case Operation::add: return make_add(a, b);
    case Operation::subtract: return make_subtract(a, b);
    case Operation::multiply: return make_multiply(a, b);
    case Operation::divide: return make_divide(a, b);
    case Operation::power: return make_power(a, b);
    case Operation::min:
    case Operation::max:
      if (a == b) {
        return a;
      }
      if (b.index() < a.index()) {
        std::swap(a, b);
      }
      break;
    case Operation::where_positive:
    case Operation::where_negative:
      if (a.is_constant()) {
        return (a.constant_value() > 0.0) == (operation == Operation::where_positive) ? b : constant(0.0);
      }
      break;
    default: break;
  }
  return at(intern({operation, a.index(), b.index()}));
}

double Graph::number_of(const std::shared_ptr<const Loop>& loop) {
  const auto found = std::ranges::find(loops_, loop);
  const auto number = static_cast<double>(found - loops_.begin());
  if (found == loops_.end()) {
    loops_.push_back(loop);
  }
  return number;
}

std::vector<Expression> Graph::make(const std::shared_ptr<const Loop>& loop, std::span<const Expression> arguments) {
  NodeIndex list = constant(0.0).index();
  for (const Expression argument : arguments) {
    check_owner(argument);
    list = intern({Operation::list, list, argument.index()});
  }
  const NodeIndex node = intern({Operation::loop, list, 0, number_of(loop)});
  std::vector<Expression> outputs;
  for (std::size_t i = 0; i < loop->output_count; ++i) {
    outputs.push_back(at(intern({Operation::component, node, 0, static_cast<double>(i)})));
  }
  return outputs;
}

Expression Graph::make(const Graph& source, const Node& node, Expression a, Expression b) {
  const double value = node.operation == Operation::loop ? number_of(source.loop(node)) : node.value;
  return at(intern({node.operation, a.index(), node.operation == Operation::list ? b.index() : 0, value}));
}

const std::shared_ptr<const Loop>& Graph::loop(const Node& node) const {
  return loops_[static_cast<std::size_t>(node.value)];
}

std::vector<Expression> Graph::arguments(const Node& node) {
  std::vector<Expression> all;
  for (Node list = nodes_[node.a]; list.operation == Operation::list; list = nodes_[list.a]) {
    all.push_back(at(list.b));
  }
  std::ranges::reverse(all);
  return all;
}

/// Of negative orders: J_{-n} = (-1)^n J_n, and so Y; I_{-n} = I_n, and so K.
Expression Graph::make_bessel(Operation operation, Expression order, Expression x) {
  if (!order.is_constant() || !is_bessel_order(order.constant_value())) {
    throw std::invalid_argument(
        fmt::format("the order of {} has to be an integer that is known beforehand, from -1000 to 1000{}",
                    name(operation), order.is_constant() ? fmt::format(", and is {}", order.constant_value()) : ""));
  }
  const double n = order.constant_value();
  if (x.is_constant()) {
    if (const double value = apply(operation, n, x.constant_value()); std::isfinite(value)) {
      return constant(value);
    }
  }
  const Expression result = at(intern({operation, constant(std::abs(n)).index(), x.index()}));
  const bool alternates = operation == Operation::bessel_j || operation == Operation::bessel_y;
  return n < 0.0 && alternates && std::fmod(n, 2.0) != 0.0 ? -result : result;
}

void Graph::check_elliptic_parameter(Expression m) const {
  if (!m.is_constant() || !(m.constant_value() >= 0.0 && m.constant_value() <= 1.0)) {
    throw std::invalid_argument(fmt::format(
        "the parameter m of an elliptic function has to be a number that is known beforehand, from 0 to 1{}",
        m.is_constant() ? fmt::format(", and is {}", m.constant_value()) : ""));
  }
}

Expression Graph::make_add(Expression a, Expression b) {
  if (a.is_constant() || (!b.is_constant() && b.index() < a.index())) {
    std::swap(a, b);  // canonical: a constant last, else in the order of making
  }
  const Node first = nodes_[a.index()];
  const Node second = nodes_[b.index()];
  if (second.operation == Operation::constant) {
    if (second.value == 0.0) {
      return a;
    }
    if (second.value < 0.0 && first.operation != Operation::constant) {
      return at(intern({Operation::subtract, a.index(), constant(-second.value).index()}));
    }
  }
  if (a == b) {
    return make(Operation::multiply, constant(2.0), a);
  }
  if (second.operation == Operation::negate) {
    return make(Operation::subtract, a, at(second.a));
  }
  if (first.operation == Operation::negate) {
    return make(Operation::subtract, b, at(first.a));
  }
  return at(intern({Operation::add, a.index(), b.index()}));
}

Expression Graph::make_subtract(Expression a, Expression b) {
  const Node second = nodes_[b.index()];
  if (second.operation == Operation::constant) {
    if (second.value == 0.0) {
      return a;
    }
    if (second.value < 0.0) {
      return make(Operation::add, a, constant(-second.value));
    }
  }
  if (second.operation == Operation::negate) {
    return make(Operation::add, a, at(second.a));
  }
  return at(intern({Operation::subtract, a.index(), b.index()}));
}

Expression Graph::make_multiply(Expression a, Expression b) {
  if (b.is_constant() || (!a.is_constant() && b.index() < a.index())) {
    std::swap(a, b);  // canonical: a constant first, else in the order of making
  }
  if (a.is_constant(1.0)) {
    return b;
  }
  if (a.is_constant(-1.0)) {
    return make(Operation::negate, b);
  }
  const Node first = nodes_[a.index()];
  const Node second = nodes_[b.index()];
  if (second.operation == Operation::negate) {
    return make(Operation::negate, make(Operation::multiply, a, at(second.a)));
  }
  if (first.operation == Operation::negate) {
    return make(Operation::negate, make(Operation::multiply, at(first.a), b));
  }
  if (a == b) {
    return make(Operation::power, a, constant(2.0));
  }
  return at(intern({Operation::multiply, a.index(), b.index()}));
}

Expression Graph::make_divide(Expression a, Expression b) {
  const Node first = nodes_[a.index()];
  const Node second = nodes_[b.index()];
  if (b.is_constant(1.0)) {
    return a;
  }
  if (second.operation == Operation::constant && second.value < 0.0 && first.operation != Operation::constant) {
    return make(Operation::negate, make(Operation::divide, a, constant(-second.value)));
  }
  if (first.operation == Operation::negate) {
    return make(Operation::negate, make(Operation::divide, at(first.a), b));
  }
  if (second.operation == Operation::negate) {
    return make(Operation::negate, make(Operation::divide, a, at(second.a)));
  }
  return at(intern({Operation::divide, a.index(), b.index()}));
}

Expression Graph::make_power(Expression a, Expression b) {
  if (b.is_constant(1.0)) {
    return a;
  }
  if (b.is_constant() && std::fmod(b.constant_value(), 2.0) == 0.0) {
    a = first_orientation(a);
  }
  return at(intern({Operation::power, a.index(), b.index()}));
}

// ---- building -------------------------------------------------------------------------------------------------------

namespace {

Graph& graph_of(Expression a) {
  if (!a.valid()) {
    throw std::invalid_argument("an empty expression cannot be an argument");
  }
  return *a.graph();
}

Expression unary(Operation operation, Expression a) {
  return graph_of(a).make(operation, a);
}
Expression binary(Operation operation, Expression a, Expression b) {
  return graph_of(a).make(operation, a, b);
}

}  // namespace

Expression constant_like(Expression a, double value) {
  return graph_of(a).constant(value);
}

Expression operator+(Expression a, Expression b) {
  return binary(Operation::add, a, b);
}
Expression operator-(Expression a, Expression b) {
  return binary(Operation::subtract, a, b);
}
Expression operator*(Expression a, Expression b) {
  return binary(Operation::multiply, a, b);
}
Expression operator/(Expression a, Expression b) {
  return binary(Operation::divide, a, b);
}
Expression operator-(Expression a) {
  return unary(Operation::negate, a);
}
Expression operator+(Expression a) {
  return a;
}
Expression pow(Expression base, Expression exponent) {
  return binary(Operation::power, base, exponent);
}
Expression pow(Expression base, double exponent) {
  return pow(base, constant_like(base, exponent));
}
#define RUBATO_DEFINE_one(name, id) \
  Expression name(Expression a) {   \
    return unary(Operation::id, a); \
  }
#define RUBATO_DEFINE_two(name, id)             \
  Expression name(Expression a, Expression b) { \
    return binary(Operation::id, a, b);         \
  }
#define RUBATO_DEFINE_several(name, id) RUBATO_DEFINE_two(name, id)
#define RUBATO_DEFINE_order(name, id)                     \
  Expression name(double n, Expression x) {               \
    return binary(Operation::id, constant_like(x, n), x); \
  }
#define RUBATO_DEFINE_parameter(name, id)                 \
  Expression name(Expression u, double m) {               \
    return binary(Operation::id, u, constant_like(u, m)); \
  }
#define RUBATO_FUNCTION(id, name, form, ...) RUBATO_DEFINE_##form(name, id)
#include <rubato/formula/operations.inc>

Expression where(Condition condition, Expression a, Expression b) {
  if (condition.or_equal) {  // a >= b: not b > a
    std::swap(a, b);
  }
  // One of the two reports on an undefined condition: the other is left out where it is 0.
  if (b.is_constant(0.0)) {
    return binary(Operation::where_positive, condition.difference, a);
  }
  const Expression otherwise = binary(Operation::where_negative, condition.difference, b);
  return a.is_constant(0.0) ? otherwise : binary(Operation::where_positive, condition.difference, a) + otherwise;
}

}  // namespace rubato::formula
