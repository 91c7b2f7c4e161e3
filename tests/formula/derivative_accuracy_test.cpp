// The derivatives of every function near the ends of its domain and far out, against arithmetic of 60 digits.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <ginac/ginac.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/taylor.hpp>

using namespace rubato::formula;

namespace {

using GiNaC::ex;
using GiNaC::numeric;

constexpr double unit = std::numeric_limits<double>::epsilon() / 2.0;

/// The double as it is: a whole number times a power of two.
numeric exactly(double x) {
  int exponent = 0;
  const double mantissa = std::ldexp(std::frexp(x, &exponent), 53);
  return numeric(static_cast<long>(mantissa)) * GiNaC::pow(numeric(2), numeric(exponent - 53));
}

numeric number(const ex& expression) {
  return GiNaC::ex_to<numeric>(expression.evalf());
}

/// Slopes f', f'', f''' of one argument, to 60 digits.
using Slopes = std::array<numeric, 3>;

struct Function {
  std::string formula;  ///< of x
  std::function<Slopes(double)> slopes;
  std::vector<double> places;
};

/// Slopes by the derivatives of a formula of GiNaC's.
std::function<Slopes(double)> slopes_of(const std::function<ex(const ex&)>& f) {
  return [f](double x) {
    const GiNaC::symbol s("x");
    const ex formula = f(s);
    Slopes slopes;
    for (unsigned order = 1; order <= 3; ++order) {
      slopes[order - 1] = number(formula.diff(s, order).subs(s == exactly(x)));
    }
    return slopes;
  };
}

/// Slopes of Σ c_k x^k with the coefficients c_k of a function that is entire; for x up to 20.
std::function<Slopes(double)> slopes_of_series(const std::function<numeric(int)>& coefficient) {
  return [coefficient](double x) {
    Slopes slopes = {numeric(0), numeric(0), numeric(0)};
    for (int k = 1; k < 160; ++k) {
      numeric factor = coefficient(k);
      for (int order = 1; order <= 3 && order <= k; ++order) {
        factor *= k - order + 1;
        slopes[static_cast<std::size_t>(order - 1)] += factor * GiNaC::pow(exactly(x), numeric(k - order));
      }
    }
    for (numeric& slope : slopes) {
      slope = number(slope);
    }
    return slopes;
  };
}

/// The coefficient of x^k of J_n (sign -1) and I_n (sign 1).
numeric bessel_coefficient(int n, int sign, int k) {
  const int j = (k - n) / 2;
  return k < n || (k - n) % 2 != 0
             ? numeric(0)
             : numeric(j % 2 == 0 ? 1 : sign) / (GiNaC::pow(numeric(2), numeric(k)) * GiNaC::factorial(numeric(j)) *
                                                 GiNaC::factorial(numeric(j + n)));
}

/// sn, cn, dn by descending Landen transformations.
std::array<numeric, 3> elliptic(const numeric& u, const numeric& m) {
  std::vector<numeric> a = {numeric(1)}, c = {number(GiNaC::sqrt(ex(m)))};
  numeric b = number(GiNaC::sqrt(ex(1 - m)));
  for (int i = 0; i < 9; ++i) {
    const numeric old = a.back();
    a.push_back((old + b) / 2);
    c.push_back((old - b) / 2);
    b = number(GiNaC::sqrt(ex(old * b)));
  }
  numeric angle = GiNaC::pow(numeric(2), numeric(9)) * a[9] * u;
  for (std::size_t i = 9; i > 0; --i) {
    angle = (angle + number(GiNaC::asin(ex(c[i] / a[i]) * GiNaC::sin(ex(angle))))) / 2;
  }
  const numeric s = number(GiNaC::sin(ex(angle))), k = number(GiNaC::cos(ex(angle)));
  return {s, k, number(GiNaC::sqrt(ex(1 - m * s * s)))};
}

/// From sn' = cn dn, cn' = -sn dn, dn' = -m sn cn.
std::function<Slopes(double)> slopes_of_elliptic(int which, double m_double) {
  return [which, m_double](double x) {
    const numeric m = exactly(m_double);
    const auto [s, c, d] = elliptic(number(exactly(x)), m);
    switch (which) {
      case 0: return Slopes{c * d, -s * (d * d + m * c * c), -c * d * (d * d + m * c * c) + 4 * m * s * s * c * d};
      case 1: return Slopes{-s * d, c * (m * s * s - d * d), -s * d * (m * s * s - d * d) + 4 * m * s * c * c * d};
      default:
        return Slopes{-m * s * c, m * d * (s * s - c * c), -m * m * s * c * (s * s - c * c) + 4 * m * s * c * d * d};
    }
  };
}

const std::vector<Function>& all_functions() {
  const auto pi = [] { return ex(GiNaC::Pi); };
  static const std::vector<double> everywhere = {-300, -20, -1.5, -1e-3, -1e-9, 1e-300, 1e-9, 0.3, 0.8813735870195430,
                                                 1,    2.5, 10,   18,    20,    40,     300};
  static const std::vector<double> large = {1e-150, 1e-9, 0.3, 1, 2.5, 1e3, 1e9, 1e60, 1e102, 1e120};
  static const std::vector<double> inside = {-1 + 0x1p-53, -0.999999, -0.7, -1e-9,    1e-300,
                                             1e-9,         0.3,       0.7,  0.999999, 1 - 0x1p-53};
  static const std::vector<double> positive = {1e-60, 1e-9, 0.3, 1, 1 + 0x1p-52, 2.5, 1e9, 1e60};
  static const std::vector<double> waves = {1e-9, 1e-3, 0.3, 1, 2.5, 5, 12};
  static const std::vector<Function> functions = {
      {"sin(x)", slopes_of([](const ex& x) { return sin(x); }), everywhere},
      {"cos(x)", slopes_of([](const ex& x) { return cos(x); }), everywhere},
      {"tan(x)", slopes_of([](const ex& x) { return tan(x); }), everywhere},
      {"asin(x)", slopes_of([](const ex& x) { return asin(x); }), inside},
      {"acos(x)", slopes_of([](const ex& x) { return acos(x); }), inside},
      {"atan(x)", slopes_of([](const ex& x) { return atan(x); }), large},
      {"atan2(x, 3)", slopes_of([](const ex& x) { return atan(x / 3); }), large},
      {"atan2(3, x)", slopes_of([=](const ex& x) { return pi() / 2 - atan(x / 3); }), large},
      {"sinh(x)", slopes_of([](const ex& x) { return sinh(x); }), everywhere},
      {"cosh(x)", slopes_of([](const ex& x) { return cosh(x); }), everywhere},
      {"tanh(x)", slopes_of([](const ex& x) { return tanh(x); }), everywhere},
      {"sech(x)", slopes_of([](const ex& x) { return 1 / cosh(x); }), everywhere},
      {"csch(x)", slopes_of([](const ex& x) { return 1 / sinh(x); }), {-300, -20, -1e-3, 1e-9, 0.3, 2.5, 20, 300}},
      {"asinh(x)", slopes_of([](const ex& x) { return log(x + sqrt(1 + x * x)); }), large},
      {"acosh(x)",
       slopes_of([](const ex& x) { return log(x + sqrt(x - 1) * sqrt(x + 1)); }),
       {1 + 0x1p-52, 1 + 1e-9, 1.3, 2.5, 1e3, 1e60, 1e102, 1e120}},
      {"atanh(x)", slopes_of([](const ex& x) { return (log(1 + x) - log(1 - x)) / 2; }), inside},
      {"exp(x)", slopes_of([](const ex& x) { return exp(x); }), everywhere},
      {"expm1(x)", slopes_of([](const ex& x) { return exp(x); }), everywhere},
      {"log(x)", slopes_of([](const ex& x) { return log(x); }), positive},
      {"log1p(x)",
       slopes_of([](const ex& x) { return log(1 + x); }),
       {-1 + 0x1p-53, -0.999, -0.3, -1e-9, 1e-300, 1e-9, 1, 1e9}},
      {"sqrt(x)", slopes_of([](const ex& x) { return sqrt(x); }), positive},
      {"cbrt(x)", slopes_of([](const ex& x) { return pow(x, numeric(1) / 3); }), positive},
      {"1/x", slopes_of([](const ex& x) { return 1 / x; }), positive},
      {"x^2.5", slopes_of([](const ex& x) { return pow(x, numeric(5) / 2); }), positive},
      {"x^(-3)", slopes_of([](const ex& x) { return pow(x, -3); }), positive},
      {"2^x", slopes_of([](const ex& x) { return pow(numeric(2), x); }), everywhere},
      // erf' = 2/sqrt(pi) exp(-x^2); of it the slopes are those of an antiderivative.
      {"erf(x)",
       [pi](double x) {
         const GiNaC::symbol s("x");
         const ex first = 2 / sqrt(pi()) * exp(-s * s);
         Slopes slopes;
         for (unsigned order = 0; order < 3; ++order) {
           slopes[order] = number(first.diff(s, order).subs(s == exactly(x)));
         }
         return slopes;
       },
       {-20, -3, -1e-9, 1e-300, 0.3, 2.5, 10, 26}},
      {"besselj(0, x)", slopes_of_series([](int k) { return bessel_coefficient(0, -1, k); }), waves},
      {"besselj(1, x)", slopes_of_series([](int k) { return bessel_coefficient(1, -1, k); }), waves},
      {"besselj(5, x)", slopes_of_series([](int k) { return bessel_coefficient(5, -1, k); }), {0.3, 1, 2.5, 5, 12}},
      {"besseli(0, x)", slopes_of_series([](int k) { return bessel_coefficient(0, 1, k); }), waves},
      {"besseli(3, x)", slopes_of_series([](int k) { return bessel_coefficient(3, 1, k); }), {0.3, 1, 2.5, 5, 12}},
      {"sn(x, 0.64)", slopes_of_elliptic(0, 0.64), waves},
      {"cn(x, 0.64)", slopes_of_elliptic(1, 0.64), waves},
      {"dn(x, 0.64)", slopes_of_elliptic(2, 0.64), waves},
      {"sn(x, 1e-10)", slopes_of_elliptic(0, 1e-10), waves},
      {"cn(x, 1e-10)", slopes_of_elliptic(1, 1e-10), waves},
      {"dn(x, 1e-10)", slopes_of_elliptic(2, 1e-10), waves},
      {"sn(x, 0.999999)", slopes_of_elliptic(0, 0.999999), waves},
  };
  return functions;
}

/// |computed - exact| in units in the last place of the exact one (2^-53 of it), over 1 + |x f'/f|: by so much a
/// rounding of the argument changes it, too.
double error_of(double computed, const numeric& exact, const numeric& slope, double x) {
  const numeric size = GiNaC::abs(exact) + GiNaC::abs(exactly(x) * slope);
  if (size.is_zero()) {
    return computed == 0.0 ? 0.0 : std::numeric_limits<double>::infinity();
  }
  if (!std::isfinite(computed)) {
    return std::numeric_limits<double>::infinity();
  }
  return (GiNaC::abs(exactly(computed) - exact) / size).to_double() / unit;
}

/// Numbers that are neither subnormal nor beyond the largest.
bool is_normal(const numeric& x) {
  const double size = GiNaC::abs(x).to_double();
  return size > 1e-290 && size < 1e300;
}

struct Errors {
  double first = 0.0, second = 0.0;
  double at_first = 0.0, at_second = 0.0;
};

/// The largest errors of the first two derivatives of `formula` as a derivative of the function.
template <typename Derivatives>
Errors errors_of(const Function& function, const Derivatives& derivatives) {
  GiNaC::Digits = 60;
  Errors worst;
  for (const double x : function.places) {
    const Slopes exact = function.slopes(x);
    const auto [first, second] = derivatives(x);
    if (is_normal(exact[0])) {
      if (const double error = error_of(first, exact[0], exact[1], x); error > worst.first) {
        worst.first = error;
        worst.at_first = x;
      }
    }
    if (is_normal(exact[1])) {
      if (const double error = error_of(second, exact[1], exact[2], x); error > worst.second) {
        worst.second = error;
        worst.at_second = x;
      }
    }
  }
  return worst;
}

/// By formulas of the derivatives.
auto by_formulas(const std::string& text) {
  auto graph = std::make_shared<Graph>();
  const Expression x = graph->variable("x");
  const std::vector<std::string> names = {"x"};
  const Expression f = parse(text, *graph, names);
  const std::array outputs = {derivative(f, x), hessian_upper(f, std::array{x}).front()};
  auto evaluate = std::make_shared<ScalarEvaluator>(Bytecode(outputs, std::array{x}));
  return [graph, evaluate](double place) {
    evaluate->inputs()[0] = place;
    evaluate->run();
    return std::pair(evaluate->output(0), evaluate->output(1));
  };
}

/// By Taylor coefficients.
auto by_series(const std::string& text) {
  Graph graph;
  const Expression x = graph.variable("x");
  const std::vector<std::string> names = {"x"};
  const std::array outputs = {parse(text, graph, names)};
  auto series = std::make_shared<TaylorEvaluator>(Bytecode(outputs, std::array{x}, false), 2);
  return [series](double place) {
    series->input(0)[0] = place;
    series->input(0)[1] = 1.0;
    series->input(0)[2] = 0.0;
    constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
    return (*series)() == rubato::Status::success ? std::pair(series->output(0)[1], 2.0 * series->output(0)[2])
                                                  : std::pair(undefined, undefined);
  };
}

}  // namespace

TEST_CASE("every derivative is accurate to its rounding, at the ends of its domain too") {
  // A derivative is made of at most eight operations and calls of functions, each good to two units, and of a power of
  // at most three of them: 8·2·3.
  constexpr double tolerance = 48.0;
  for (const Function& function : all_functions()) {
    INFO(function.formula);
    const Errors formulas = errors_of(function, by_formulas(function.formula));
    INFO("first: " << formulas.first << " at " << formulas.at_first << ", second: " << formulas.second << " at "
                   << formulas.at_second);
    CHECK(formulas.first < tolerance);
    CHECK(formulas.second < tolerance);
    const Errors series = errors_of(function, by_series(function.formula));
    INFO("series: first: " << series.first << " at " << series.at_first << ", second: " << series.second << " at "
                           << series.at_second);
    CHECK(series.first < tolerance);
    CHECK(series.second < tolerance);
  }
}

TEST_CASE("a derivative by a difference of numbers near each other is seen as wrong") {
  const auto wrong = [](const std::string& text, const std::string& slope) {
    const auto& functions = all_functions();
    const auto function =
        std::find_if(functions.begin(), functions.end(), [&](const Function& f) { return f.formula == text; });
    REQUIRE(function != functions.end());
    const Errors errors = errors_of(*function, [&](double x) {
      Graph graph;
      const std::vector<std::string> names = {"x"};
      const std::array outputs = {parse(slope, graph, names)}, inputs = {graph.variable("x")};
      ScalarEvaluator evaluate{Bytecode(outputs, inputs)};
      evaluate.inputs()[0] = x;
      evaluate.run();
      return std::pair(evaluate.output(0), 0.0);
    });
    return errors.first > 1e3;
  };
  CHECK(wrong("tanh(x)", "1 - tanh(x)^2"));
  CHECK(wrong("sech(x)", "-tanh(x)/cosh(x)*(1 + 1e-12)"));
  CHECK(wrong("expm1(x)", "1 + (exp(x) - 1)"));
  CHECK_FALSE(wrong("tanh(x)", "sech(x)^2"));
}
