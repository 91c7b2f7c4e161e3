#include <rubato/problem/complex_parts.hpp>

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

namespace {

using formula::Expression;
using formula::Operation;

Complex sum(const Complex& a, const Complex& b, bool subtracts) {
  const auto of = [subtracts](Expression one, Expression other) { return subtracts ? one - other : one + other; };
  Complex result{of(a.re, b.re), a.im};
  if (b.im) {
    result.im = a.im ? of(*a.im, *b.im) : subtracts ? -*b.im : *b.im;
  }
  return result;
}
Complex product(const Complex& a, const Complex& b) {
  if (!a.im || !b.im) {
    return {a.re * b.re, a.im ? std::optional(*a.im * b.re) : b.im ? std::optional(a.re * *b.im) : std::nullopt};
  }
  return {a.re * b.re - *a.im * *b.im, a.re * *b.im + *a.im * b.re};
}
Complex quotient(const Complex& a, const Complex& b) {
  if (b.im) {
    const Expression modulus = pow(b.re, 2.0) + pow(*b.im, 2.0);
    return quotient(product(a, {b.re, -*b.im}), {modulus, std::nullopt});
  }
  return {a.re / b.re, a.im ? std::optional(*a.im / b.re) : std::nullopt};
}

}  // namespace

Complex ComplexParts::operator()(Expression e) {
  if (const auto part = parts_.find(e.index()); part != parts_.end()) {
    return part->second;
  }
  const formula::Node node = graph_.node(e.index());
  const int arguments = formula::arity(node.operation);
  if (arguments == 0) {
    return {e, std::nullopt};
  }
  const Expression first(&graph_, node.a), second(&graph_, node.b);
  const Complex a = (*this)(first), b = arguments == 2 ? (*this)(second) : Complex{first, std::nullopt};
  const bool is_real = !a.im && !b.im;
  if (is_real && node.operation == Operation::power) {  // |ψ|^n is (p² + q²)^(n/2), of which there is an integral
    if (const formula::Node base = graph_.node(a.re.index()); base.operation == Operation::sqrt) {
      return parts_.emplace(e.index(), Complex{pow(Expression(&graph_, base.a), 0.5 * b.re), std::nullopt})
          .first->second;
    }
  }
  Complex result =
      !is_real ? of(node.operation, a, b)
               : Complex{arguments == 2 ? graph_.make(node.operation, a.re, b.re) : graph_.make(node.operation, a.re),
                         std::nullopt};
  return parts_.emplace(e.index(), std::move(result)).first->second;
}

Complex ComplexParts::of(Operation operation, const Complex& a, const Complex& b) {
  switch (operation) {
    case Operation::add: return sum(a, b, false);
    case Operation::subtract: return sum(a, b, true);
    case Operation::negate: return {-a.re, -*a.im};
    case Operation::multiply: return product(a, b);
    case Operation::divide: return quotient(a, b);
    case Operation::exp: return {exp(a.re) * cos(*a.im), exp(a.re) * sin(*a.im)};
    case Operation::power: {
      constexpr double most = 16.0;
      const double exponent = !b.im && b.re.is_constant() ? b.re.constant_value() : 0.5;
      if (exponent >= 1.0 && exponent <= most && exponent == std::floor(exponent)) {
        Complex power = a;
        for (int n = 1; n < static_cast<int>(exponent); ++n) {
          power = product(power, a);
        }
        return power;
      }
      break;
    }
    default: break;
  }
  throw std::invalid_argument(
      fmt::format("{} of a complex number: only sums, products, quotients, powers with natural exponents and exp are "
                  "known; abs2(psi) is the squared modulus of psi",
                  formula::name(operation)));
}

}  // namespace rubato
