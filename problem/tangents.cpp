#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

std::size_t read_vectors(const Value& value, std::string_view what, std::size_t dimension,
                         const Parameters& parameters) {
  if (value.string() != nullptr && *value.string() == all_words[0]) {
    return dimension;
  }
  if (const auto* word = value.string(); word != nullptr && is_identifier(*word) && parameters.find(*word) == nullptr) {
    throw ProblemError(value.location,
                       fmt::format("{} = \"{}\": it is a number of tangent vectors, or \"all\"", what, *word));
  }
  const std::int64_t number = read_integer(value, what, parameters, 0);
  if (number > static_cast<std::int64_t>(dimension)) {
    throw ProblemError(value.location,
                       fmt::format("{} = {}: a phase space of dimension {} has no more than {} tangent vectors; write "
                                   "{} = \"all\" for them",
                                   what, number, dimension, dimension, what));
  }
  return static_cast<std::size_t>(number);
}

/// Parameters that H names.
std::vector<std::string> read_sensitivities(const Value& value, const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  std::vector<std::string> names;
  for (const Value& one : read_array(value, "parameters", "names of [parameters]")) {
    const std::string& name = read_string(one, "an entry of parameters");
    const Parameter* const parameter = problem.parameters.find(name);
    if (parameter == nullptr || parameter->definition) {
      std::vector<std::string> known;
      for (const Parameter& each : problem.parameters) {
        if (!each.definition) {
          known.push_back(each.name);
        }
      }
      const auto nearest = formula::nearest_name(name, known);
      throw ProblemError(one.location,
                         fmt::format("{} is no entry of [parameters]{}", name,
                                     nearest         ? fmt::format("; did you mean {}?", *nearest)
                                     : known.empty() ? ": there are none"
                                                     : fmt::format("; those are {}", fmt::join(known, ", "))));
    }
    if (std::ranges::find(names, name) != names.end()) {
      throw ProblemError(one.location, fmt::format("{} stands here twice", name));
    }
    if (orbit.L || problem.hamiltonian()->next) {
      throw ProblemError(one.location,
                         fmt::format("derivatives with respect to parameters are those of a one-step map of H: {}",
                                     orbit.L ? "state the problem by [hamiltonian]" : "leave [initial.next] out"));
    }
    names.push_back(name);
  }
  return names;
}

}  // namespace

StatedTangents read_tangents(Section& scheme, const Problem& problem) {
  StatedTangents tangents;
  const Entry* const entry = find(scheme.entries(), "tangents");
  if (entry == nullptr) {
    return tangents;
  }
  const HamiltonianProblem* const orbit = problem.hamiltonian();
  if (orbit == nullptr) {
    throw ProblemError(entry->location,
                       "tangents is for orbits; two tangent solutions are carried along a lattice by rubato run "
                       "--tangents: leave it out");
  }
  tangents.location = entry->value.location;
  const std::size_t dimension = 2 * (orbit->q.size() - orbit->constraints.size());
  if (entry->value.table() == nullptr) {
    tangents.vectors = read_vectors(scheme.take("tangents")->value, "tangents", dimension, problem.parameters);
    return tangents;
  }
  std::optional<Section> section = scheme.take_section("tangents");
  if (const Entry* vectors = section->take("vectors")) {
    tangents.vectors = read_vectors(vectors->value, "vectors", dimension, problem.parameters);
  }
  if (const Entry* matrix = section->take("matrix")) {
    tangents.matrix = read_boolean(matrix->value, "matrix");
  }
  if (const Entry* parameters = section->take("parameters")) {
    tangents.parameters = read_sensitivities(parameters->value, problem);
  }
  section->finish();
  return tangents;
}

}  // namespace rubato
