// The recurrences. For u = f(a) the derivation D, (D u)_d = d·u_d, obeys the chain rule D u = f'(a)·D a; comparing
// parts of order d gives u_d from earlier ones.

#include <rubato/formula/taylor_steps.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/formula/arithmetic.hpp>

namespace rubato::formula {

namespace {

double one(int) {
  return 1.0;
}
double by_order(int k) {
  return k;
}

/// f(a_0) of the functions with D f(a) = ±(D a)/b; NaN outside the open interval where that holds.
double leading_value(OpCode code, double a) {
  switch (code) {
    case OpCode::asin: return std::asin(a);
    case OpCode::acos: return std::acos(a);
    case OpCode::atan: return std::atan(a);
    case OpCode::asinh: return std::asinh(a);
    case OpCode::acosh: return std::acosh(a);
    case OpCode::atanh: return std::atanh(a);
    default: return std::log(a);  // of log itself and of a general power
  }
}

bool has_expansion(OpCode code, double a) {
  switch (code) {
    case OpCode::asin:
    case OpCode::acos:
    case OpCode::atanh: return std::abs(a) < 1.0;
    case OpCode::acosh: return a > 1.0;
    case OpCode::atan:
    case OpCode::asinh: return true;
    default: return a > 0.0;
  }
}

bool is_zero(std::span<const double> part) {
  return std::all_of(part.begin(), part.end(), [](double x) { return x == 0.0; });
}

}  // namespace

template <typename Grading>
bool BasicTaylorEvaluator<Grading>::start(const Step& step) {
  double* target = at(step.target);
  double* b = at(step.b);
  const double a = *at(step.a);
  switch (step.kind) {
    case Kind::fill: *target = step.value; return true;
    case Kind::add: *target = a + *b; return true;
    case Kind::subtract: *target = a - *b; return true;
    case Kind::affine: *target = step.value + step.factor * a; return true;
    case Kind::divide_by_number: *target = a / step.value; return step.value != 0.0;
    case Kind::multiply: *target = a * *b; return true;
    case Kind::square: *target = a * a; return true;
    case Kind::divide: *target = a / *b; return *b != 0.0;
    case Kind::reciprocal: *target = 1.0 / a; return a != 0.0;
    case Kind::square_root: *target = std::sqrt(a); return a > 0.0;
    case Kind::power:
      if (step.code == OpCode::cbrt) {
        *target = std::cbrt(a);
        return a != 0.0;
      }
      *target = std::pow(a, step.value);
      return a > 0.0;
    case Kind::exponential: *target = std::exp(a); return true;
    case Kind::quotient_integral: *target = leading_value(step.code, a); return has_expansion(step.code, a);
    case Kind::circular:
      *target = std::sin(a);
      *b = std::cos(a);
      return true;
    case Kind::hyperbolic:
      *target = std::sinh(a);
      *b = std::cosh(a);
      return true;
    case Kind::tangent:
      *target = step.factor > 0.0 ? std::tan(a) : std::tanh(a);
      *b = 1.0 + step.factor * *target * *target;
      return true;
    case Kind::secant:
      *target = step.factor > 0.0 ? sech(a) : csch(a);
      *b = step.factor > 0.0 ? std::tanh(a) : 1.0 / std::tanh(a);
      *at(step.c) = *target * *b;
      *at(step.d) = *target * *target;
      return step.factor > 0.0 || a != 0.0;
    case Kind::argument:
      *target = std::atan2(a, *b);
      *at(step.c) = a * a + *b * *b;
      return *at(step.c) > 0.0;
    case Kind::absolute: *target = std::abs(a); return true;
    case Kind::sign: *target = sign(a); return true;
    case Kind::minimum: *target = minimum(a, *b); return true;
    case Kind::maximum: *target = maximum(a, *b); return true;
  }
  return false;
}

template <typename Grading>
bool BasicTaylorEvaluator<Grading>::extend(const Step& step, int d) {
  using taylor::add_products;
  using taylor::add_squares;
  constexpr Grading grading;
  const auto size = Grading::size(d);
  const double* a = at(step.a);
  const double* b = at(step.b);
  const double* own = at(step.target);
  const double* a_part = a + Grading::offset(d);
  const double* b_part = b + Grading::offset(d);
  double* out = at(step.target) + Grading::offset(d);
  const double per_order = 1.0 / d;
  const auto assign = [&](auto value) {
    for (std::size_t i = 0; i < size; ++i)
      out[i] = value(i);
  };
  const auto clear = [&](double* part) { std::fill_n(part, size, 0.0); };
  const auto scale = [&](double* part, double factor) {
    for (std::size_t i = 0; i < size; ++i)
      part[i] *= factor;
  };
  // part = factor/d · Σ_{k=1..d} k a_k v_{d-k}: the part of order d of the integral of factor·v·D a.
  const auto integrate = [&](double* part, const double* v, double factor) {
    clear(part);
    add_products(grading, part, a, v, d, 1, d, by_order);
    scale(part, factor * per_order);
  };

  switch (step.kind) {
    case Kind::fill: clear(out); return true;
    case Kind::add: assign([&](std::size_t i) { return a_part[i] + b_part[i]; }); return true;
    case Kind::subtract: assign([&](std::size_t i) { return a_part[i] - b_part[i]; }); return true;
    case Kind::affine: assign([&](std::size_t i) { return step.factor * a_part[i]; }); return true;
    case Kind::divide_by_number: assign([&](std::size_t i) { return a_part[i] / step.value; }); return true;
    case Kind::multiply:
      clear(out);
      add_products(grading, out, a, b, d, 0, d, one);
      return true;
    case Kind::square:
      clear(out);
      add_squares(grading, out, a, d, 0);
      return true;
    case Kind::divide:  // b·u = a
      clear(out);
      add_products(grading, out, b, own, d, 1, d, one);
      assign([&](std::size_t i) { return (a_part[i] - out[i]) / b[0]; });
      return true;
    case Kind::reciprocal:  // a·u = 1
      clear(out);
      add_products(grading, out, a, own, d, 1, d, one);
      scale(out, -1.0 / a[0]);
      return true;
    case Kind::square_root:  // u² = a
      clear(out);
      add_squares(grading, out, own, d, 1);
      assign([&](std::size_t i) { return (a_part[i] - out[i]) / (2.0 * own[0]); });
      return true;
    case Kind::power:  // a·D u = p·u·D a
      clear(out);
      add_products(grading, out, a, own, d, 1, d, [&](int k) { return (step.value * k - (d - k)) * per_order; });
      scale(out, 1.0 / a[0]);
      return true;
    case Kind::exponential: integrate(out, own, 1.0); return true;
    case Kind::quotient_integral:  // b·D u = factor·D a
      clear(out);
      add_products(grading, out, own, b, d, 1, d - 1, by_order);
      assign([&](std::size_t i) { return (step.factor * a_part[i] - out[i] * per_order) / b[0]; });
      return true;
    case Kind::circular:
      integrate(out, b, 1.0);
      integrate(at(step.b) + Grading::offset(d), own, -1.0);
      return true;
    case Kind::hyperbolic:
      integrate(out, b, 1.0);
      integrate(at(step.b) + Grading::offset(d), own, 1.0);
      return true;
    case Kind::tangent: {
      integrate(out, b, 1.0);
      double* derivative = at(step.b) + Grading::offset(d);
      clear(derivative);
      add_squares(grading, derivative, own, d, 0);
      scale(derivative, step.factor);
      return true;
    }
    case Kind::secant: {  // D sech = -sech tanh D a, D tanh = sech² D a; D csch = -csch coth D a, D coth = -csch² D a
      integrate(out, at(step.c), -1.0);
      integrate(at(step.b) + Grading::offset(d), at(step.d), step.factor);
      double* product = at(step.c) + Grading::offset(d);
      clear(product);
      add_products(grading, product, own, b, d, 0, d, one);
      double* square = at(step.d) + Grading::offset(d);
      clear(square);
      add_squares(grading, square, own, d, 0);
      return true;
    }
    case Kind::argument: {  // (a² + b²)·D u = b·D a - a·D b
      double* square = at(step.c) + Grading::offset(d);
      clear(square);
      add_squares(grading, square, a, d, 0);
      add_squares(grading, square, b, d, 0);
      clear(out);
      add_products(grading, out, own, at(step.c), d, 1, d - 1, [](int k) { return -k; });
      add_products(grading, out, a, b, d, 0, d, [d](int k) { return 2 * k - d; });
      scale(out, per_order / *at(step.c));
      return true;
    }
    case Kind::absolute: {
      const double direction = sign(a[0]);
      assign([&](std::size_t i) { return direction * a_part[i]; });
      return direction != 0.0 || is_zero({a_part, size});
    }
    case Kind::sign: clear(out); return a[0] != 0.0 || is_zero({a_part, size});
    case Kind::minimum:
    case Kind::maximum: {
      const bool first = step.kind == Kind::minimum ? a[0] < b[0] : a[0] > b[0];
      std::copy_n(first ? a_part : b_part, size, out);
      return a[0] != b[0] || std::equal(a_part, a_part + size, b_part);
    }
  }
  return false;
}

template bool BasicTaylorEvaluator<Univariate>::start(const Step&);
template bool BasicTaylorEvaluator<Bivariate>::start(const Step&);
template bool BasicTaylorEvaluator<EvenBivariate>::start(const Step&);
template bool BasicTaylorEvaluator<Univariate>::extend(const Step&, int);
template bool BasicTaylorEvaluator<Bivariate>::extend(const Step&, int);
template bool BasicTaylorEvaluator<EvenBivariate>::extend(const Step&, int);

}  // namespace rubato::formula
