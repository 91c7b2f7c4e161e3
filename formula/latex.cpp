#include <rubato/formula/latex.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include <rubato/formula/loop.hpp>

namespace rubato::formula {

namespace {

/// How tightly a text binds.
enum class Binding { sum = 1, product = 2, prefix = 3, atom = 4 };

struct LatexText {
  std::string latex;
  Binding binding = Binding::atom;

  /// In parentheses where it binds less tightly than it has to.
  [[nodiscard]] std::string within(Binding least) const {
    return binding < least ? "\\left(" + latex + "\\right)" : latex;
  }
};

bool is_greek_letter(std::string_view name) {
  static constexpr std::array<std::string_view, 32> letters = {
      "alpha", "beta",  "gamma", "delta", "epsilon", "zeta",  "eta",   "theta",   "iota", "kappa", "lambda",
      "mu",    "nu",    "xi",    "pi",    "rho",     "sigma", "tau",   "upsilon", "phi",  "chi",   "psi",
      "omega", "Gamma", "Delta", "Theta", "Lambda",  "Xi",    "Sigma", "Phi",     "Psi",  "Omega"};
  return std::ranges::find(letters, name) != letters.end();
}

std::string letters_of(std::string_view name) {
  const std::size_t digits = name.find_last_not_of("0123456789") + 1;
  const std::string_view word = name.substr(0, digits);
  const std::string letters = is_greek_letter(word) ? fmt::format("\\{}", word)
                              : word.size() > 1     ? fmt::format("\\mathrm{{{}}}", word)
                                                    : std::string(word);
  return digits == name.size() ? letters : fmt::format("{}_{{{}}}", letters, name.substr(digits));
}

std::string latex_number(double value) {
  const std::string text = fmt::format("{}", value);
  const std::size_t power = text.find('e');
  return power == std::string::npos
             ? text
             : fmt::format("{} \\cdot 10^{{{}}}", text.substr(0, power), std::stoi(text.substr(power + 1)));
}

/// sin, cos, … have a command of their own.
bool has_command(std::string_view function) {
  static constexpr std::array<std::string_view, 12> known = {"sin", "cos", "tan", "sinh", "cosh",   "tanh",
                                                             "exp", "log", "min", "max",  "arctan", "ln"};
  return std::ranges::find(known, function) != known.end();
}

class LatexWriter {
public:
  explicit LatexWriter(const Graph& graph) : graph_(graph) {}

  [[nodiscard]] LatexText of(NodeIndex index) const {
    const Node& node = graph_.node(index);
    switch (node.operation) {
      case Operation::constant:
        return {latex_number(node.value), std::signbit(node.value) ? Binding::prefix : Binding::atom};
      case Operation::variable: return {latex_name(graph_.variable_name(node.a))};
      case Operation::add:
        return {of(node.a).within(Binding::sum) + " + " + of(node.b).within(Binding::product), Binding::sum};
      case Operation::subtract:
        return {of(node.a).within(Binding::sum) + " - " + of(node.b).within(Binding::product), Binding::sum};
      case Operation::negate: return {"-" + of(node.a).within(Binding::product), Binding::prefix};
      case Operation::multiply: return {times(node.a, node.b), Binding::product};
      case Operation::divide: return {fmt::format("\\frac{{{}}}{{{}}}", of(node.a).latex, of(node.b).latex)};
      case Operation::power:
        return {fmt::format("{}^{{{}}}", of(node.a).within(Binding::atom), of(node.b).latex), Binding::product};
      case Operation::sqrt: return {fmt::format("\\sqrt{{{}}}", of(node.a).latex)};
      case Operation::abs: return {fmt::format("\\left|{}\\right|", of(node.a).latex)};
      default: break;
    }
    const std::string_view called = name(node.operation);
    std::string arguments = of(node.a).latex;
    if (arity(node.operation) == 2) {
      arguments += ", " + of(node.b).latex;
    }
    return {fmt::format("{}\\left({}\\right)",
                        has_command(called) ? fmt::format("\\{}", called) : fmt::format("\\operatorname{{{}}}", called),
                        arguments)};
  }

private:
  /// Numbers that are fractions of small ones are written so: ½ u_t².
  [[nodiscard]] std::string times(NodeIndex a, NodeIndex b) const {
    const Node& factor = graph_.node(a);
    if (factor.operation == Operation::constant) {
      for (const int denominator : {2, 3, 4, 6, 8, 12}) {
        const double numerator = factor.value * denominator;
        if (factor.value != std::round(factor.value) && std::abs(numerator - std::round(numerator)) < 1e-12) {
          return fmt::format("{}\\tfrac{{{}}}{{{}}} {}", numerator < 0.0 ? "-" : "", std::abs(std::round(numerator)),
                             denominator, of(b).within(Binding::product));
        }
      }
      return factor.value == -1.0 ? "-" + of(b).within(Binding::product)
                                  : of(a).latex + "\\, " + of(b).within(Binding::product);
    }
    return of(a).within(Binding::product) + "\\, " + of(b).within(Binding::product);
  }

  const Graph& graph_;
};

}  // namespace

std::string latex_name(std::string_view name) {
  const std::size_t bar = name.rfind('_');
  if (bar == std::string_view::npos || bar == 0 || bar + 1 == name.size()) {
    return letters_of(name);
  }
  // The index of a name that has one: (potential_u)_t.
  const std::string base = latex_name(name.substr(0, bar));
  const std::string index = letters_of(name.substr(bar + 1));
  const std::string letters(name.substr(bar + 1));
  const bool is_derivative = letters.find_first_not_of("txyz") == std::string::npos;
  const std::string shown = is_derivative ? letters : index;
  return base.find("_{") == std::string::npos ? fmt::format("{}_{{{}}}", base, shown)
                                              : fmt::format("\\left({}\\right)_{{{}}}", base, shown);
}

std::string to_latex(Expression expression) {
  if (!expression.valid()) {
    return "";
  }
  if (has_loops(expression)) {
    Graph own;
    return to_latex(unrolled(substitute(std::array{expression}, own, {}, {}).front()));
  }
  return LatexWriter(*expression.graph()).of(expression.index()).latex;
}

}  // namespace rubato::formula
