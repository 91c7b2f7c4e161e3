#include <rubato/formula/language.hpp>

#include <algorithm>
#include <array>
#include <numbers>

#include <rubato/formula/operations.hpp>

namespace rubato::formula {

namespace {

constexpr std::string_view arguments_of(Form form) {
  switch (form) {
    case Form::one: return "x";
    case Form::two: return "y, x";
    case Form::several: return "a, b, ...";
    case Form::order: return "n, x";
    case Form::parameter: return "u, m";
  }
  return "";
}

constexpr std::array all_functions = {
#define RUBATO_FUNCTION(id, name, form, is, symmetry, value, error, gives_way, domain, meaning) \
  Function{#name, Operation::id, meaning, domain, Form::form == Form::several, arguments_of(Form::form), gives_way},
#include <rubato/formula/operations.inc>
};

constexpr std::array<Word, 8> all_words{{
    {"ellipk", "m", "complete elliptic integral K of the parameter m, a known number, 0 <= m < 1"},
    {"ellipe", "m", "complete elliptic integral E of the parameter m, a known number, 0 <= m <= 1"},
    {"where", "c, a, b", "a where the comparison c holds, else b; see Choices"},
    {"noise", "seed", "a normal random number, by an integer that is known; see Random numbers"},
    {"mod", "x, y", "x - y*floor(x/y): what is left of x, from 0 to y, where it goes round with the period y"},
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

struct ForeignName {
  std::string_view name, advice;
};
constexpr std::string_view write_choice = "write where(x > 0, 1, 0)";
constexpr std::array all_foreign_names = {
    ForeignName{"pow", "write a^b"},
    ForeignName{"power", "write a^b"},
    ForeignName{"sqr", "write x^2"},
    ForeignName{"square", "write x^2"},
    ForeignName{"ln", "the natural logarithm is log"},
    ForeignName{"Log", "the natural logarithm is log"},
    ForeignName{"log10", "write log(x)/log(10)"},
    ForeignName{"log2", "write log(x)/log(2)"},
    ForeignName{"exp2", "write 2^x"},
    ForeignName{"exp10", "write 10^x"},
    ForeignName{"fabs", "write abs(x)"},
    ForeignName{"arcsin", "write asin(x)"},
    ForeignName{"arccos", "write acos(x)"},
    ForeignName{"arctan", "write atan(x)"},
    ForeignName{"arctan2", "write atan2(y, x)"},
    ForeignName{"arcsinh", "write asinh(x)"},
    ForeignName{"arccosh", "write acosh(x)"},
    ForeignName{"arctanh", "write atanh(x)"},
    ForeignName{"arsinh", "write asinh(x)"},
    ForeignName{"arcosh", "write acosh(x)"},
    ForeignName{"artanh", "write atanh(x)"},
    ForeignName{"tg", "write tan(x)"},
    ForeignName{"cot", "write 1/tan(x)"},
    ForeignName{"ctg", "write 1/tan(x)"},
    ForeignName{"sec", "write 1/cos(x)"},
    ForeignName{"csc", "write 1/sin(x)"},
    ForeignName{"cosec", "write 1/sin(x)"},
    ForeignName{"coth", "write 1/tanh(x)"},
    ForeignName{"cosech", "write csch(x)"},
    ForeignName{"erfc", "write 1 - erf(x)"},
    ForeignName{"sgn", "write sign(x)"},
    ForeignName{"signum", "write sign(x)"},
    ForeignName{"hypot", "write norm(x, y)"},
    ForeignName{"fmin", "write min(a, b)"},
    ForeignName{"fmax", "write max(a, b)"},
    ForeignName{"minimum", "write min(a, b)"},
    ForeignName{"maximum", "write max(a, b)"},
    ForeignName{"heaviside", write_choice},
    ForeignName{"Heaviside", write_choice},
    ForeignName{"step", write_choice},
    ForeignName{"theta", write_choice},
    ForeignName{"if", "write where(a < b, f, g)"},
    ForeignName{"ifelse", "write where(a < b, f, g)"},
    ForeignName{"piecewise", "write where(a < b, f, g)"},
    ForeignName{"jn", "write besselj(n, x)"},
    ForeignName{"yn", "write bessely(n, x)"},
    ForeignName{"j0", "write besselj(0, x)"},
    ForeignName{"j1", "write besselj(1, x)"},
    ForeignName{"y0", "write bessely(0, x)"},
    ForeignName{"y1", "write bessely(1, x)"},
    ForeignName{"ellipticK", "write ellipk(m)"},
    ForeignName{"ellipticE", "write ellipe(m)"},
    ForeignName{"diff", "write dx(f) for a derivative on a grid"},
    ForeignName{"integrate", "write integral(f), in [output.quantities] of a lattice"},
    ForeignName{"rand", "write noise(seed)"},
    ForeignName{"random", "write noise(seed)"},
};

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
std::string_view foreign_advice(std::string_view name) {
  const ForeignName* const found =
      find_in(all_foreign_names, [&](const ForeignName& entry) { return entry.name == name; });
  return found == nullptr ? std::string_view() : found->advice;
}
const Constant* find_constant(std::string_view name) {
  return find_in(all_constants, [&](const Constant& entry) { return entry.name == name; });
}

}  // namespace rubato::formula
