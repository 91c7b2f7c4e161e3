#include <rubato/ode/end_conditions.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/spectrum.hpp>

namespace rubato {

namespace {

using formula::Expression;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

std::vector<std::string> names_of(const Hamiltonian& hamiltonian) {
  std::vector<std::string> names = hamiltonian.q_names();
  names.insert(names.end(), hamiltonian.p_names().begin(), hamiltonian.p_names().end());
  return names;
}

/// The variables z_0, z_N of a graph.
std::vector<Expression> end_variables(const Hamiltonian& hamiltonian, formula::Graph& graph) {
  std::vector<Expression> variables;
  for (const char* suffix : {"_0", "_1"}) {
    for (const std::string& name : names_of(hamiltonian)) {
      variables.push_back(graph.variable(name + suffix));
    }
  }
  return variables;
}

/// Rows l, real and orthonormal, with l·v = 0 for every v in the invariant subspace of the linearised motion A whose
/// eigenvalues have the sign `kept` in their real parts.
MatrixXd projection(const MatrixXd& A, double kept, std::span<const double> place) {
  const solve::Eigenvectors eigen = solve::eigenvectors(A.transpose());  // left ones
  const Index size = A.rows();
  const double scale = eigen.values.cwiseAbs().maxCoeff();
  MatrixXd rows(size / 2, size);
  Index count = 0;
  bool hyperbolic = scale > 0.0;
  for (Index i = 0; i < size; ++i) {
    const std::complex<double> value = eigen.values[i];
    hyperbolic = hyperbolic && std::abs(value.real()) > tuning::boundary_value::hyperbolic * scale;
    if (value.real() * kept > 0.0 || value.imag() < 0.0) {
      continue;  // kept, or the conjugate of one that was taken
    }
    for (const bool imaginary : {false, true}) {
      if (count < size / 2 && (!imaginary || value.imag() > 0.0)) {
        for (Index j = 0; j < size; ++j) {
          rows(count, j) = imaginary ? eigen.vectors(j, i).imag() : eigen.vectors(j, i).real();
        }
        ++count;
      }
    }
  }
  if (!hyperbolic || count != size / 2) {
    std::vector<std::string> values;
    for (const std::complex<double>& value : eigen.values) {
      values.push_back(fmt::format("{:.4g}{:+.4g}i", value.real(), value.imag()));
    }
    throw std::invalid_argument(
        fmt::format("a connection needs equilibria whose linearised motion has no eigenvalue on the imaginary axis; at "
                    "({}) the eigenvalues are {}",
                    fmt::join(place, ", "), fmt::join(values, ", ")));
  }
  for (Index i = 0; i < count; ++i) {
    for (Index j = 0; j < i; ++j) {
      rows.row(i) -= rows.row(i).dot(rows.row(j)) * rows.row(j);
    }
    rows.row(i).normalize();
  }
  return rows;
}

}  // namespace

EndConditions::EndConditions(std::shared_ptr<formula::Graph> graph, std::vector<Expression> variables,
                             std::vector<Expression> values, std::vector<std::string> texts)
    : graph_(std::move(graph)), variables_(std::move(variables)), values_(std::move(values)), texts_(std::move(texts)) {
  compile();
}

EndConditions::EndConditions(const Hamiltonian& hamiltonian, std::span<const std::string> equations,
                             const Hamiltonian::Parameters& parameters)
    : graph_(std::make_shared<formula::Graph>()),
      variables_(end_variables(hamiltonian, *graph_)),
      texts_(equations.begin(), equations.end()) {
  std::vector<std::string> names;
  for (const Expression variable : variables_) {
    names.push_back(graph_->variable_name(variables_of(variable).front()));
  }
  const formula::ParseContext context{
      .resolve = [&](std::string_view name) -> std::optional<Expression> {
        if (const auto found = parameters.find(std::string(name)); found != parameters.end()) {
          return graph_->constant(found->second);
        }
        return std::ranges::find(names, name) == names.end() ? std::nullopt : std::optional(graph_->variable(name));
      },
      .known_names = names};
  for (const std::string& equation : equations) {
    const std::size_t equals = equation.find('=');
    if (equals != std::string::npos && equation.find('=', equals + 1) != std::string::npos) {
      throw std::invalid_argument(fmt::format("an end condition has one =: {}", equation));
    }
    Expression value = formula::parse(std::string_view(equation).substr(0, equals), *graph_, context);
    if (equals != std::string::npos) {
      value = value - formula::parse(std::string_view(equation).substr(equals + 1), *graph_, context);
    }
    values_.push_back(value);
  }
  compile();
}

EndConditions EndConditions::with_constraints(const Hamiltonian& hamiltonian) const {
  const Constraints& constraints = hamiltonian.constraints();
  if (constraints.none()) {
    return *this;
  }
  auto graph = std::make_shared<formula::Graph>();
  std::vector<Expression> variables;
  for (const Expression variable : variables_) {
    variables.push_back(graph->variable(graph_->variable_name(variables_of(variable).front())));
  }
  const Hamiltonian own = hamiltonian.with_own_graph();
  const std::size_t n = own.degrees_of_freedom();
  const auto z = std::span<const Expression>(variables).first(2 * n), q = z.first(n);
  const auto p = std::span<const Expression>(own.variables()).last(n);
  const std::vector<Expression> g = formula::substitute(constraints.values(), *graph, constraints.variables(), q),
                                velocity = formula::substitute(formula::gradient(own.expression(), p), *graph,
                                                               own.variables(), z);
  std::vector<Expression> values = formula::substitute(values_, *graph, variables_, variables);
  std::vector<std::string> texts = texts_;
  for (std::size_t i = 0; i < g.size(); ++i) {
    const std::vector<Expression> row = formula::gradient(g[i], q);
    Expression rate = graph->constant(0.0);
    for (std::size_t a = 0; a < n; ++a) {
      rate = rate + row[a] * velocity[a];
    }
    values.insert(values.end(), {g[i], rate});
    texts.push_back(fmt::format("{} = 0 at the start", constraints.names()[i]));
    texts.push_back(fmt::format("{}_dot = 0 at the start", constraints.names()[i]));
  }
  return {std::move(graph), std::move(variables), std::move(values), std::move(texts)};
}

void EndConditions::compile() {
  const std::vector<Expression>& values = values_;
  if (values.empty()) {
    throw std::invalid_argument("there are no end conditions");
  }
  std::vector<Expression> outputs(values.begin(), values.end());
  for (const Expression value : values) {
    const std::vector<Expression> row = formula::gradient(value, variables_);
    outputs.insert(outputs.end(), row.begin(), row.end());
  }
  evaluator_ = std::make_shared<formula::ScalarEvaluator>(formula::Bytecode(outputs, variables_));
}

EndConditions EndConditions::periodic(const Hamiltonian& hamiltonian, std::span<const double> jump) {
  auto graph = std::make_shared<formula::Graph>();
  std::vector<Expression> variables = end_variables(hamiltonian, *graph), values;
  const std::vector<std::string> names = names_of(hamiltonian);
  if (!jump.empty() && jump.size() != names.size()) {
    throw std::invalid_argument(
        fmt::format("a jump has {} entries, one for each coordinate and momentum; got {}", names.size(), jump.size()));
  }
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double rise = jump.empty() ? 0.0 : jump[i];
    values.push_back(variables[names.size() + i] - variables[i] - graph->constant(rise));
    texts.push_back(rise == 0.0 ? fmt::format("{0}_1 = {0}_0", names[i])
                                : fmt::format("{0}_1 = {0}_0 + {1:.10g}", names[i], rise));
  }
  return {graph, std::move(variables), std::move(values), std::move(texts)};
}

EndConditions EndConditions::connection(const Hamiltonian& hamiltonian, std::span<const double> from,
                                        std::span<const double> to) {
  auto graph = std::make_shared<formula::Graph>();
  std::vector<Expression> variables = end_variables(hamiltonian, *graph), values;
  const std::vector<std::string> names = names_of(hamiltonian);
  const std::size_t size = names.size();
  HamiltonianEvaluator evaluator(hamiltonian);
  std::vector<std::string> texts;
  for (const bool start : {true, false}) {
    const std::span<const double> place = start ? from : to;
    if (place.size() != size) {
      throw std::invalid_argument(fmt::format("an equilibrium has {} numbers; got {}", size, place.size()));
    }
    const auto rows = static_cast<Index>(size);
    VectorXd gradient(rows);
    MatrixXd hessian(rows, rows);
    evaluator.hessian(place.data(), gradient.data(), hessian.data());
    if (!hessian.allFinite() || !(gradient.norm() <= tuning::boundary_value::at_rest * (1.0 + hessian.norm()))) {
      throw std::invalid_argument(fmt::format("({}) is no equilibrium: the gradient of H is ({}) there",
                                              fmt::join(place, ", "), fmt::join(as_span(gradient), ", ")));
    }
    MatrixXd A(rows, rows);
    A << hessian.bottomRows(rows / 2), -hessian.topRows(rows / 2);
    const MatrixXd left = projection(A, start ? 1.0 : -1.0, place);
    for (Index i = 0; i < left.rows(); ++i) {
      Expression sum = graph->constant(0.0);
      for (std::size_t j = 0; j < size; ++j) {
        sum += left(i, static_cast<Index>(j)) * (variables[(start ? 0 : size) + j] - place[j]);
      }
      values.push_back(sum);
      texts.push_back(start ? fmt::format("the start lies in the unstable subspace of ({})", fmt::join(place, ", "))
                            : fmt::format("the end lies in the stable subspace of ({})", fmt::join(place, ", ")));
    }
  }
  return {graph, std::move(variables), std::move(values), std::move(texts)};
}

void EndConditions::evaluate(std::span<const double> z_0, std::span<const double> z_N, VectorXd& values, MatrixXd& by_0,
                             MatrixXd& by_N) {
  const std::span<double> inputs = evaluator_->inputs();
  std::ranges::copy(z_N, std::ranges::copy(z_0, inputs.begin()).out);
  evaluator_->run();
  const std::size_t count = texts_.size(), size = z_0.size();
  values.resize(static_cast<Index>(count));
  by_0.resize(static_cast<Index>(count), static_cast<Index>(size));
  by_N.resize(static_cast<Index>(count), static_cast<Index>(size));
  for (std::size_t i = 0; i < count; ++i) {
    const auto row = static_cast<Index>(i);
    values[row] = evaluator_->output(i);
    for (std::size_t j = 0; j < size; ++j) {
      by_0(row, static_cast<Index>(j)) = evaluator_->output(count + 2 * i * size + j);
      by_N(row, static_cast<Index>(j)) = evaluator_->output(count + (2 * i + 1) * size + j);
    }
  }
}

}  // namespace rubato
