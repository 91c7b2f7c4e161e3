#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/study/reader.hpp>

namespace rubato::study {

namespace {

/// The longest list of times and quantities: each of them is looked at in every step.
constexpr std::size_t most_times = 10'000'000;

class OutputReader {
public:
  explicit OutputReader(Problem& problem) : problem_(problem), output_(problem.output) {}

  void read(Section& section) {
    output_.location = section.location();
    if (const Entry* states = section.take("states")) {
      output_.states = read_boolean(states->value, "states");
    }
    const Entry* times = section.take("times");
    const Entry* interval = section.take("interval");
    if (times != nullptr && interval != nullptr) {
      throw ProblemError(interval->location, "output.times and output.interval say the same; leave one of them out");
    }
    if (times != nullptr) {
      read_times(times->value);
    }
    if (interval != nullptr) {
      read_interval(interval->value);
    }
    if (auto quantities = section.take_section("quantities")) {
      read_quantities(*quantities);
    }
  }

private:
  [[nodiscard]] double direction() const { return problem_.scheme.until < problem_.start() ? -1.0 : 1.0; }

  void read_times(const Value& value) {
    const Value::Array& list = read_array(value, "times", "numbers");
    if (list.empty()) {
      throw ProblemError(value.location, "times = []: there is no time in it; leave it out");
    }
    if (list.size() > most_times) {
      throw ProblemError(value.location,
                         fmt::format("times has {} entries, and may have {}; use interval", list.size(), most_times));
    }
    const double start = problem_.start(), until = problem_.scheme.until;
    for (const Value& item : list) {
      const double t = read_number(item, "times", problem_.parameters);
      if (direction() * (t - start) < 0.0 || direction() * (t - until) > 0.0) {
        throw ProblemError(item.location, fmt::format("times: {} is outside the run, which goes from t = {} to until = "
                                                      "{}",
                                                      t, start, until));
      }
      if (!output_.times.empty() && !(direction() * (t - output_.times.back()) > 0.0)) {
        throw ProblemError(item.location, fmt::format("times: {} comes after {}; give them in the direction of the "
                                                      "run, each once",
                                                      t, output_.times.back()));
      }
      output_.times.push_back(t);
    }
  }

  void read_interval(const Value& value) {
    const double interval = read_number(value, "interval", problem_.parameters);
    const double start = problem_.start(), until = problem_.scheme.until;
    if (!(interval > 0.0)) {
      throw ProblemError(
          value.location,
          fmt::format("interval = {}: it has to be positive, in whichever direction the run goes", interval));
    }
    for (const double t : {start, until}) {
      if (t + interval == t || t - interval == t) {
        throw ProblemError(value.location, fmt::format("interval = {} is lost in rounding beside t = {}", interval, t));
      }
    }
    output_.interval = interval;
  }

  void read_quantities(const Section& section) {
    // Under /output/quantities, with what its axes are called.
    static constexpr std::array<std::string_view, 4> names_in_record = {"t", "x", "y", "z"};
    for (const Entry& entry : section.entries()) {
      if (!is_identifier(entry.key)) {
        refuse_name(entry, "a quantity", malformed_name);
      }
      if (std::ranges::find(names_in_record, entry.key) != names_in_record.end()) {
        refuse_name(entry, "a quantity", name_of_record);
      }
      OutputQuantity quantity{.name = entry.key, .formula = {}, .at = {}, .location = entry.location};
      if (entry.value.table() != nullptr) {
        read_at_point(entry, quantity);
      } else {
        quantity.formula = read_formula(entry.value, entry.key);
      }
      check(quantity);
      output_.quantities.push_back(std::move(quantity));
    }
    // The order of a record's own problem is another: tables come last there.
    std::ranges::sort(output_.quantities, {}, &OutputQuantity::name);
    if (output_.quantities.empty()) {
      throw ProblemError(section.location(), "[output.quantities] names no quantity; leave it out");
    }
  }

  /// { formula = "u", at = { x = 3.5 } }
  void read_at_point(const Entry& entry, OutputQuantity& quantity) const {
    for (const Entry& inner : *entry.value.table()) {
      if (inner.key != "formula" && inner.key != "at") {
        throw ProblemError(inner.location,
                           fmt::format("unknown key {} in output.quantities.{}; known here: formula, at",
                                       inner.key.substr(0, 100), entry.key));
      }
    }
    const Entry* formula = find(*entry.value.table(), "formula");
    const Entry* at = find(*entry.value.table(), "at");
    if (formula == nullptr) {
      throw ProblemError(entry.location, fmt::format("output.quantities.{} needs formula: what it is", entry.key));
    }
    quantity.formula = read_formula(formula->value, "formula");
    if (at == nullptr) {
      return;
    }
    const MultisymplecticProblem* pde = problem_.multisymplectic();
    if (pde == nullptr) {
      throw ProblemError(at->location, "at: an orbit has no points to look at; leave it out");
    }
    if (at->value.table() == nullptr) {
      wrong_type(at->value, "at", "a table such as { x = 3.5 }");
    }
    const auto axes = pde->axis_names();
    for (const Entry& inner : *at->value.table()) {
      if (std::ranges::find(axes, inner.key) == axes.end()) {
        throw ProblemError(inner.location, fmt::format("at: unknown direction {}; the grid has {}",
                                                       inner.key.substr(0, 100), fmt::join(axes, ", ")));
      }
    }
    quantity.at.emplace();
    for (const GridAxis& axis : pde->axes) {
      const Entry* coordinate = find(*at->value.table(), axis.name);
      if (coordinate == nullptr) {
        throw ProblemError(at->location,
                           fmt::format("at: {} is missing; give every coordinate of the point", axis.name));
      }
      const double x = read_number(coordinate->value, axis.name, problem_.parameters);
      if (!(x >= axis.from && x <= axis.to)) {
        throw ProblemError(coordinate->value.location, fmt::format("at: {} = {} is outside the grid, from {} to {}",
                                                                   axis.name, x, axis.from, axis.to));
      }
      quantity.at->push_back(x);
    }
  }

  void check(const OutputQuantity& quantity) const {
    formula::Graph graph;
    if (const HamiltonianProblem* ode = problem_.hamiltonian()) {
      static_cast<void>(problem_.build(quantity.formula, graph, quantity_names(*ode, problem_.parameters)));
      return;
    }
    const MultisymplecticProblem& pde = *problem_.multisymplectic();
    std::vector<formula::Expression> integrands;
    static_cast<void>(problem_.build_quantity(quantity.formula, graph, quantity_names(pde), pde.fields, integrands));
  }

  Problem& problem_;
  Output& output_;
};

}  // namespace

std::vector<std::string> quantity_names(const HamiltonianProblem& ode, std::span<const Parameter> parameters) {
  std::vector<std::string> names = ode.formula_names();
  if (std::ranges::find(parameters, "t", &Parameter::name) == parameters.end()) {
    names.emplace_back("t");
  }
  return names;
}

std::vector<std::string> quantity_names(const MultisymplecticProblem& pde) {
  std::vector<std::string> names = pde.fields;
  std::ranges::copy(argument_names(pde), std::back_inserter(names));
  return names;
}

std::vector<std::string> argument_names(const MultisymplecticProblem& pde) {
  std::vector<std::string> names = pde.axis_names();
  names.emplace_back("t");
  return names;
}

void read_output_times(Section& section, Problem& problem) {
  OutputReader(problem).read(section);
}

}  // namespace rubato::study
