#include <rubato/problem/solve.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/ode/orbit_methods.hpp>
#include <rubato/problem/broken_term.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/problem/solve_entries.hpp>

namespace rubato {

namespace {

using Ends = StatedSolve::Ends;

/// NAME_0 of every name, then NAME_1.
std::vector<std::string> end_names(const HamiltonianProblem& orbit) {
  std::vector<std::string> names;
  for (const char* suffix : {"_0", "_1"}) {
    for (const std::string& name : orbit.names()) {
      names.push_back(name + suffix);
    }
  }
  return names;
}

class SolveReader {
public:
  SolveReader(Section& section, const Problem& problem)
      : section_(section), problem_(problem), orbit_(*problem.hamiltonian()), names_(orbit_.names()) {}

  StatedSolve read() {
    solve_.location = section_.location();
    refuse_unknown_keys(section_, "solve");
    if (auto section = section_.take_section("continue")) {
      refuse_unknown_keys(*section, "solve.continue");
    }
    refuse_systems();
    read_ends();
    read_duration_and_energy(section_, problem_, solve_);
    read_steps();
    read_guess();
    read_starts();
    read_continuation();
    read_newton(section_, problem_, solve_);
    section_.finish();
    refuse_unknown_counts();
    return std::move(solve_);
  }

private:
  void refuse_systems() const {
    if (orbit_.fictitious_time || orbit_.driven) {
      throw ProblemError(solve_.location, orbit_.driven
                                              ? "H names t, and boundary-value problems are for an H without t"
                                              : "boundary-value problems take no time_scale; leave it out");
    }
    const LagrangianName name = problem_.scheme.lagrangian;
    if (!orbit_.constraints.empty()) {
      refuse_constrained(name);
    } else if (name == LagrangianName::splitting || name == LagrangianName::trapezoid ||
               name == LagrangianName::lobatto) {
      throw ProblemError(problem_.scheme.lagrangian_location,
                         fmt::format("boundary-value problems are not available for {}; use gauss, midpoint{}",
                                     problem_.scheme.word(), orbit_.L ? "" : ", generating, forward or custom"));
    }
    if (orbit_.L) {
      static_cast<void>(make_hamiltonian(problem_));  // which refuses an L without a formula of H
    }
  }

  void refuse_constrained(LagrangianName name) const {
    if (name != LagrangianName::midpoint && (name != LagrangianName::splitting || orbit_.L)) {
      throw ProblemError(
          problem_.scheme.lagrangian_location,
          fmt::format("boundary-value problems with [constraints] are not available for {}; use midpoint{}",
                      problem_.scheme.word(),
                      orbit_.L ? ", or state the problem by [hamiltonian] for splitting" : " or splitting"));
    }
  }

  void read_ends() {
    const Entry& ends = section_.require("ends",
                                         "\"periodic\", \"symmetric\", \"connection\", or conditions such as "
                                         "{ q_0 = 0, q_1 = 1 }");
    solve_.ends_location = ends.value.location;
    if (ends.value.string() != nullptr) {
      solve_.ends = static_cast<Ends>(read_word(ends.value, "ends", ends_words));
    } else if (const Value::Table* table = ends.value.table()) {
      read_given_values(*table);
    } else if (const Value::Array* equations = ends.value.array()) {
      solve_.ends = Ends::conditions;
      for (const Value& equation : *equations) {
        read_equation(equation);
      }
    } else {
      wrong_type(ends.value, "ends", "a word, a table such as { q_0 = 0, q_1 = 1 }, or a list of equations");
    }
    if (solve_.ends == Ends::conditions && solve_.conditions.empty()) {
      throw ProblemError(solve_.ends_location, "ends has no condition");
    }
    if (solve_.ends == Ends::connection && !orbit_.constraints.empty()) {
      throw ProblemError(solve_.ends_location,
                         "a connection is by the linearised motion at its equilibria, which [constraints] do not have "
                         "in these coordinates; state the problem in coordinates that need no constraint");
    }
    take_part("jump", Ends::periodic, "ends = \"periodic\"",
              [&](const Entry& entry) { solve_.jump = read_numbers(entry, false); });
    take_part("from", Ends::connection, "ends = \"connection\"",
              [&](const Entry& entry) { solve_.from = read_numbers(entry, true); });
    take_part("to", Ends::connection, "ends = \"connection\"",
              [&](const Entry& entry) { solve_.to = read_numbers(entry, true); });
    take_part("mirror", Ends::symmetric, "ends = \"symmetric\"", [&](const Entry& entry) { read_mirror(entry); });
    if (solve_.ends == Ends::connection && (solve_.from.empty() || solve_.to.empty())) {
      throw ProblemError(solve_.ends_location,
                         "a connection needs from and to: the equilibria it leaves and comes to, as { q = 0, p = 0 }");
    }
    if (solve_.ends == Ends::symmetric && solve_.mirror.empty()) {
      throw ProblemError(solve_.ends_location,
                         "a symmetric orbit needs mirror: the names that change sign when the motion is reversed, as "
                         "[\"y\", \"px\"]");
    }
  }

  template <typename Read>
  void take_part(std::string_view key, Ends of, std::string_view purpose, const Read& read) {
    if (const Entry* entry = section_.take(key)) {
      if (solve_.ends != of) {
        throw ProblemError(entry->location, fmt::format("{} belongs to {}; leave it out", key, purpose));
      }
      read(*entry);
    }
  }

  /// { q = ..., p = ... }, all of them or some.
  std::vector<double> read_numbers(const Entry& entry, bool all) {
    const Value::Table* table = entry.value.table();
    if (table == nullptr) {
      wrong_type(entry.value, entry.key, "a table such as { q = 0, p = 0 }");
    }
    std::vector<double> numbers(names_.size(), 0.0);
    std::vector<bool> given(names_.size(), false);
    for (const Entry& one : *table) {
      const std::size_t place = place_of(one);
      numbers[place] = read_number(one.value, one.key, problem_.parameters);
      given[place] = true;
    }
    if (const auto missing = std::ranges::find(given, false); all && missing != given.end()) {
      throw ProblemError(entry.location, fmt::format("{} gives no value for {}", entry.key,
                                                     names_[static_cast<std::size_t>(missing - given.begin())]));
    }
    return numbers;
  }

  std::size_t place_of(const Entry& entry) const {
    const auto found = std::ranges::find(names_, entry.key);
    if (found == names_.end()) {
      throw ProblemError(entry.location, fmt::format("{} is no coordinate or momentum; these are {}", entry.key,
                                                     fmt::join(names_, ", ")));
    }
    return static_cast<std::size_t>(found - names_.begin());
  }

  void read_mirror(const Entry& entry) {
    for (const Value& value : read_array(entry.value, "mirror", "names")) {
      const std::string& name = read_string(value, "mirror");
      const auto found = std::ranges::find(names_, name);
      if (found == names_.end()) {
        throw ProblemError(value.location, fmt::format("mirror: {} is no coordinate or momentum; these are {}", name,
                                                       fmt::join(names_, ", ")));
      }
      solve_.mirror.push_back(static_cast<std::size_t>(found - names_.begin()));
    }
    const std::size_t n = names_.size() / 2;
    std::vector<int> of_pair(n, 0);
    for (const std::size_t place : solve_.mirror) {
      ++of_pair[place % n];
    }
    if (std::ranges::any_of(of_pair, [](int count) { return count != 1; })) {
      throw ProblemError(entry.value.location,
                         "mirror names one of each pair: a coordinate or its momentum changes sign when the motion is "
                         "reversed, not both");
    }
  }

  void read_given_values(const Value::Table& table) {
    solve_.ends = Ends::conditions;
    const std::vector<std::string> known = end_names(orbit_);
    for (const Entry& entry : table) {
      if (std::ranges::find(known, entry.key) == known.end()) {
        const auto guess = formula::nearest_name(entry.key, known);
        throw ProblemError(entry.location,
                           fmt::format("{} is no value at an end: the start has {}, and the end {}{}", entry.key,
                                       fmt::join(std::span(known).first(names_.size()), ", "),
                                       fmt::join(std::span(known).last(names_.size()), ", "),
                                       guess ? fmt::format("; did you mean {}?", *guess) : ""));
      }
      const double value = read_number(entry.value, entry.key, problem_.parameters);
      solve_.conditions.push_back({.left = {entry.key, entry.location},
                                   .right = FormulaText{fmt::format("{:.17g}", value), entry.value.location},
                                   .text = fmt::format("{} = {:.10g}", entry.key, value)});
    }
  }

  void read_equation(const Value& value) {
    const FormulaText text = read_formula(value, "an end condition");
    const std::size_t equals = text.text.find('=');
    StatedSolve::Condition condition{.left = {text.text.substr(0, equals), text.location}, .text = text.text};
    if (equals != std::string::npos) {
      const std::string rest = text.text.substr(equals + 1);
      if (rest.find('=') != std::string::npos) {
        throw ProblemError(text.location, "an end condition has one =");
      }
      condition.right = FormulaText{rest, place_in_file(text.location, 1, equals + 2)};
    }
    const std::vector<std::string> known = end_names(orbit_);
    check_formula(condition.left, {known}, problem_.parameters);
    if (condition.right) {
      check_formula(*condition.right, {known}, problem_.parameters);
    }
    solve_.conditions.push_back(std::move(condition));
  }

  void read_steps() {
    read_solve_steps(section_, problem_, solve_);
    constexpr std::size_t most = 1'000'000;
    if (solve_.steps > most) {
      throw ProblemError(solve_.location, fmt::format("the orbit has {} steps; at most {} can be solved for at once",
                                                      solve_.steps, most));
    }
    if (solve_.ends == Ends::symmetric) {
      solve_.steps += solve_.steps % 2;
    }
  }

  void read_guess() {
    StatedSolve::Start& start = solve_.starts.emplace_back();
    start.z = orbit_.initial.q;
    start.z.insert(start.z.end(), orbit_.initial.p.begin(), orbit_.initial.p.end());
    const Entry* entry = section_.take("guess");
    if (entry == nullptr) {
      return;
    }
    const Value::Table* table = entry->value.table();
    if (table == nullptr) {
      wrong_type(entry->value, "guess", "a table of formulas of t, such as { q = \"sin(t)\", p = \"cos(t)\" }");
    }
    start.formulas.resize(names_.size());
    read_formulas_of_t(*table, start.formulas);
    const auto missing = std::ranges::find(start.formulas, std::string(), &FormulaText::text);
    if (missing != start.formulas.end()) {
      throw ProblemError(entry->location,
                         fmt::format("guess gives no formula for {}; every coordinate and momentum needs one",
                                     names_[static_cast<std::size_t>(missing - start.formulas.begin())]));
    }
  }

  void read_formulas_of_t(const Value::Table& table, std::vector<FormulaText>& formulas) const {
    static const std::vector<std::string> arguments = {"t"};
    for (const Entry& one : table) {
      FormulaText& formula = formulas[place_of(one)];
      formula = read_formula(one.value, one.key);
      check_formula(formula, {arguments}, problem_.parameters);
    }
  }

  /// starts = [{ p = 1 }, ...]: what takes the place of entries of the first guess.
  void read_starts() {
    const Entry* entry = section_.take("starts");
    if (entry == nullptr) {
      return;
    }
    for (const Value& value : read_array(entry->value, "starts", "tables")) {
      const Value::Table* table = value.table();
      if (table == nullptr) {
        wrong_type(value, "an entry of starts", "a table such as { q = 0, p = 1 }");
      }
      StatedSolve::Start start = solve_.starts.front();
      if (start.formulas.empty()) {
        for (const Entry& one : *table) {
          start.z[place_of(one)] = read_number(one.value, one.key, problem_.parameters);
        }
      } else {
        read_formulas_of_t(*table, start.formulas);
      }
      solve_.starts.push_back(std::move(start));
    }
  }

  void read_continuation() {
    auto section = section_.take_section("continue");
    if (!section) {
      return;
    }
    using Kind = StatedSolve::Continuation::Kind;
    StatedSolve::Continuation continuation{.location = section->location()};
    const Entry& name = section->require("parameter", "energy, period or time, or the name of a parameter");
    continuation.parameter = read_string(name.value, "parameter");
    const std::string_view duration = solve_.closes() ? "period" : "time";
    if (problem_.parameters.find(continuation.parameter) != nullptr &&
        !problem_.parameters.find(continuation.parameter)->definition) {
      continuation.kind = Kind::parameter;
    } else if (continuation.parameter == "energy") {
      continuation.kind = Kind::energy;
    } else if (continuation.parameter == duration) {
      continuation.kind = Kind::duration;
    } else {
      throw ProblemError(name.value.location,
                         fmt::format("{} is not what a branch can go along: it is energy, {}, or a "
                                     "number of [parameters]",
                                     continuation.parameter, duration));
    }
    const Entry& to = section->require("to", "the value that the branch goes to");
    continuation.to = read_number(to.value, "to", problem_.parameters);
    if (const Entry* step = section->take("step")) {
      continuation.step = read_number(step->value, "step", problem_.parameters);
      if (*continuation.step == 0.0) {
        throw ProblemError(step->value.location, "step = 0: it is the change of the parameter in the first step");
      }
    }
    if (const Entry* points = section->take("points")) {
      continuation.most_points =
          static_cast<std::size_t>(read_integer(points->value, "points", problem_.parameters, 1));
    }
    section->finish();
    const bool both = solve_.duration && solve_.has_energy();
    if (continuation.kind != Kind::parameter && both) {
      throw ProblemError(
          continuation.location,
          fmt::format("both {} and an energy are given, and no branch goes through one solution: give one "
                      "of them",
                      duration));
    }
    solve_.continuation = continuation;
  }

  /// As many conditions as unknowns: for conditions, 2n at the ends, with one more for a free time without energy.
  void refuse_unknown_counts() const {
    const bool is_action =
        problem_.scheme.lagrangian == LagrangianName::forward || problem_.scheme.lagrangian == LagrangianName::custom;
    if (is_action && solve_.ends != Ends::conditions) {
      throw ProblemError(solve_.ends_location,
                         fmt::format("lagrangian = \"{}\" takes all coordinates and momenta at both ends, "
                                     "as {{ q_0 = ..., p_0 = ..., q_1 = ..., p_1 = ... }}",
                                     problem_.scheme.word()));
    }
    if (solve_.ends != Ends::conditions) {
      return;
    }
    const std::size_t implied = 2 * orbit_.constraints.size();  // by the constraints and their rates
    const std::size_t wanted = (is_action ? 2 : 1) * names_.size() - implied +
                               (solve_.duration || solve_.has_energy() ? 0 : 1) -
                               (solve_.duration && solve_.has_energy() ? 1 : 0);
    if (solve_.conditions.size() < wanted || solve_.conditions.size() > wanted + implied) {
      throw ProblemError(
          solve_.ends_location,
          fmt::format(
              "ends has {} condition{}, and {} {} needed: {} for {} coordinates and momenta{}{}",
              solve_.conditions.size(), solve_.conditions.size() == 1 ? "" : "s", wanted, wanted == 1 ? "is" : "are",
              is_action ? "two each" : "one each", names_.size(), implied == 0 ? "" : ", less two for each constraint",
              solve_.duration && solve_.has_energy()   ? ", less one since both time and energy are given"
              : solve_.duration || solve_.has_energy() ? ""
                                                       : ", and one more since neither time nor energy is given"));
    }
  }

  Section& section_;
  const Problem& problem_;
  const HamiltonianProblem& orbit_;
  std::vector<std::string> names_;
  StatedSolve solve_;
};

}  // namespace

std::shared_ptr<const StatedSolve> read_solve(Section& root, const Problem& problem) {
  auto section = root.take_section("solve");
  if (!section) {
    return nullptr;
  }
  if (problem.hamiltonian() == nullptr) {
    return std::make_shared<const StatedSolve>(read_lattice_solve(*section, problem));
  }
  return std::make_shared<const StatedSolve>(SolveReader(*section, problem).read());
}

namespace {

/// The equations that `ends` stands for, as formulas of NAME_0 and NAME_1 that vanish; not of a connection.
void build_conditions(const Problem& problem, formula::Graph& graph, std::vector<formula::Expression>& values,
                      std::vector<std::string>& texts) {
  const StatedSolve& solve = *problem.solve;
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  const std::vector<std::string> names = orbit.names(), known = end_names(orbit);
  const auto add = [&](formula::Expression value, std::string text) {
    values.push_back(value);
    texts.push_back(std::move(text));
  };
  for (std::size_t i = 0; i < names.size() && solve.ends == Ends::periodic; ++i) {
    const double rise = solve.jump.empty() ? 0.0 : solve.jump[i];
    add(graph.variable(names[i] + "_1") - graph.variable(names[i] + "_0") - rise,
        fmt::format("{0}_1 = {0}_0{1}", names[i], rise == 0.0 ? "" : fmt::format(" + {:.10g}", rise)));
  }
  for (const std::size_t place : solve.mirror) {
    for (const char* suffix : {"_0", "_1"}) {
      add(graph.variable(names[place] + suffix), fmt::format("{}{} = 0", names[place], suffix));
    }
  }
  for (const StatedSolve::Condition& condition : solve.conditions) {
    formula::Expression value = problem.build(condition.left, graph, known);
    if (condition.right) {
      value = value - problem.build(*condition.right, graph, known);
    }
    add(value, condition.text);
  }
}

/// \throws ProblemError where a jump of an orbit that closes changes H
void check_jump(const Problem& problem) {
  const StatedSolve& solve = *problem.solve;
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  const std::vector<std::string> names = orbit.names();
  const ImageOfVariable image = [&](const std::string& name, const ValueOfVariable& value) {
    const auto at = std::ranges::find(names, name);
    return value(name) + (at == names.end() ? 0.0 : solve.jump[static_cast<std::size_t>(at - names.begin())]);
  };
  formula::Graph graph;
  if (solve.jump.empty()) {
    return;
  }
  if (const auto broken = find_broken_term(problem.build(orbit.statement(), graph, orbit.formula_names()), image)) {
    throw ProblemError(solve.ends_location,
                       fmt::format("{} has to be the same at both ends, and jump changes its term {} (from {:.6g} to "
                                   "{:.6g} at some place). Give a jump that leaves it as it is, or leave jump out",
                                   orbit.L ? "L" : "H", broken->term, broken->before, broken->after));
  }
}

/// \throws ProblemError where a number of the problem, other than the guess, follows from the parameter
void refuse_dependants(const Problem& problem, const std::string& parameter) {
  const Parameter& own = *problem.parameters.find(parameter);
  const double moved_to = own.value + 1e-3 * (1.0 + std::abs(own.value));
  const std::vector<std::string> settings = {fmt::format("parameters.{}={:.17g}", parameter, moved_to),
                                             "-solve.continue"};
  const Problem moved = parse_problem(problem.text, problem.source, settings);
  const auto refuse = [&](std::string_view what) {
    throw ProblemError(problem.solve->continuation->location,
                       fmt::format("{0} follows from {1}, and would not change along the branch: write it as a formula "
                                   "of {1} in [definitions], or as a number",
                                   what, parameter));
  };
  for (const Parameter& other : problem.parameters) {
    const Parameter* const then = moved.parameters.find(other.name);
    if (other.name != parameter && !other.definition && (then == nullptr || then->value != other.value)) {
      refuse(other.name);
    }
  }
  const StatedSolve &here = *problem.solve, &there = *moved.solve;
  if (here.energy != there.energy || here.duration != there.duration || here.jump != there.jump) {
    refuse("a number of [solve]");
  }
  formula::Graph graph, other_graph;
  std::vector<formula::Expression> values, others;
  std::vector<std::string> texts;
  build_conditions(problem, graph, values, texts);
  build_conditions(moved, other_graph, others, texts);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (to_string(values[i]) != to_string(others[i])) {
      refuse("the condition " + texts[i]);
    }
  }
}

}  // namespace

EndConditions make_end_conditions(const Problem& problem, const Hamiltonian& hamiltonian) {
  const StatedSolve& solve = *problem.solve;
  if (solve.ends == Ends::connection) {
    try {
      return EndConditions::connection(hamiltonian, solve.from, solve.to);
    } catch (const std::invalid_argument& error) {
      throw ProblemError(solve.ends_location, error.what());
    }
  }
  check_jump(problem);
  auto graph = std::make_shared<formula::Graph>();
  std::vector<formula::Expression> variables, values;
  std::vector<std::string> texts;
  for (const std::string& name : end_names(*problem.hamiltonian())) {
    variables.push_back(graph->variable(name));
  }
  build_conditions(problem, *graph, values, texts);
  return {graph, std::move(variables), std::move(values), std::move(texts)};
}

Hamiltonian make_hamiltonian_beside(const Problem& problem, const std::string& parameter) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  auto graph = std::make_shared<formula::Graph>();
  std::vector<std::string> q = orbit.q, p = orbit.p;
  q.push_back(parameter);
  p.push_back(parameter + "_momentum");
  const formula::Expression H = build_hamiltonian(problem, *graph, std::array{parameter});
  return Hamiltonian(graph, q, p, H).constrained(make_constraints(problem, q));
}

EndConditions make_end_conditions_beside(const Problem& problem, const std::string& parameter,
                                         const Hamiltonian& hamiltonian, std::optional<double> held) {
  if (problem.solve->ends == Ends::connection) {
    throw ProblemError(problem.solve->continuation->location,
                       "the equilibria of a connection would have to move with the parameter: solve for single values");
  }
  refuse_dependants(problem, parameter);
  auto graph = std::make_shared<formula::Graph>();
  std::vector<formula::Expression> variables, values;
  std::vector<std::string> texts;
  for (const char* suffix : {"_0", "_1"}) {
    for (const auto* names : {&hamiltonian.q_names(), &hamiltonian.p_names()}) {
      for (const std::string& name : *names) {
        variables.push_back(graph->variable(name + suffix));
      }
    }
  }
  build_conditions(problem, *graph, values, texts);
  values.push_back(graph->variable(hamiltonian.p_names().back() + "_0"));
  texts.push_back(fmt::format("{}_0 = 0", hamiltonian.p_names().back()));
  if (held) {
    values.push_back(graph->variable(parameter + "_0") - *held);
    texts.push_back(fmt::format("{}_0 = {:.10g}", parameter, *held));
  }
  return {graph, std::move(variables), std::move(values), std::move(texts)};
}

}  // namespace rubato
