#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/problem/reader.hpp>

namespace rubato {

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
    // With time_scale nothing shows the physical time of the end.
    const double start = problem_.clock_start(), until = problem_.clock()
                                                             ? direction() * std::numeric_limits<double>::infinity()
                                                             : problem_.scheme.until;
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
    constexpr double most_in_a_step = 1e6;
    if (const double step = std::abs(problem_.scheme.step.value_or(0.0)); step > most_in_a_step * interval) {
      throw ProblemError(value.location,
                         fmt::format("interval = {} would be {:.1e} output times in the first step, and there may be a "
                                     "million in each",
                                     interval, step / interval));
    }
    output_.interval = interval;
  }

  void read_quantities(const Section& section) {
    // Under /output/quantities, with what its axes are called.
    const MultisymplecticProblem* const pde = problem_.multisymplectic();
    const std::vector<std::string> names_in_record =
        pde != nullptr ? argument_names(*pde) : std::vector<std::string>{"t"};
    for (const Entry& entry : section.entries()) {
      if (!is_identifier(entry.key)) {
        refuse_name(entry, "a quantity", malformed_name);
      }
      if (std::ranges::find(names_in_record, entry.key) != names_in_record.end()) {
        refuse_name(entry, "a quantity", name_of_record);
      }
      OutputQuantity quantity = read_quantity(entry.value, "output.quantities." + entry.key, problem_);
      quantity.name = entry.key;
      quantity.location = entry.location;
      output_.quantities.push_back(std::move(quantity));
    }
    // The order of a record's own problem is another: tables come last there.
    std::ranges::sort(output_.quantities, {}, &OutputQuantity::name);
    if (output_.quantities.empty()) {
      throw ProblemError(section.location(), "[output.quantities] names no quantity; leave it out");
    }
  }

  Problem& problem_;
  Output& output_;
};

void check_quantity(const OutputQuantity& quantity, const Problem& problem) {
  formula::Graph graph;
  if (const HamiltonianProblem* ode = problem.hamiltonian()) {
    static_cast<void>(problem.build(quantity.formula, graph, quantity_names(*ode, problem.parameters)));
    return;
  }
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  std::vector<formula::Expression> integrands;
  static_cast<void>(problem.build_quantity(quantity.formula, graph, quantity_names(pde), pde.fields, integrands));
}

}  // namespace

OutputQuantity read_quantity(const Value& value, std::string_view what, const Problem& problem) {
  OutputQuantity quantity{.name = {}, .formula = {}, .at = {}, .location = value.location};
  if (value.table() == nullptr) {
    quantity.formula = read_formula(value, what);
  } else {
    for (const Entry& inner : *value.table()) {
      if (inner.key != "formula" && inner.key != "at") {
        throw ProblemError(inner.location, fmt::format("unknown key {} in {}; known here: formula, at",
                                                       inner.key.substr(0, 100), what));
      }
    }
    const Entry* formula = find(*value.table(), "formula");
    const Entry* at = find(*value.table(), "at");
    if (formula == nullptr) {
      throw ProblemError(value.location, fmt::format("{} needs formula: what it is", what));
    }
    quantity.formula = read_formula(formula->value, "formula");
    if (at != nullptr) {
      quantity.at = read_point_of_grid(*at, problem);
    }
  }
  check_quantity(quantity, problem);
  return quantity;
}

std::vector<double> read_point_of_grid(const Entry& at, const Problem& problem) {
  const MultisymplecticProblem* pde = problem.multisymplectic();
  if (pde == nullptr) {
    throw ProblemError(at.location, "at: an orbit has no points to look at; leave it out");
  }
  if (at.value.table() == nullptr) {
    wrong_type(at.value, "at", "a table such as { x = 3.5 }");
  }
  const auto axes = pde->axis_names();
  for (const Entry& inner : *at.value.table()) {
    if (std::ranges::find(axes, inner.key) == axes.end()) {
      throw ProblemError(inner.location, fmt::format("at: unknown direction {}; the grid has {}",
                                                     inner.key.substr(0, 100), fmt::join(axes, ", ")));
    }
  }
  std::vector<double> point;
  for (const GridAxis& axis : pde->axes) {
    const Entry* coordinate = find(*at.value.table(), axis.name);
    if (coordinate == nullptr) {
      throw ProblemError(at.location, fmt::format("at: {} is missing; give every coordinate of the point", axis.name));
    }
    const double x = read_number(coordinate->value, axis.name, problem.parameters);
    if (!(x >= axis.from && x <= axis.to)) {
      throw ProblemError(coordinate->value.location, fmt::format("at: {} = {} is outside the grid, from {} to {}",
                                                                 axis.name, x, axis.from, axis.to));
    }
    point.push_back(x);
  }
  return point;
}

std::vector<std::string> quantity_names(const HamiltonianProblem& ode, const Parameters& parameters) {
  std::vector<std::string> names = ode.formula_names();
  if (parameters.find("t") == nullptr) {
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

}  // namespace rubato
