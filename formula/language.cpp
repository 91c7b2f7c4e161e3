#include <rubato/formula/language.hpp>

#include <algorithm>
#include <array>
#include <numbers>

namespace rubato::formula {

namespace {

constexpr std::array<Function, 31> all_functions{{
    {"sin", Operation::sin, "sine of an angle in radians"},
    {"cos", Operation::cos, "cosine"},
    {"tan", Operation::tan, "tangent"},
    {"asin", Operation::asin, "inverse sine, from -pi/2 to pi/2", "-1 <= x <= 1"},
    {"acos", Operation::acos, "inverse cosine, from 0 to pi", "-1 <= x <= 1"},
    {"atan", Operation::atan, "inverse tangent, from -pi/2 to pi/2"},
    {"atan2", Operation::atan2, "angle of the point (y, x), in this order: atan(y/x) in the right quadrant", "", false,
     "y, x"},
    {"sinh", Operation::sinh, "hyperbolic sine"},
    {"cosh", Operation::cosh, "hyperbolic cosine"},
    {"tanh", Operation::tanh, "hyperbolic tangent"},
    {"asinh", Operation::asinh, "inverse hyperbolic sine"},
    {"acosh", Operation::acosh, "inverse hyperbolic cosine, at least 0", "x >= 1"},
    {"atanh", Operation::atanh, "inverse hyperbolic tangent", "-1 < x < 1"},
    {"exp", Operation::exp, "exponential function"},
    {"log", Operation::log, "natural logarithm", "x > 0"},
    {"sqrt", Operation::sqrt, "square root", "x >= 0"},
    {"cbrt", Operation::cbrt, "cube root, of negative numbers too"},
    {"abs", Operation::abs, "absolute value"},
    {"sech", Operation::sech, "1/cosh(x), without overflow"},
    {"csch", Operation::csch, "1/sinh(x)", "x not 0"},
    {"sign", Operation::sign, "-1, 0 or 1; its derivative is taken as 0"},
    {"min", Operation::min, "the least of two or more", "", true, "a, b, ..."},
    {"max", Operation::max, "the greatest of two or more", "", true, "a, b, ..."},
    {"erf", Operation::erf, "error function", "", false, "x", true},
    {"besselj", Operation::bessel_j, "Bessel function of the first kind, of integer order n", "", false, "n, x", true},
    {"bessely", Operation::bessel_y, "Bessel function of the second kind", "x > 0", false, "n, x", true},
    {"besseli", Operation::bessel_i, "modified Bessel function of the first kind", "", false, "n, x", true},
    {"besselk", Operation::bessel_k, "modified Bessel function of the second kind", "x > 0", false, "n, x", true},
    {"sn", Operation::jacobi_sn, "Jacobi's elliptic function of the parameter m = k^2", "0 <= m <= 1", false, "u, m",
     true},
    {"cn", Operation::jacobi_cn, "the same", "0 <= m <= 1", false, "u, m", true},
    {"dn", Operation::jacobi_dn, "the same", "0 <= m <= 1", false, "u, m", true},
}};

constexpr std::array<Word, 7> all_words{{
    {"ellipk", "m", "complete elliptic integral K of the parameter m, a known number, 0 <= m < 1"},
    {"ellipe", "m", "complete elliptic integral E of the parameter m, a known number, 0 <= m <= 1"},
    {"where", "c, a, b", "a where the comparison c holds, else b; see Choices"},
    {"noise", "seed", "a normal random number, by an integer that is known; see Random numbers"},
    {"norm", "r", "length of a vector, or of the vector of two or more numbers; see Vectors"},
    {"dot", "r, s", "scalar product of two vectors; see Vectors"},
    {"sum", "i, 1, N, f", "the sum of f for i = 1, ..., N; see Vectors"},
}};

constexpr std::array<Operator, 5> all_operators{{
    {'+', strength_of_sum, false, "sum"},
    {'-', strength_of_sum, false, "difference"},
    {'*', strength_of_product, false, "product"},
    {'/', strength_of_product, false, "quotient"},
    {'^', strength_of_power, true, "power"},
}};

constexpr std::array<Constant, 1> all_constants{{{"pi", std::numbers::pi, "3.14159..."}}};

template <typename Table, typename Matches>
auto find_in(const Table& table, const Matches& matches) -> decltype(table.data()) {
  const auto found = std::find_if(table.begin(), table.end(), matches);
  return found == table.end() ? nullptr : &*found;
}

}  // namespace

std::span<const Function> functions() {
  return all_functions;
}
std::span<const Word> words() {
  return all_words;
}
std::span<const Operator> operators() {
  return all_operators;
}
std::span<const Constant> constants() {
  return all_constants;
}

const Function* find_function(std::string_view name) {
  return find_in(all_functions, [&](const Function& entry) { return entry.name == name; });
}
const Word* find_word(std::string_view name) {
  return find_in(all_words, [&](const Word& entry) { return entry.name == name; });
}
const Operator* find_operator(char symbol) {
  return find_in(all_operators, [&](const Operator& entry) { return entry.symbol == symbol; });
}
const Constant* find_constant(std::string_view name) {
  return find_in(all_constants, [&](const Constant& entry) { return entry.name == name; });
}

}  // namespace rubato::formula
