#include <algorithm>
#include <cmath>
#include <unordered_map>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/problem/noise.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {
namespace {

std::string name_at(const std::string& text, std::size_t offset) {
  std::size_t end = offset;
  while (end < text.size() && (is_identifier(text.substr(offset, end - offset + 1)))) {
    ++end;
  }
  return text.substr(std::min(offset, text.size()), end - offset);
}

bool contains(std::span<const std::string> names, std::string_view wanted) {
  return std::find(names.begin(), names.end(), wanted) != names.end();
}

/// Why a name that looks right is not available here; empty if there is nothing to say.
std::string remark_on(const std::string& name, const Vocabulary& vocabulary) {
  const auto& names = vocabulary.names;
  const auto has = [&names](const std::string& wanted) { return contains(names, wanted); };
  if (has(name)) {
    return "";
  }
  if (has(name + "1")) {
    return fmt::format("\n{0} is a vector: its components are {0}1, {0}2, …", name);
  }
  if (name.ends_with("_dot") && has(name.substr(0, name.size() - 4) + "1_dot")) {
    const std::string base = name.substr(0, name.size() - 4);
    return fmt::format("\n{0} is a vector: the velocities of its components are {0}1_dot, {0}2_dot, …", base);
  }
  if (has(name + "_0")) {
    return fmt::format("\nL is a formula in the values at both ends of a step: {0}_0 and {0}_1", name);
  }
  if (name == "t") {
    return "\nt is available in H and in [exact], and as t_0 and t_1 in a custom L";
  }
  if (name == "x" || name == "y" || name == "z") {
    return fmt::format(
        "\n{} is available in S, [initial], [exact] and densities of a lattice that has this direction only", name);
  }
  if (name == "integral") {
    return vocabulary.integrands != nullptr
               ? "\nintegral(f) is a number: it takes one formula, in which there is no integral"
               : "\nintegral(f) is available in [output.quantities] of a lattice only";
  }
  if (name == "dx" || name == "dy" || name == "dz") {
    return vocabulary.axes.empty()
               ? fmt::format("\n{} is available in [initial] and [invariants] of a lattice only", name)
               : fmt::format("\n{}(f) differentiates a field f along {} of the grid, which has {}", name, name[1],
                             fmt::join(vocabulary.axes, ", "));
  }
  return "";
}

/// The entries of a table as formulas that may name each other, and what else `vocabulary` and `constants` have.
struct MutualFormulas {
  std::string_view role;  ///< what the entries are called
  const Value::Table& entries;
  std::vector<std::vector<std::size_t>> needs;  ///< which others each one names

  MutualFormulas(std::string_view called, const Value::Table& table, const Vocabulary& vocabulary,
                 std::span<const Parameter> constants)
      : role(called), entries(table), needs(table.size()) {
    std::unordered_map<std::string_view, std::size_t> index;
    std::vector<std::string> names(vocabulary.names.begin(), vocabulary.names.end());
    for (std::size_t i = 0; i < table.size(); ++i) {
      index.emplace(table[i].key, i);
      names.push_back(table[i].key);
    }
    for (std::size_t i = 0; i < table.size(); ++i) {
      if (table[i].value.string() == nullptr) {
        continue;
      }
      formula::Graph graph;
      const auto expression = build_formula(read_formula(table[i].value, table[i].key), graph,
                                            {.names = names,
                                             .differentiable = vocabulary.differentiable,
                                             .axes = vocabulary.axes,
                                             .periods = vocabulary.periods},
                                            constants);
      for (const std::size_t variable : formula::variables_of(expression)) {
        if (const auto found = index.find(graph.variable_name(variable)); found != index.end()) {
          needs[i].push_back(found->second);
        }
      }
    }
  }

  /// An order in which each comes after those it needs.
  [[nodiscard]] std::vector<std::size_t> order() const {
    std::vector<std::size_t> missing(entries.size());
    std::vector<std::vector<std::size_t>> needed_by(entries.size());
    std::vector<std::size_t> ready;
    for (std::size_t i = 0; i < entries.size(); ++i) {
      missing[i] = needs[i].size();
      for (const std::size_t other : needs[i]) {
        needed_by[other].push_back(i);
      }
      if (missing[i] == 0) {
        ready.push_back(i);
      }
    }
    for (std::size_t done = 0; done < ready.size(); ++done) {
      for (const std::size_t other : needed_by[ready[done]]) {
        if (--missing[other] == 0) {
          ready.push_back(other);
        }
      }
    }
    if (ready.size() < entries.size()) {
      refuse_cycle(missing);
    }
    return ready;
  }

private:
  [[noreturn]] void refuse_cycle(const std::vector<std::size_t>& missing) const {
    const auto unresolved = [&](std::size_t i) { return missing[i] > 0; };
    std::size_t at = 0;
    while (!unresolved(at)) {
      ++at;
    }
    std::vector<std::size_t> path;
    while (std::find(path.begin(), path.end(), at) == path.end()) {
      path.push_back(at);
      at = *std::find_if(needs[at].begin(), needs[at].end(), unresolved);
    }
    std::vector<std::string> cycle;
    for (auto step = std::find(path.begin(), path.end(), at); step != path.end(); ++step) {
      cycle.push_back(entries[*step].key);
    }
    cycle.push_back(entries[at].key);
    constexpr std::size_t longest = 20;
    if (cycle.size() > longest) {
      cycle.resize(longest);
      cycle.emplace_back("…");
    }
    throw ProblemError(entries[at].location,
                       fmt::format("{} depend on each other in a cycle: {}", role, fmt::join(cycle, " -> ")));
  }
};

}  // namespace

Location place_in_file(const Location& start, std::size_t line, std::size_t column) {
  if (start.line == 0) {
    return start;
  }
  const auto down = static_cast<int>(line) - 1;
  const auto right = static_cast<int>(column);
  return {start.file, start.line + down, down == 0 ? start.column + right - 1 : right};
}

formula::Expression build_formula(const FormulaText& text, formula::Graph& graph, const Vocabulary& vocabulary,
                                  std::span<const Parameter> parameters) {
  const auto& names = vocabulary.names;
  const auto& differentiable = vocabulary.differentiable;
  const auto& integrands = vocabulary.integrands;
  std::unordered_map<std::string_view, formula::Expression> known;
  std::vector<std::string> suggestions(names.begin(), names.end());
  for (const std::string& name : names) {
    known.emplace(name, graph.variable(name));
  }
  std::unordered_map<std::string_view, const FormulaText*> definitions;
  for (const Parameter& parameter : parameters) {
    if (parameter.definition) {
      definitions.emplace(parameter.name, &*parameter.definition);
    } else {
      known.emplace(parameter.name, graph.constant(parameter.value));
    }
    const bool is_written = !parameter.definition || parameter.definition->location.line != 0 ||
                            !parameter.definition->location.file.empty();
    if (is_written) {
      suggestions.push_back(parameter.name);
    }
  }
  // dx(f) is a variable of that name; f, or again such a derivative, must be a variable that has one.
  for (const std::string& name : differentiable) {
    known.emplace(name, graph.variable(name));
    suggestions.push_back(name);
  }
  const auto resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
    if (const auto found = known.find(name); found != known.end()) {
      return found->second;
    }
    const auto defined = definitions.find(name);
    if (defined == definitions.end()) {
      return std::nullopt;
    }
    try {
      return known.emplace(name, build_formula(*defined->second, graph, vocabulary, parameters)).first->second;
    } catch (const ProblemError& error) {  // of a name that is known to definitions, and not here
      if (defined->second->location.file.empty() && defined->second->location.line == 0) {
        return std::nullopt;  // nobody wrote it: t of a driven system stands for the coordinate `time`
      }
      throw ProblemError(error.location(), fmt::format("{}\n(in the definition of {}, which is used at {})",
                                                       error.reason(), name, text.location.text()));
    }
  };
  const auto call = [&](std::string_view name,
                        std::span<const formula::Expression> arguments) -> std::optional<formula::Expression> {
    const auto is_known = [&](const GridAxis& axis) { return contains(names, axis.name); };
    if (name == "noise" && !vocabulary.periods.empty() && std::ranges::all_of(vocabulary.periods, is_known)) {
      const auto integer = [&](std::size_t i) { return static_cast<std::int64_t>(arguments[i].constant_value()); };
      return random_waves(graph, vocabulary.periods, integer(0), integer(1));
    }
    if (name == "integral" && integrands != nullptr && arguments.size() == 1) {
      for (const std::size_t variable : formula::variables_of(arguments[0])) {
        if (graph.variable_name(variable).starts_with("integral ")) {
          return std::nullopt;  // of an integral
        }
      }
      integrands->push_back(arguments[0]);
      return graph.variable(fmt::format("{} {}", name, integrands->size()));
    }
    const bool is_derivative = name.starts_with('d') && contains(vocabulary.axes, name.substr(1));
    if (!is_derivative || arguments.size() != 1) {
      return std::nullopt;
    }
    const formula::Node& node = graph.node(arguments[0].index());
    if (node.operation != formula::Operation::variable) {
      return std::nullopt;
    }
    const std::string& inner = graph.variable_name(node.a);
    const bool allowed = inner.back() == ')' || contains(vocabulary.differentiable, inner);
    return allowed ? std::optional(graph.variable(fmt::format("{}({})", name, inner))) : std::nullopt;
  };
  try {
    return formula::parse(text.text, graph, {resolve, call, suggestions});
  } catch (const formula::ParseError& error) {
    std::string remark = remark_on(name_at(text.text, error.offset()), vocabulary);
    constexpr std::size_t longest_list = 12;
    if (remark.empty() && error.reason().starts_with("unknown name") && error.reason().ends_with("'")) {
      // Nothing near it: what there is.
      std::sort(suggestions.begin(), suggestions.end());
      suggestions.erase(std::unique(suggestions.begin(), suggestions.end()), suggestions.end());
      remark = names.empty() && parameters.empty()  ? "\nno names are known here, but for pi and the functions"
               : suggestions.size() <= longest_list ? fmt::format("\nknown here: {}", fmt::join(suggestions, ", "))
                                                    : "";
    }
    throw ProblemError(place_in_file(text.location, error.line(), error.column()), error.what() + remark);
  }
}

bool names_time(const FormulaText& text, const Vocabulary& vocabulary, std::span<const Parameter> parameters) {
  formula::Graph graph;
  const auto variables = formula::variables_of(build_formula(text, graph, vocabulary, parameters));
  return std::ranges::any_of(variables, [&](std::size_t i) { return graph.variable_name(i) == "t"; });
}

void check_formula(const FormulaText& text, const Vocabulary& vocabulary, std::span<const Parameter> parameters) {
  formula::Graph graph;
  static_cast<void>(build_formula(text, graph, vocabulary, parameters));
}

std::vector<Parameter> read_parameters(Section& root, Names& names) {
  const auto section = root.take_section("parameters");
  if (!section) {
    return {};
  }
  const Value::Table& entries = section->entries();
  for (const Entry& entry : entries) {
    names.declare(entry.key, "a parameter", entry.location);
  }
  std::vector<Parameter> parameters;
  parameters.reserve(entries.size());
  for (const std::size_t i : MutualFormulas("parameters", entries, {}, {}).order()) {
    parameters.push_back(
        {entries[i].key, read_number(entries[i].value, entries[i].key, parameters), entries[i].value.location});
  }
  return parameters;
}

void add_definitions(Section& root, Names& taken, const Vocabulary& vocabulary, std::vector<Parameter>& parameters) {
  const auto section = root.take_section("definitions");
  if (!section) {
    return;
  }
  const Value::Table& entries = section->entries();
  for (const Entry& entry : entries) {
    taken.declare(entry.key, "a definition", entry.location);
  }
  const MutualFormulas mutual("definitions", entries, vocabulary, parameters);
  constexpr int deepest = 200;  // every one is read inside the one that names it
  std::vector<int> depth(entries.size(), 0);
  for (const std::size_t i : mutual.order()) {
    for (const std::size_t other : mutual.needs[i]) {
      depth[i] = std::max(depth[i], depth[other] + 1);
    }
    if (depth[i] > deepest) {
      throw ProblemError(entries[i].location,
                         fmt::format("definitions are nested deeper than {} levels here", deepest));
    }
    parameters.push_back({.name = entries[i].key,
                          .location = entries[i].value.location,
                          .definition = read_formula(entries[i].value, entries[i].key)});
  }
}

}  // namespace rubato
