#include <rubato/run/tangent_writer.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/ode/orbit_tangent.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/orbit_levels.hpp>

namespace rubato {

namespace {

std::unique_ptr<OrbitTangent> tangent_of(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  if (orbit.L) {
    return make_orbit_tangent(make_velocities(problem));
  }
  return make_orbit_tangent(make_hamiltonian(problem), make_discretisation(problem), orbit.next.has_value(),
                            start_of(orbit));
}

Sensitivities sensitivities_of(const Problem& problem) {
  const std::vector<std::string>& names = problem.scheme.tangents.parameters;
  if (problem.scheme.darboux == DarbouxKind::matrix) {
    throw std::invalid_argument(
        "derivatives by parameters need more coordinates than a Darboux matrix of the problem has: use darboux = "
        "\"midpoint\"");
  }
  if (!method_of(make_discretisation(problem)).scheme) {
    throw std::invalid_argument(
        "derivatives by parameters are those of a one-step map: use lagrangian = \"gauss\" or \"midpoint\"");
  }
  std::vector<double> values;
  for (const std::string& name : names) {
    values.push_back(problem.parameters.find(name)->value);
  }
  return {[&](bool as_momenta) { return make_hamiltonian(problem, names, as_momenta); }, make_discretisation(problem),
          start_of(*problem.hamiltonian()), std::move(values)};
}

}  // namespace

TangentWriter::TangentWriter(const Problem& problem) : problem_(problem) {
  const StatedTangents& tangents = problem.scheme.tangents;
  try {
    if (tangents.vectors > 0 || tangents.matrix) {
      vectors_.emplace(tangent_of(problem), 2 * problem.hamiltonian()->q.size(), tangents.vectors, tangents.matrix);
    }
    if (!tangents.parameters.empty()) {
      sensitivities_.emplace(sensitivities_of(problem));
    }
  } catch (const std::invalid_argument& error) {
    throw ProblemError(tangents.location, error.what());
  }
}

std::vector<std::string> TangentWriter::names() const {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < problem_.scheme.tangents.vectors; ++i) {
    names.push_back(fmt::format("{}", i + 1));
  }
  return names;
}

void TangentWriter::describe(record::Layout& layout) {
  using record::Type;
  const StatedTangents& tangents = problem_.scheme.tangents;
  constexpr auto steps = "/levels/step", states = "/states/t";
  for (const std::string& name : names()) {
    growth_.push_back(layout.add({figures::growth_path(name),
                                  steps,
                                  {},
                                  Type::f64,
                                  fmt::format("ln of the growth of tangent vector {} in the step, ln r_ii of QR", name),
                                  true}));
  }
  if (tangents.vectors > 1) {
    defect_ = layout.add({std::string(figures::two_form_path),
                          steps,
                          {},
                          Type::f64,
                          "defect of dp^dq of the tangent vectors in the step, in units of their lengths",
                          true});
  }
  const std::vector<std::string> components = problem_.hamiltonian()->names();
  constexpr auto component = "/tangents/component", by = "/tangents/by", parameter = "/tangents/parameter";
  if (tangents.matrix || sensitivities_) {
    layout.scales.push_back({component, components, "coordinates and momenta that are differentiated"});
  }
  if (tangents.matrix) {
    layout.scales.push_back({by, components, "coordinates and momenta of the start, with respect to which they are"});
    matrix_ = layout.add({"/tangents/matrix",
                          states,
                          {component, by},
                          Type::f64,
                          "derivative of the stored state by the first, by the tangents of the steps",
                          true});
  }
  if (sensitivities_) {
    layout.scales.push_back({parameter, tangents.parameters, "names of the parameters"});
    derivatives_ = layout.add({"/tangents/sensitivities",
                               states,
                               {parameter, component},
                               Type::f64,
                               "derivative of the stored state by parameters, start and levels held fixed",
                               true});
  }
}

void TangentWriter::take(const OutputStep& step) {
  ++steps_;
  // What fails leaves numbers that are undefined, and a sentence at the end of the run.
  if (vectors_) {
    static_cast<void>(vectors_->step(step.z_0, step.z_1, step.t_0, step.h));
  }
  if (sensitivities_) {
    static_cast<void>(sensitivities_->step(step.z_0, step.z_1, step.t_0, step.h));
  }
}

std::span<const double> TangentWriter::logarithms() const {
  return vectors_ ? vectors_->logarithms() : std::span<const double>();
}

double TangentWriter::defect() const {
  return vectors_ ? vectors_->defect() : 0.0;
}

void TangentWriter::append_step(RowSink& sink) const {
  for (std::size_t i = 0; i < growth_.size(); ++i) {
    sink.append(growth_[i], logarithms()[i]);
  }
  if (growth_.size() > 1) {
    sink.append(defect_, defect());
  }
}

void TangentWriter::add_to(figures::Statistics& statistics, const OutputStep& step) const {
  if (!growth_.empty()) {
    statistics.add_tangents(step.length(), logarithms(), defect());
  }
}

void TangentWriter::append_state(RowSink& sink) const {
  if (problem_.scheme.tangents.matrix) {
    sink.append(matrix_, vectors_->matrix());
  }
  if (sensitivities_) {
    sink.append(derivatives_, sensitivities_->derivatives());
  }
}

void TangentWriter::save(StateWriter& state) const {
  state.write(static_cast<double>(steps_));
  if (vectors_) {
    vectors_->save(state);
  }
  if (sensitivities_) {
    sensitivities_->save(state);
  }
}

void TangentWriter::restore(StateReader& state) {
  state.read(steps_);
  if (vectors_) {
    vectors_->restore(state);
  }
  if (sensitivities_) {
    sensitivities_->restore(state);
  }
}

std::unique_ptr<TangentWriter> make_tangents(const Problem& problem) {
  return problem.scheme.tangents.any() ? std::make_unique<TangentWriter>(problem) : nullptr;
}

}  // namespace rubato
