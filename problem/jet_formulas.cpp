#include <rubato/problem/jet_formulas.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <memory>
#include <optional>
#include <regex>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/parse.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>

namespace rubato {

/// A part of an equation's text that is not a formula of jets.
struct EquationPart {
  enum class Kind { derivative, conjugate, modulus };
  Kind kind = Kind::derivative;
  std::size_t begin = 0, end = 0;              ///< all of it
  std::size_t inner_begin = 0, inner_end = 0;  ///< what it is of
  std::string directions;
  int power = 1;  ///< of a modulus
};

namespace {

bool begins_name(char c) {
  return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_';
}
bool continues_name(char c) {
  return begins_name(c) || std::isdigit(static_cast<unsigned char>(c)) != 0;
}

/// The directions of [grid], whose reader refuses what else is wrong with it.
std::vector<std::string> axes_of(const Section& root) {
  std::vector<std::string> axes;
  if (const Entry* grid = find(root.entries(), "grid"); grid != nullptr && grid->value.table() != nullptr) {
    for (const std::string_view axis : axis_letters) {
      if (find(*grid->value.table(), axis) != nullptr) {
        axes.emplace_back(axis);
      }
    }
  }
  return axes;
}

/// The exponent n of "^n" from there on, and where it ends; 1 where there is none.
std::pair<int, std::size_t> exponent_from(const std::string& text, std::size_t from) {
  static const std::regex exponent(R"(^\s*\^\s*([2468])(?![\w.]))");
  std::smatch found;
  const std::string rest = text.substr(from);
  return std::regex_search(rest, found, exponent)
             ? std::pair(std::stoi(found[1].str()), from + static_cast<std::size_t>(found.length()))
             : std::pair(1, from);
}

/// The first |…| of a text, or else the first part in parentheses that has none within.
std::optional<EquationPart> first_part(const std::string& text, bool is_complex) {
  using Kind = EquationPart::Kind;
  if (const std::size_t bar = text.find('|'), other = bar == std::string::npos ? bar : text.find('|', bar + 1);
      other != std::string::npos) {
    const auto [power, end] = exponent_from(text, other + 1);
    return EquationPart{Kind::modulus, bar, end, bar + 1, other, "", power};
  }
  std::vector<std::size_t> open;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '(') {
      open.push_back(i);
    }
    if (text[i] != ')' || open.empty()) {
      continue;
    }
    const std::size_t first = open.back();
    open.pop_back();
    std::size_t name = first;
    while (name > 0 && continues_name(text[name - 1])) {
      --name;
    }
    static const std::regex suffix(R"(^\s*_([txyz]+)(?!\w))");
    std::smatch found;
    if (const std::string rest = text.substr(i + 1); std::regex_search(rest, found, suffix)) {
      const std::size_t inner = name < first ? name : first + 1;
      return EquationPart{
          Kind::derivative,         name,          i + 1 + static_cast<std::size_t>(found.length()), inner,
          name < first ? i + 1 : i, found[1].str()};
    }
    const std::string called = text.substr(name, first - name);
    if (is_complex && (called == "conj" || called == "abs2" || called == "abs")) {
      const auto [power, end] = called == "abs" ? exponent_from(text, i + 1) : std::pair(2, i + 1);
      return EquationPart{called == "conj" ? Kind::conjugate : Kind::modulus, name, end, first + 1, i, "", power};
    }
  }
  return std::nullopt;
}

}  // namespace

std::string complex_name(std::size_t i, std::size_t count) {
  return count == 1 ? "psi" : fmt::format("psi{}", i + 1);
}

std::set<std::string> names_in(std::string_view text) {
  std::set<std::string> names;
  for (std::size_t i = 0; i < text.size();) {
    if (!continues_name(text[i])) {
      ++i;
      continue;
    }
    const std::size_t first = i;
    while (i < text.size() && continues_name(text[i])) {
      ++i;
    }
    if (begins_name(text[first])) {
      names.emplace(text.substr(first, i - first));
    }
  }
  return names;
}

JetFormulas::JetFormulas(Section& root) : axes(axes_of(root)), taken(names_of_lattice(root)), root_(root) {
  density.graph = std::make_shared<formula::Graph>();
  density.dimensions = static_cast<int>(axes.size());
}

void JetFormulas::name_derivatives(const std::string& text, bool of_equation) {
  std::set<std::string> words = names_in(text);
  if (const Entry* definitions = find(root_.entries(), "definitions");
      definitions != nullptr && definitions->value.table() != nullptr) {
    for (const Entry& definition : *definitions->value.table()) {
      if (const std::string* formula = definition.value.string()) {
        words.merge(names_in(*formula));
      }
    }
  }
  for (const std::string& word : words) {
    if (parameters.find(word) != nullptr) {
      continue;
    }
    if (const std::size_t bar = word.rfind('_');
        bar != std::string::npos && parameters.find(word.substr(0, bar)) != nullptr &&
        std::ranges::find(density.fields, word.substr(0, bar)) == density.fields.end() && bar + 1 < word.size() &&
        word.find_first_not_of("txyz", bar + 1) == std::string::npos) {
      throw std::invalid_argument(
          fmt::format("{} is a derivative of the parameter {}, which has none", word, word.substr(0, bar)));
    }
    if (word == "i" && psi.empty() && of_equation) {
      throw std::invalid_argument(
          "i is the imaginary unit of a complex unknown, and that has to be called psi (or psi1, psi2, …): the "
          "equation has no derivative of it");
    }
    if (const auto found = derivative_named(word, density.fields)) {
      names_.insert(word);
      const formula::Expression variable = density.graph->variable(word);
      if (std::ranges::find(density.derivatives, variable, &FieldDensity::Derivative::variable) ==
          density.derivatives.end()) {
        density.derivatives.push_back({found->field, found->order, variable});
      }
      continue;
    }
    for (std::size_t i = 0; i < psi.size(); ++i) {
      const std::string name = complex_name(i, psi.size());
      if (word == name) {
        complex_names_[word] = {word, i, {}};
      } else if (const auto complex = derivative_named(word, {name})) {
        complex_names_[word] = {word, i, complex->order};
      }
    }
  }
}

formula::Expression JetFormulas::build(const FormulaText& text) {
  std::vector<std::string> names = density.fields;
  names.insert(names.end(), names_.begin(), names_.end());
  for (const auto& [name, found] : complex_names_) {
    names.push_back(name);
  }
  if (!psi.empty()) {
    names.emplace_back("i");
  }
  names.insert(names.end(), part_names_.begin(), part_names_.end());
  names.insert(names.end(), axes.begin(), axes.end());
  names.emplace_back("t");
  if (!std::exchange(has_definitions_, true)) {
    std::vector<formula::Expression> differentiated;
    add_definitions(root_, taken,
                    {.names = names, .differentiable = density.fields, .axes = axes, .differentiated = &differentiated},
                    parameters);
  }
  return build_formula(text, *density.graph, {.names = names}, parameters);
}

Complex JetFormulas::side(const FormulaText& stated) {
  FormulaText text = stated;
  while (const auto part = first_part(text.text, !psi.empty())) {
    const Complex value = value_of(*part, text.text, text.location);
    const std::string name = name_of_part(text.text.substr(part->begin, part->end - part->begin));
    part_names_.push_back(name);
    parts_[density.graph->variable(name).index()] = value;
    text.text.replace(part->begin, name.size(), name);
  }
  name_derivatives(text.text, true);
  const formula::Expression whole = build(text);
  std::map<formula::NodeIndex, Complex> parts = parts_;
  formula::Graph& graph = *density.graph;
  if (!psi.empty()) {
    parts[graph.variable("i").index()] = {graph.constant(0.0), graph.constant(1.0)};
  }
  for (const auto& [name, found] : complex_names_) {
    const auto& [re, im] = psi[found.field];
    parts[graph.variable(name).index()] = {derivative(re, found.order), derivative(im, found.order)};
  }
  return ComplexParts(graph, std::move(parts))(whole);
}

/// A name as long as the text and much like it, so that later errors keep their columns.
std::string JetFormulas::name_of_part(std::string text) const {
  std::ranges::replace_if(
      text, [](char c) { return !continues_name(c); }, '_');
  const std::string base = text;
  for (std::size_t n = 0; std::ranges::find(part_names_, text) != part_names_.end(); ++n) {
    const std::string number = std::to_string(n);
    text = base.substr(0, base.size() - number.size()) + number;
  }
  return text;
}

Complex JetFormulas::value_of(const EquationPart& part, const std::string& text, const Location& place) {
  Complex value = side({text.substr(part.inner_begin, part.inner_end - part.inner_begin),
                        place_in_file(place, 1, part.inner_begin + 1)});
  if (part.kind == EquationPart::Kind::conjugate) {
    value.im = value.im ? std::optional(-*value.im) : std::nullopt;
  } else if (part.kind == EquationPart::Kind::modulus) {
    const formula::Expression square = value.im ? pow(value.re, 2.0) + pow(*value.im, 2.0) : pow(value.re, 2.0);
    value = {part.power == 1   ? value.im ? sqrt(square) : abs(value.re)
               : part.power == 2 ? square
                               : pow(square, part.power / 2.0),
             std::nullopt};
  }
  for (const char direction : part.directions) {
    const std::size_t mu = std::string_view("txyz").find(direction);
    if (mu > axes.size()) {
      throw ProblemError(place_in_file(place, 1, part.begin + 1),
                         fmt::format("a derivative by {0}, and [grid] has no {0}", direction));
    }
    value.re = differentiated(value.re, mu);
    value.im = value.im ? std::optional(differentiated(*value.im, mu)) : std::nullopt;
  }
  return value;
}

/// D_μ e = ∂e/∂x_μ + Σ ∂e/∂u_J u_Jμ.
formula::Expression JetFormulas::differentiated(formula::Expression e, std::size_t mu) {
  formula::Expression sum = formula::derivative(e, density.graph->variable(mu == 0 ? "t" : axes[mu - 1]));
  const auto add = [&](std::size_t f, DerivativeOrder order, formula::Expression variable) {
    const formula::Expression slope = formula::derivative(e, variable);
    if (!slope.is_constant() || slope.constant_value() != 0.0) {
      ++order.at(mu);
      sum = sum + slope * derivative(f, order);
    }
  };
  for (std::size_t f = 0; f < density.fields.size(); ++f) {
    add(f, {}, field(f));
  }
  const std::vector<FieldDensity::Derivative> known = density.derivatives;  // more are added
  for (const auto& [f, order, variable] : known) {
    add(f, order, variable);
  }
  return sum;
}

formula::Expression JetFormulas::derivative(std::size_t f, const DerivativeOrder& order) {
  if (order == DerivativeOrder{}) {
    return field(f);
  }
  const std::string name = derivative_name(density.fields[f], order);
  const auto found =
      std::ranges::find_if(density.derivatives, [&](const auto& one) { return one.field == f && one.order == order; });
  if (found != density.derivatives.end()) {
    return found->variable;
  }
  density.derivatives.push_back({f, order, density.graph->variable(name)});
  return density.derivatives.back().variable;
}

}  // namespace rubato
