#include <rubato/formula/partials.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>

namespace rubato::formula {

// ---- scaled arithmetic ----------------------------------------------------------------------------------------------

Scaled scaled(Graph& graph, Expression expression) {
  const Node node = graph.node(expression.index());
  if (node.operation == Operation::constant) {
    return {node.value, {}};
  }
  if (node.operation == Operation::negate) {
    return {-1.0, {&graph, node.a}};
  }
  if (node.operation == Operation::multiply && graph.node(node.a).operation == Operation::constant) {
    return {graph.node(node.a).value, {&graph, node.b}};
  }
  return {1.0, expression};
}

namespace {

/// coefficient · expression, with the numerical factor of the expression absorbed; none is lost to overflow or
/// underflow.
Scaled combine(Graph& graph, double coefficient, Expression expression) {
  const Scaled split = scaled(graph, expression);
  const double product = coefficient * split.coefficient;
  if (std::isfinite(product) && (product != 0.0 || coefficient == 0.0 || split.coefficient == 0.0)) {
    return {product, split.factor};
  }
  return {coefficient, expression};
}

struct Power {
  Expression base;
  double exponent = 1.0;
};

/// expression = base^exponent, with a positive whole exponent.
Power as_power(Graph& graph, Expression expression) {
  const Node node = graph.node(expression.index());
  if (node.operation == Operation::power && graph.node(node.b).operation == Operation::constant) {
    const double exponent = graph.node(node.b).value;
    if (exponent > 0.0 && exponent == std::trunc(exponent)) {
      return {{&graph, node.a}, exponent};
    }
  }
  return {expression};
}

/// x·y where both are powers of one base, as one power.
std::optional<Expression> merged(Graph& graph, Expression x, Expression y) {
  const Power p = as_power(graph, x);
  const Power q = as_power(graph, y);
  return p.base == q.base ? std::optional(pow(p.base, p.exponent + q.exponent)) : std::nullopt;
}

/// x·y where one factor of the product x merges with y.
std::optional<Expression> merged_into(Graph& graph, Expression x, Expression y) {
  const Node node = graph.node(x.index());
  if (node.operation != Operation::multiply) {
    return std::nullopt;
  }
  const Expression u(&graph, node.a);
  const Expression v(&graph, node.b);
  if (const auto power = merged(graph, u, y)) {
    return *power * v;
  }
  if (const auto power = merged(graph, v, y)) {
    return u * *power;
  }
  return std::nullopt;
}

/// x·y with powers of one base collected, so that equal products reached by different ways are one node.
Expression merged_product(Graph& graph, Expression x, Expression y) {
  if (const auto power = merged(graph, x, y)) {
    return *power;
  }
  if (const auto inside = merged_into(graph, x, y)) {
    return *inside;
  }
  if (const auto inside = merged_into(graph, y, x)) {
    return *inside;
  }
  return x * y;
}

}  // namespace

Scaled times(Graph& graph, const Scaled& x, const Scaled& y) {
  const double coefficient = x.coefficient * y.coefficient;
  if (!std::isfinite(coefficient) || (coefficient == 0.0 && !x.is_zero() && !y.is_zero())) {
    return {1.0, graph.make(Operation::multiply, materialize(graph, x), materialize(graph, y))};
  }
  if (!x.factor.valid()) {
    return {coefficient, y.factor};
  }
  if (!y.factor.valid()) {
    return {coefficient, x.factor};
  }
  return combine(graph, coefficient, merged_product(graph, x.factor, y.factor));
}

Scaled square(Graph& graph, const Scaled& x) {
  return times(graph, x, x);
}

Expression materialize(Graph& graph, const Scaled& x) {
  if (x.is_zero()) {
    return graph.constant(0.0);
  }
  if (!x.factor.valid()) {
    return graph.constant(x.coefficient);
  }
  return graph.constant(x.coefficient) * x.factor;
}

namespace {

/// The term whose sign a sum is normalized by: the number, else one of the majority, else the first.
const Scaled& leading_term(const std::vector<Scaled>& terms) {
  if (!terms.back().factor.valid()) {
    return terms.back();
  }
  const auto is_negative = [](const Scaled& x) { return x.coefficient < 0.0; };
  const auto negative = std::count_if(terms.begin(), terms.end(), is_negative);
  const auto positive = static_cast<std::ptrdiff_t>(terms.size()) - negative;
  const bool first_is_minority = is_negative(terms.front()) ? negative < positive : positive < negative;
  return !first_is_minority ? terms.front() : *std::find_if(terms.begin(), terms.end(), [&](const Scaled& x) {
    return is_negative(x) != is_negative(terms.front());
  });
}

}  // namespace

Scaled sum_of(Graph& graph, std::vector<Scaled>& terms) {
  if (terms.empty()) {
    return {0.0, {}};
  }
  if (terms.size() == 1) {
    return terms.front();
  }
  const auto rank = [](const Scaled& term) {  // the number last
    return term.factor.valid() ? std::uint64_t{term.factor.index()} : ~std::uint64_t{0};
  };
  std::stable_sort(terms.begin(), terms.end(), [&](const Scaled& x, const Scaled& y) { return rank(x) < rank(y); });
  std::size_t count = 0;
  for (std::size_t i = 0; i < terms.size();) {
    Scaled collected = terms[i];
    for (++i; i < terms.size() && rank(terms[i]) == rank(collected); ++i) {
      collected.coefficient += terms[i].coefficient;
    }
    if (!collected.is_zero()) {
      terms[count++] = collected;
    }
  }
  terms.resize(count);
  if (count <= 1) {
    return count == 0 ? Scaled{0.0, {}} : terms.front();
  }
  // One factor is taken out: the common magnitude where there is one, and a sign that the negated sum would lose too.
  double common = std::abs(terms.front().coefficient);
  if (std::any_of(terms.begin(), terms.end(), [&](const Scaled& x) { return std::abs(x.coefficient) != common; })) {
    common = 1.0;
  }
  common = std::copysign(common, leading_term(terms).coefficient);
  // Written from a positive term on, so that the sum needs no negation.
  const auto positive =
      std::find_if(terms.begin(), terms.end(), [&](const Scaled& x) { return x.coefficient / common > 0.0; });
  std::rotate(terms.begin(), positive, positive + 1);
  Expression total;
  for (const Scaled& term : terms) {
    const double c = term.coefficient / common;
    const Expression magnitude = materialize(graph, {std::abs(c), term.factor});
    total = !total.valid() ? magnitude : c < 0.0 ? total - magnitude : total + magnitude;
  }
  return combine(graph, common, total);
}

// ---- partial derivatives --------------------------------------------------------------------------------------------

namespace {

/// What the formulas below are written in: an Expression and numbers, where the numbers stay apart.
struct Builder {
  Graph& graph;

  [[nodiscard]] Expression reciprocal(Expression x) const { return 1.0 / x; }
  [[nodiscard]] Scaled operator()(Expression x) const { return scaled(graph, x); }
  [[nodiscard]] Scaled operator()(double c, Expression x) const { return times(graph, {c, {}}, scaled(graph, x)); }

  /// The number that an elliptic function has for a parameter; of other functions none.
  [[nodiscard]] double elliptic_parameter(const Node& node) const {
    const bool elliptic = node.operation >= Operation::jacobi_sn && node.operation <= Operation::jacobi_am;
    return elliptic ? graph.node(node.b).value : 0.0;
  }

  /// The first or second derivative of a Bessel function by those of neighbouring orders: 2 J_n' = J_{n-1} - J_{n+1},
  /// and so Y; 2 I_n' = I_{n-1} + I_{n+1}; 2 K_n' = -K_{n-1} - K_{n+1}.
  [[nodiscard]] Scaled of_neighbours(NodeIndex index, double order) const {
    const Node node = graph.node(index);
    const double n = graph.node(node.a).value;
    const Expression x(&graph, node.b);
    const auto at = [&](double shift) { return graph.make(node.operation, graph.constant(n + shift), x); };
    const bool alternates = node.operation == Operation::bessel_j || node.operation == Operation::bessel_y;
    const double sign = alternates ? -1.0 : 1.0;
    if (order == 1.0) {
      const double whole = node.operation == Operation::bessel_k ? -0.5 : 0.5;
      return (*this)(whole, sign < 0.0 ? at(-1.0) - at(1.0) : at(-1.0) + at(1.0));
    }
    return (*this)(0.25, (at(-2.0) + at(2.0)) + 2.0 * sign * at(0.0));
  }

  /// 1/x; of a number, the number.
  [[nodiscard]] Scaled inverse(Expression x) const {
    if (x.is_constant() && std::isfinite(1.0 / x.constant_value())) {
      return {1.0 / x.constant_value(), {}};
    }
    return {1.0, reciprocal(x)};
  }

  /// x^exponent, which for a number as exponent avoids x^0 and x^1.
  [[nodiscard]] Scaled power(Expression x, Expression exponent) const {
    if (exponent.is_constant() && exponent.constant_value() == 0.0) {
      return {};
    }
    return (*this)(pow(x, exponent));
  }
};

}  // namespace

FirstPartials first_partials(Graph& graph, NodeIndex index, bool of_a, bool of_b) {
  const Node node = graph.node(index);
  const Builder build{graph};
  const Expression v(&graph, index);
  const Expression a(&graph, node.a);
  const Expression b(&graph, node.b);
  const double m = build.elliptic_parameter(node);
  FirstPartials d;
  switch (node.operation) {
    case Operation::constant:
    case Operation::variable:
    case Operation::sign:
    case Operation::floor: break;
    case Operation::add:
      d.a = {1.0, {}};
      d.b = {1.0, {}};
      break;
    case Operation::subtract:
      d.a = {1.0, {}};
      d.b = {-1.0, {}};
      break;
    case Operation::negate: d.a = {-1.0, {}}; break;
    case Operation::multiply:
      d.a = build(b);
      d.b = build(a);
      break;
    case Operation::divide:
      d.a = build.inverse(b);
      if (of_b) {  // -(a/b)·(1/b)
        d.b = times(graph, {-1.0, {}}, times(graph, build(v), build.inverse(b)));
      }
      break;
    case Operation::power:
      if (of_a) {  // b a^{b-1}
        d.a = times(graph, build(b), build.power(a, b - 1.0));
      }
      if (of_b) {  // a^b log a
        d.b = times(graph, build(v), build(log(a)));
      }
      break;
    case Operation::sin: d.a = build(cos(a)); break;
    case Operation::cos: d.a = build(-1.0, sin(a)); break;
    case Operation::tan: d.a = build(1.0 + v * v); break;
    case Operation::asin: d.a = build.inverse(sqrt((1.0 - a) * (1.0 + a))); break;
    case Operation::acos: d.a = build(-1.0, build.reciprocal(sqrt((1.0 - a) * (1.0 + a)))); break;
    case Operation::atan: d.a = build.inverse(1.0 + a * a); break;
    case Operation::atan2: {  // atan2(y, x): x/(x² + y²) and -y/(x² + y²)
      const Scaled q = build.inverse(a * a + b * b);
      if (of_a) {
        d.a = times(graph, build(b), q);
      }
      if (of_b) {
        d.b = times(graph, build(-1.0, a), q);
      }
      break;
    }
    case Operation::sinh: d.a = build(cosh(a)); break;
    case Operation::cosh: d.a = build(sinh(a)); break;
    case Operation::tanh: d.a = build(pow(sech(a), 2.0)); break;
    case Operation::asinh: d.a = build.inverse(sqrt(1.0 + a * a)); break;
    case Operation::acosh: d.a = build.inverse(sqrt(a - 1.0) * sqrt(a + 1.0)); break;
    case Operation::atanh: d.a = build.inverse((1.0 - a) * (1.0 + a)); break;
    case Operation::exp: d.a = build(v); break;
    case Operation::expm1: d.a = build(exp(a)); break;
    case Operation::log1p: d.a = build.inverse(1.0 + a); break;
    case Operation::log: d.a = build.inverse(a); break;
    case Operation::sqrt: d.a = build(0.5, build.reciprocal(v)); break;
    case Operation::cbrt: d.a = build(1.0 / 3.0, pow(build.reciprocal(v), 2.0)); break;
    case Operation::abs: d.a = build(sign(a)); break;
    case Operation::sech: d.a = build(-1.0, v * tanh(a)); break;
    case Operation::csch: d.a = build(-1.0, v / tanh(a)); break;
    case Operation::min:  // (1 ∓ sign(a - b))/2
      d.a = build(0.5, 1.0 - sign(a - b));
      d.b = build(0.5, 1.0 + sign(a - b));
      break;
    case Operation::max:
      d.a = build(0.5, 1.0 + sign(a - b));
      d.b = build(0.5, 1.0 - sign(a - b));
      break;
    case Operation::erf: d.a = build(2.0 * std::numbers::inv_sqrtpi, exp(-(a * a))); break;
    case Operation::bessel_j:
    case Operation::bessel_y:
    case Operation::bessel_i:
    case Operation::bessel_k: d.b = build.of_neighbours(index, 1.0); break;
    case Operation::jacobi_sn: d.a = build(cn(a, m) * dn(a, m)); break;
    case Operation::jacobi_cn: d.a = build(-1.0, sn(a, m) * dn(a, m)); break;
    case Operation::jacobi_dn: d.a = build(-m, sn(a, m) * cn(a, m)); break;
    case Operation::jacobi_am: d.a = build(dn(a, m)); break;
    case Operation::where_positive:
    case Operation::where_negative:
    case Operation::list:
    case Operation::loop:
    case Operation::component: break;  // the sweep takes these as a whole
  }
  return d;
}

SecondPartials second_partials(Graph& graph, NodeIndex index, bool of_a, bool of_b) {
  const Node node = graph.node(index);
  const Builder build{graph};
  const Expression v(&graph, index);
  const Expression a(&graph, node.a);
  const Expression b(&graph, node.b);
  const double m = build.elliptic_parameter(node);
  const auto product = [&](double c, Scaled x, const Scaled& y) {
    x.coefficient *= c;
    return times(graph, x, y);
  };
  SecondPartials d;
  switch (node.operation) {
    case Operation::constant:
    case Operation::variable:
    case Operation::add:
    case Operation::subtract:
    case Operation::negate:
    case Operation::abs:
    case Operation::sign:
    case Operation::floor:
    case Operation::min:
    case Operation::max:
    case Operation::where_positive:
    case Operation::where_negative:
    case Operation::list:
    case Operation::loop:
    case Operation::component: break;
    case Operation::multiply: d.ab = {1.0, {}}; break;
    case Operation::divide:
      if (of_b) {
        const Scaled inverse = build.inverse(b);
        const Scaled inverse_square = square(graph, inverse);
        d.ab = product(-1.0, inverse_square, {});
        d.bb = product(2.0, build(v), inverse_square);
      }
      break;
    case Operation::power:
      if (of_a) {  // b (b-1) a^{b-2}
        const Scaled factor = times(graph, build(b), build(b - 1.0));
        d.aa = factor.is_zero() ? factor : times(graph, factor, build.power(a, b - 2.0));
      }
      if (of_b) {  // a^b log² a
        d.bb = times(graph, build(v), square(graph, build(log(a))));
      }
      if (of_a && of_b) {  // a^{b-1} (1 + b log a)
        d.ab = times(graph, build.power(a, b - 1.0), build(1.0 + b * log(a)));
      }
      break;
    case Operation::sin:
    case Operation::cos: d.aa = build(-1.0, v); break;
    case Operation::tan: d.aa = product(2.0, build(v), build(1.0 + v * v)); break;
    case Operation::asin:
    case Operation::acos: {
      const Expression g = build.reciprocal(sqrt((1.0 - a) * (1.0 + a)));
      d.aa = product(node.operation == Operation::asin ? 1.0 : -1.0, build(a), build(pow(g, 3.0)));
      break;
    }
    case Operation::atan: {
      const Expression g = build.reciprocal(1.0 + a * a);
      d.aa = build(-2.0, (a * g) * g);
      break;
    }
    case Operation::atan2: {  // y = a, x = b, q = 1/(x² + y²): -2xyq², (y² - x²)q², 2xyq²
      const Expression q = build.reciprocal(a * a + b * b);
      d.aa = product(-2.0, build(a * b), build(q * q));
      d.bb = product(2.0, build(a * b), build(q * q));
      if (of_a && of_b) {
        d.ab = times(graph, build(a * a - b * b), build(q * q));
      }
      break;
    }
    case Operation::sinh:
    case Operation::cosh: d.aa = build(v); break;
    case Operation::tanh: d.aa = product(-2.0, build(v), build(pow(sech(a), 2.0))); break;
    case Operation::asinh: {
      const Expression g = build.reciprocal(sqrt(1.0 + a * a));
      d.aa = build(-1.0, (a * g) * pow(g, 2.0));
      break;
    }
    case Operation::acosh: {
      const Expression g = build.reciprocal(sqrt(a - 1.0) * sqrt(a + 1.0));
      d.aa = build(-1.0, (a * g) * pow(g, 2.0));
      break;
    }
    case Operation::atanh: {
      const Expression g = build.reciprocal((1.0 - a) * (1.0 + a));
      d.aa = product(2.0, build(a), build(g * g));
      break;
    }
    case Operation::exp: d.aa = build(v); break;
    case Operation::expm1: d.aa = build(exp(a)); break;
    case Operation::log1p: d.aa = product(-1.0, square(graph, build.inverse(1.0 + a)), {}); break;
    case Operation::log: d.aa = product(-1.0, square(graph, build.inverse(a)), {}); break;
    case Operation::sqrt: {  // -1/(4 v³)
      const Expression g = build.reciprocal(v);
      d.aa = build(-0.25, pow(g, 3.0));
      break;
    }
    case Operation::cbrt: {  // -2/(9 v⁵)
      const Expression g = build.reciprocal(v);
      d.aa = build(-2.0 / 9.0, pow(g, 5.0));
      break;
    }
    case Operation::erf: d.aa = product(-4.0 * std::numbers::inv_sqrtpi, build(a), build(exp(-(a * a)))); break;
    case Operation::bessel_j:
    case Operation::bessel_y:
    case Operation::bessel_i:
    case Operation::bessel_k: d.bb = build.of_neighbours(index, 2.0); break;
    // Without the differences of numbers near each other that a polynomial in v has.
    case Operation::jacobi_sn:
      d.aa = product(-1.0, build(v), build(pow(dn(a, m), 2.0) + m * pow(cn(a, m), 2.0)));
      break;
    case Operation::jacobi_cn: d.aa = times(graph, build(v), build(m * pow(sn(a, m), 2.0) - pow(dn(a, m), 2.0))); break;
    case Operation::jacobi_dn: d.aa = product(m, build(v), build(pow(sn(a, m), 2.0) - pow(cn(a, m), 2.0))); break;
    case Operation::jacobi_am: d.aa = build(-m, sn(a, m) * cn(a, m)); break;
    case Operation::sech: d.aa = times(graph, build(v), build(1.0 - 2.0 * (v * v))); break;
    case Operation::csch: d.aa = times(graph, build(v), build(1.0 + 2.0 * (v * v))); break;
  }
  return d;
}

}  // namespace rubato::formula
