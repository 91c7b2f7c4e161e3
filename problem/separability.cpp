#include <cctype>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/parse.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

namespace {

struct Term {
  std::size_t begin = 0, end = 0;  ///< in the text of the sum, without the sign that joins it to the term before
};

/// Whether the sign at `place` is that of an exponent, as in 1e-3.
bool is_in_number(std::string_view text, std::size_t place) {
  if (place < 2 || (text[place - 1] != 'e' && text[place - 1] != 'E')) {
    return false;
  }
  std::size_t begin = place - 1;
  while (begin > 0 && (std::isalnum(static_cast<unsigned char>(text[begin - 1])) != 0 || text[begin - 1] == '.' ||
                       text[begin - 1] == '_')) {
    --begin;
  }
  return std::isdigit(static_cast<unsigned char>(text[begin])) != 0 || text[begin] == '.';
}

/// The terms of a sum as it is written, outside of parentheses.
std::vector<Term> terms_of(std::string_view text) {
  std::vector<Term> terms;
  std::size_t begin = 0;
  int depth = 0;
  char last = '+';  // the last character that is not blank
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const bool has_left_side = std::string_view("+-*/^").find(last) == std::string_view::npos;
    if ((c == '+' || c == '-') && depth == 0 && has_left_side && !is_in_number(text, i)) {
      terms.push_back({begin, i});
      begin = i + 1;
    }
    depth += c == '(' ? 1 : c == ')' ? -1 : 0;
    last = std::isspace(static_cast<unsigned char>(c)) != 0 ? last : c;
  }
  terms.push_back({begin, text.size()});
  for (Term& term : terms) {
    while (term.begin < term.end && std::isspace(static_cast<unsigned char>(text[term.begin])) != 0) {
      ++term.begin;
    }
  }
  return terms;
}

std::string shortened(const std::string& term) {
  constexpr std::size_t longest = 100;
  return term.size() <= longest ? term : fmt::format("{} ...", term.substr(0, longest));
}

/// \param graph where its parts are, with the names as variables
Separation separation_in(formula::Graph& graph, const FormulaText& H, const std::vector<std::string>& names,
                         const Parameters& parameters) {
  std::vector<formula::Expression> variables;
  for (const std::string& name : names) {
    variables.push_back(graph.variable(name));
  }
  return separate(build_formula(H, graph, {names, {}, {}}, parameters), variables);
}

std::string mixed_term(const FormulaText& H, const std::vector<std::string>& names, const Parameters& parameters) {
  formula::Graph graph;
  return separation_in(graph, H, names, parameters).mixed;
}

/// Where in the text the first term stands that is mixed by itself; at its beginning if it cannot be reported.
std::size_t place_of_mixed(const HamiltonianProblem& orbit, const std::vector<std::string>& names,
                           const Parameters& parameters) {
  const std::string& text = orbit.H.text;
  for (const Term& term : terms_of(text)) {
    try {
      const FormulaText part{text.substr(term.begin, term.end - term.begin), orbit.H.location};
      if (!mixed_term(part, names, parameters).empty()) {
        return term.begin;
      }
    } catch (const ProblemError&) {
      break;
    }
  }
  return 0;
}

}  // namespace

void check_separable(const HamiltonianProblem& orbit, const Parameters& parameters) {
  const std::vector<std::string> names = orbit.names();
  const std::string mixed = mixed_term(orbit.H, names, parameters);
  if (mixed.empty()) {
    return;
  }
  const formula::ParseError error(
      orbit.H.text, place_of_mixed(orbit, names, parameters),
      fmt::format("lagrangian = \"splitting\" needs H = T(p) + V(q), and the term {} depends on coordinates and on "
                  "momenta; {}",
                  shortened(mixed),
                  orbit.constraints.empty() ? "use \"gauss\", \"midpoint\" or \"generating\""
                                            : "state the problem by its Lagrangian, in [lagrangian]"));
  throw ProblemError(place_in_file(orbit.H.location, error.line(), error.column()), error.what());
}

void check_kinetic_energy(const HamiltonianProblem& orbit, const Parameters& parameters, const Composition& composition,
                          const Location& location) {
  if (!composition.of_quadratic_kinetic_energy) {
    return;
  }
  const std::vector<std::string> names = orbit.names();
  formula::Graph graph;
  const Separation halves = separation_in(graph, orbit.H, names, parameters);
  std::vector<formula::Expression> momenta;
  for (const std::string& name : std::span(names).subspan(names.size() / 2)) {
    momenta.push_back(graph.variable(name));
  }
  if (!is_quadratic(halves.T, momenta)) {
    throw ProblemError(location,
                       fmt::format("composition = \"{}\" is of order {} where T(p) is of degree two alone, "
                                   "and T = {} is not; use \"{}\"",
                                   composition.name, composition.order, shortened(formula::to_string(halves.T)),
                                   composition_of_order(composition.order).name));
  }
}

}  // namespace rubato
