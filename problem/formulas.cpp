#include <algorithm>
#include <cmath>
#include <unordered_map>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/problem/noise.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

Location place_in_file(const Location& start, std::size_t line, std::size_t column) {
  if (start.line == 0) {
    return start;
  }
  const auto down = static_cast<int>(line) - 1;
  const auto right = static_cast<int>(column);
  return {start.file, start.line + down, down == 0 ? start.column + right - 1 : right};
}

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
  if (const std::size_t end = name.find_last_not_of("0123456789"); end != std::string::npos) {
    const bool has_digits = end + 1 < name.size() && name[end] == '_';
    const std::string base = has_digits ? name.substr(0, end) : name;
    for (const std::string zeros : {"00", "000", "0000"}) {
      if (has(fmt::format("{}_{}", base, zeros))) {
        const std::string ones(zeros.size(), '1');
        return fmt::format(
            "\nL is a density of the values at the corners of one cell: {0}_{1}, …, {0}_{2}, digits 0 or 1 for the "
            "level, "
            "then {3}; no other level or node is part of it",
            base, zeros, ones,
            zeros.size() == 2   ? "the node"
            : zeros.size() == 3 ? "y and x"
                                : "z, y and x");
      }
    }
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
  if (name == "t" && has("h")) {
    return "\nt is available in L of a driven lattice, whose S names it";
  }
  if (name == "t") {
    return "\nt is available in H, [initial] and [exact], and as t_0 and t_1 in a custom L";
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
           : !contains(vocabulary.axes, name.substr(1))
               ? fmt::format("\n{}(f) differentiates f along {} of the grid, which has {}", name, name[1],
                             fmt::join(vocabulary.axes, ", "))
               : "";
  }
  return "";
}

/// Reads formulas of one graph: names as variables, parameters as constants, definitions as their formulas.
class FormulaReader {
public:
  /// `others` resolves names before parameters and definitions do; may be empty.
  FormulaReader(formula::Graph& graph, const Vocabulary& vocabulary, const Parameters& parameters,
                formula::NameResolver others = {})
      : graph_(graph), vocabulary_(vocabulary), parameters_(parameters), others_(std::move(others)) {
    for (const std::string& name : vocabulary.names) {
      known_.emplace(name, graph.variable(name));
    }
    // dx(f) is a variable of that name; f, or again such a derivative, must be a variable that has one.
    for (const std::string& name : vocabulary.differentiable) {
      known_.emplace(name, graph.variable(name));
    }
  }

  /// \throws ProblemError at the place in the file
  formula::Expression read(const FormulaText& text) {
    const formula::NameResolver resolve = [&](std::string_view name) { return this->resolve(name, text); };
    const formula::CallResolver call = [&](std::string_view name, std::span<const formula::Expression> arguments) {
      return this->call(name, arguments);
    };
    try {
      return formula::parse(text.text, graph_, {.resolve = resolve, .call = call, .known_names = {}});
    } catch (const formula::ParseError&) {
      // Read once more below, for a message with suggestions.
    }
    std::vector<std::string> suggestions = known_names();
    try {
      return formula::parse(text.text, graph_, {.resolve = resolve, .call = call, .known_names = suggestions});
    } catch (const formula::ParseError& error) {
      throw ProblemError(place_in_file(text.location, error.line(), error.column()),
                         error.what() + remark(text, error, std::move(suggestions)));
    }
  }

private:
  /// Nobody wrote it: t of a driven system stands for the coordinate `time`.
  [[nodiscard]] static bool is_made(const Parameter& parameter) {
    return parameter.definition && parameter.definition->location.file.empty() &&
           parameter.definition->location.line == 0;
  }

  std::optional<formula::Expression> resolve(std::string_view name, const FormulaText& text) {
    if (const auto found = known_.find(name); found != known_.end()) {
      return found->second;
    }
    if (const auto other = others_ ? others_(name) : std::nullopt) {
      return other;
    }
    const Parameter* const parameter = parameters_.find(name);
    if (parameter == nullptr) {
      return std::nullopt;
    }
    if (!parameter->definition) {
      return known_.emplace(parameter->name, graph_.constant(parameter->value)).first->second;
    }
    return expand(*parameter, text);
  }

  /// The definition's expression, after those of all definitions that it needs, however long their chain is; nothing
  /// for one that nobody wrote where its names are unknown.
  std::optional<formula::Expression> expand(const Parameter& definition, const FormulaText& text) {
    std::vector<const Parameter*> waiting = {&definition};
    while (!waiting.empty()) {
      const Parameter& next = *waiting.back();
      const std::size_t count = waiting.size();
      for (const std::string& need : next.needs) {
        if (!known_.contains(need)) {
          waiting.push_back(parameters_.find(need));
        }
      }
      if (waiting.size() > count) {
        continue;
      }
      waiting.pop_back();
      if (known_.contains(next.name)) {
        continue;
      }
      try {
        known_.emplace(next.name, read(*next.definition));
      } catch (const ProblemError& error) {  // of a name that is known to definitions, and not here
        if (is_made(next)) {
          return std::nullopt;
        }
        throw ProblemError(error.location(), fmt::format("{}\n(in the definition of {}, which is used at {})",
                                                         error.reason(), next.name, text.location.text()));
      }
    }
    return known_.at(definition.name);
  }

  std::optional<formula::Expression> call(std::string_view name, std::span<const formula::Expression> arguments) {
    const auto is_known = [&](const GridAxis& axis) { return contains(vocabulary_.names, axis.name); };
    if (name == "noise" && !vocabulary_.periods.empty() && std::ranges::all_of(vocabulary_.periods, is_known)) {
      const auto integer = [&](std::size_t i) { return static_cast<std::int64_t>(arguments[i].constant_value()); };
      return random_waves(graph_, vocabulary_.periods, integer(0), integer(1));
    }
    if (name == "integral" && vocabulary_.integrands != nullptr && arguments.size() == 1) {
      for (const std::size_t variable : formula::variables_of(arguments[0])) {
        if (graph_.variable_name(variable).starts_with("integral ")) {
          return std::nullopt;  // of an integral
        }
      }
      vocabulary_.integrands->push_back(arguments[0]);
      return graph_.variable(fmt::format("{} {}", name, vocabulary_.integrands->size()));
    }
    const bool is_derivative = name.starts_with('d') && contains(vocabulary_.axes, name.substr(1));
    if (!is_derivative) {
      return std::nullopt;
    }
    if (arguments.size() != 1) {
      throw std::invalid_argument(fmt::format("{} takes 1 argument, got {}", name, arguments.size()));
    }
    return graph_.variable(fmt::format("{}({})", name, differentiated(name, arguments[0])));
  }

  /// What dx( ) holds: a field, such a derivative, or the name of an expression to be differentiated.
  std::string differentiated(std::string_view name, formula::Expression argument) {
    if (const formula::Node& node = graph_.node(argument.index()); node.operation == formula::Operation::variable) {
      const std::string& inner = graph_.variable_name(node.a);
      if (inner.back() == ')' || contains(vocabulary_.differentiable, inner)) {
        return inner;
      }
    }
    if (vocabulary_.differentiated == nullptr) {
      throw std::invalid_argument(
          fmt::format("{0} takes a field here, or a derivative of one, such as {0}({0}(f)); of a formula it is "
                      "available in [initial] of a lattice",
                      name));
    }
    auto& expressions = *vocabulary_.differentiated;
    auto place = std::ranges::find(expressions, argument);
    if (place == expressions.end()) {
      place = expressions.insert(place, argument);
    }
    return expression_name(static_cast<std::size_t>(place - expressions.begin()));
  }

  [[nodiscard]] std::vector<std::string> known_names() const {
    std::vector<std::string> names(vocabulary_.names.begin(), vocabulary_.names.end());
    for (const Parameter& parameter : parameters_) {
      if (!is_made(parameter)) {
        names.push_back(parameter.name);
      }
    }
    names.insert(names.end(), vocabulary_.differentiable.begin(), vocabulary_.differentiable.end());
    return names;
  }

  /// What else there is to say about an error.
  [[nodiscard]] std::string remark(const FormulaText& text, const formula::ParseError& error,
                                   std::vector<std::string> known) const {
    constexpr std::size_t longest_list = 12;
    if (std::string more = remark_on(name_at(text.text, error.offset()), vocabulary_); !more.empty()) {
      return more;
    }
    if (!error.reason().starts_with("unknown name") || !error.reason().ends_with("'")) {
      return "";
    }
    std::ranges::sort(known);
    known.erase(std::unique(known.begin(), known.end()), known.end());
    return vocabulary_.names.empty() && parameters_.size() == 0
               ? "\nno names are known here, but for pi and the functions"
           : known.size() <= longest_list ? fmt::format("\nknown here: {}", fmt::join(known, ", "))
                                          : "";
  }

  formula::Graph& graph_;
  Vocabulary vocabulary_;
  const Parameters& parameters_;
  formula::NameResolver others_;
  std::unordered_map<std::string_view, formula::Expression> known_;
};

/// The value of a formula that has to be a number.
double number_of(formula::Expression result, const FormulaText& text, std::string_view what) {
  if (!result.is_constant() || !std::isfinite(result.constant_value())) {
    throw ProblemError(text.location, fmt::format("{}: \"{}\" has no finite value", what, text.text.substr(0, 200)));
  }
  return result.constant_value();
}

/// Reads the entries of a table, formulas that may name each other in any order, each after those that it needs.
class MutualFormulas {
public:
  /// \param role what the entries are called \param numbers whether each has to be a number
  /// \throws ProblemError also for a cycle, naming it
  MutualFormulas(std::string_view role, const Value::Table& entries, const Vocabulary& vocabulary,
                 const Parameters& constants, bool numbers)
      : role_(role),
        entries_(entries),
        numbers_(numbers),
        reader_(graph_, vocabulary, constants, [this](std::string_view name) { return resolve(name); }),
        states_(entries.size(), State::unread),
        results_(entries.size()),
        needs_(entries.size()) {
    for (std::size_t i = 0; i < entries.size(); ++i) {
      index_.emplace(entries[i].key, i);
    }
    for (std::size_t i = 0; i < entries.size(); ++i) {
      read_from(i);
    }
  }

  /// The entries, each after those that it needs.
  [[nodiscard]] const std::vector<std::size_t>& order() const { return order_; }
  [[nodiscard]] formula::Expression result(std::size_t entry) const { return results_[entry]; }
  /// The keys of the entries that it names.
  [[nodiscard]] std::vector<std::string> needs(std::size_t entry) const {
    std::vector<std::string> keys;
    for (const std::size_t other : needs_[entry]) {
      keys.push_back(entries_[other].key);
    }
    return keys;
  }

private:
  enum class State { unread, waiting, read };

  /// Reads an entry, and before it all that it needs: no recursion, since chains may be long.
  void read_from(std::size_t first) {
    std::vector<std::size_t> stack = {first};
    while (!stack.empty()) {
      const std::size_t i = stack.back();
      if (states_[i] == State::read || attempt(i)) {
        stack.pop_back();
        continue;
      }
      states_[i] = State::waiting;
      for (auto missing = missing_.rbegin(); missing != missing_.rend(); ++missing) {
        if (states_[*missing] == State::waiting) {
          refuse_cycle(stack, *missing);
        }
        stack.push_back(*missing);
      }
    }
  }

  /// Reads an entry; false if it names others that are not read yet, which are then `missing_`.
  bool attempt(std::size_t i) {
    missing_.clear();
    needs_[i].clear();
    const Entry& entry = entries_[i];
    if (numbers_ && entry.value.string() == nullptr) {
      results_[i] = graph_.constant(read_number(entry.value, entry.key, {}));
    } else {
      const FormulaText text = read_formula(entry.value, entry.key);
      reading_ = i;
      try {
        results_[i] = reader_.read(text);
      } catch (const ProblemError&) {
        if (missing_.empty()) {
          throw;
        }
      }
      if (!missing_.empty()) {
        return false;
      }
      if (numbers_) {
        results_[i] = graph_.constant(number_of(results_[i], text, entry.key));
      }
    }
    std::ranges::sort(needs_[i]);
    needs_[i].erase(std::unique(needs_[i].begin(), needs_[i].end()), needs_[i].end());
    states_[i] = State::read;
    order_.push_back(i);
    return true;
  }

  std::optional<formula::Expression> resolve(std::string_view name) {
    const auto found = index_.find(name);
    if (found == index_.end()) {
      return std::nullopt;
    }
    const std::size_t other = found->second;
    if (states_[other] == State::read) {
      needs_[reading_].push_back(other);
      return results_[other];
    }
    missing_.push_back(other);
    return graph_.constant(1.0);  // any number: the formula is read again when all that it needs is there
  }

  /// Those of `stack` above `first` that wait do so for each other, the higher for the lower.
  [[noreturn]] void refuse_cycle(const std::vector<std::size_t>& stack, std::size_t first) const {
    std::vector<std::string> cycle;
    std::vector<bool> seen(entries_.size(), false);
    for (std::size_t place = stack.size(); !seen[first]; --place) {
      const std::size_t i = stack[place - 1];
      if (states_[i] == State::waiting && !seen[i]) {
        seen[i] = true;
        cycle.push_back(entries_[i].key);
      }
    }
    std::ranges::reverse(cycle);
    cycle.push_back(entries_[first].key);
    constexpr std::size_t longest = 20;
    if (cycle.size() > longest) {
      cycle.resize(longest);
      cycle.emplace_back("…");
    }
    throw ProblemError(entries_[first].location,
                       fmt::format("{} depend on each other in a cycle: {}", role_, fmt::join(cycle, " -> ")));
  }

  std::string_view role_;
  const Value::Table& entries_;
  bool numbers_;
  formula::Graph graph_;
  FormulaReader reader_;
  std::unordered_map<std::string_view, std::size_t> index_;
  std::vector<State> states_;
  std::vector<formula::Expression> results_;
  std::vector<std::vector<std::size_t>> needs_;
  std::vector<std::size_t> order_, missing_;
  std::size_t reading_ = 0;
};

}  // namespace

formula::Expression build_formula(const FormulaText& text, formula::Graph& graph, const Vocabulary& vocabulary,
                                  const Parameters& parameters) {
  return FormulaReader(graph, vocabulary, parameters).read(text);
}

std::string expression_name(std::size_t number) {
  return fmt::format("expression {}", number + 1);
}

bool names_time(const FormulaText& text, const Vocabulary& vocabulary, const Parameters& parameters) {
  formula::Graph graph;
  const auto variables = formula::variables_of(build_formula(text, graph, vocabulary, parameters));
  return std::ranges::any_of(variables, [&](std::size_t i) { return graph.variable_name(i) == "t"; });
}

void check_formula(const FormulaText& text, const Vocabulary& vocabulary, const Parameters& parameters) {
  formula::Graph graph;
  static_cast<void>(build_formula(text, graph, vocabulary, parameters));
}

double read_number(const Value& value, std::string_view what, const Parameters& parameters) {
  if (const auto* integer = std::get_if<std::int64_t>(&value.data)) {
    return static_cast<double>(*integer);
  }
  if (const auto* real = std::get_if<double>(&value.data)) {
    if (!std::isfinite(*real)) {
      throw ProblemError(value.location, fmt::format("{}: {} is not a finite number", what, *real));
    }
    return *real;
  }
  if (value.string() == nullptr) {
    wrong_type(value, what, "a number or a formula");
  }
  formula::Graph graph;
  const FormulaText text = read_formula(value, what);
  return number_of(build_formula(text, graph, {}, parameters), text, what);
}

Parameters read_parameters(Section& root, Names& names) {
  Parameters parameters;
  const auto section = root.take_section("parameters");
  if (!section) {
    return parameters;
  }
  const Value::Table& entries = section->entries();
  for (const Entry& entry : entries) {
    names.declare(entry.key, "a parameter", entry.location);
  }
  const MutualFormulas mutual("parameters", entries, {}, {}, true);
  for (const std::size_t i : mutual.order()) {
    parameters.push_back(
        {.name = entries[i].key, .value = mutual.result(i).constant_value(), .location = entries[i].value.location});
  }
  return parameters;
}

void add_definitions(Section& root, Names& taken, const Vocabulary& vocabulary, Parameters& parameters) {
  const auto section = root.take_section("definitions");
  if (!section) {
    return;
  }
  const Value::Table& entries = section->entries();
  for (const Entry& entry : entries) {
    taken.declare(entry.key, "a definition", entry.location);
  }
  const MutualFormulas mutual("definitions", entries, vocabulary, parameters, false);
  for (const std::size_t i : mutual.order()) {
    parameters.push_back({.name = entries[i].key,
                          .location = entries[i].value.location,
                          .definition = read_formula(entries[i].value, entries[i].key),
                          .needs = mutual.needs(i)});
  }
}

}  // namespace rubato
