#include "audit/expression.hpp"

#include <cmath>

#include <fmt/format.h>

namespace audit {

Expression::Expression(double number) : node_(std::make_shared<Node>(Node{Kind::number, number})) {}

Expression::Expression(Kind kind, const Expression& a, const Expression& b)
    : node_(std::make_shared<Node>(Node{kind, 0.0, 0, a.node_, b.node_})) {}

Expression::Expression(Kind kind, const Expression& a) : node_(std::make_shared<Node>(Node{kind, 0.0, 0, a.node_})) {}

Expression Expression::variable(std::size_t index) {
  return Expression(std::make_shared<Node>(Node{Kind::variable, 0.0, index}));
}

Expression Expression::raised(const Expression& a, int exponent) {
  return Expression(
      std::make_shared<Node>(Node{Kind::integer_power, 0.0, static_cast<std::size_t>(exponent), a.node_}));
}

Expression Expression::raised(const Expression& a, double exponent) {
  return Expression(std::make_shared<Node>(Node{Kind::real_power, exponent, 0, a.node_}));
}

int Expression::precedence() const {
  switch (node_->kind) {
    case Kind::add:
    case Kind::subtract: return 1;
    case Kind::multiply:
    case Kind::divide: return 2;
    case Kind::integer_power:
    case Kind::real_power: return 3;
    case Kind::number: return std::signbit(node_->number) ? 0 : 4;
    default: return 4;
  }
}

std::string Expression::inside(std::span<const std::string> names, int outer) const {
  return precedence() < outer ? fmt::format("({})", text(names)) : text(names);
}

std::string Expression::text(std::span<const std::string> names) const {
  const Node& node = *node_;
  const Expression a(node.left), b(node.right);
  switch (node.kind) {
    case Kind::number: return fmt::format("{}", node.number);
    case Kind::variable: return names[node.index];
    case Kind::add: return a.inside(names, 1) + " + " + b.inside(names, 2);
    case Kind::subtract: return a.inside(names, 1) + " - " + b.inside(names, 2);
    case Kind::multiply: return a.inside(names, 2) + "*" + b.inside(names, 3);
    case Kind::divide: return a.inside(names, 2) + "/" + b.inside(names, 3);
    case Kind::integer_power: return fmt::format("{}^{}", a.inside(names, 4), node.index);
    case Kind::real_power: return fmt::format("{}^({})", a.inside(names, 4), node.number);
    case Kind::sin: return fmt::format("sin({})", a.text(names));
    case Kind::cos: return fmt::format("cos({})", a.text(names));
    case Kind::exp: return fmt::format("exp({})", a.text(names));
    case Kind::log: return fmt::format("log({})", a.text(names));
  }
  return {};
}

bool Expression::depends_on(std::size_t first, std::size_t end) const {
  const Node& node = *node_;
  if (node.kind == Kind::variable) {
    return node.index >= first && node.index < end;
  }
  return (node.left != nullptr && Expression(node.left).depends_on(first, end)) ||
         (node.right != nullptr && Expression(node.right).depends_on(first, end));
}

Expression Expression::terms_where(const std::function<bool(const Expression&)>& keep) const {
  const Node& node = *node_;
  if (node.kind == Kind::add || node.kind == Kind::subtract) {
    return {node.kind, Expression(node.left).terms_where(keep), Expression(node.right).terms_where(keep)};
  }
  return keep(*this) ? *this : Expression(0.0);
}

Expression Expression::with(std::span<const Expression> values) const {
  const Node& node = *node_;
  const Expression a(node.left), b(node.right);
  switch (node.kind) {
    case Kind::number: return *this;
    case Kind::variable: return values[node.index];
    case Kind::integer_power: return raised(a.with(values), static_cast<int>(node.index));
    case Kind::real_power: return raised(a.with(values), node.number);
    case Kind::sin: return sin(a.with(values));
    case Kind::cos: return cos(a.with(values));
    case Kind::exp: return exp(a.with(values));
    case Kind::log: return log(a.with(values));
    default: return {node.kind, a.with(values), b.with(values)};
  }
}

}  // namespace audit
