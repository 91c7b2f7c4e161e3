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
