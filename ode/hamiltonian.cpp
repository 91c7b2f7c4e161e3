#include <rubato/ode/hamiltonian.hpp>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <span>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato {

Hamiltonian::Hamiltonian(std::vector<std::string> q, std::vector<std::string> p, std::string_view H,
                         const Parameters& parameters)
    : graph_(std::make_shared<formula::Graph>()), q_names_(std::move(q)), p_names_(std::move(p)) {
  std::vector<std::string> names = q_names_;
  names.insert(names.end(), p_names_.begin(), p_names_.end());
  for (const std::string& name : names) {
    if (!formula::is_valid_name(name)) {
      throw std::invalid_argument(fmt::format("'{}' cannot name a coordinate or momentum", name));
    }
    variables_.push_back(graph_->variable(name));
  }
  for (const auto& [name, value] : parameters) {
    names.push_back(name);
  }
  const formula::ParseContext context{
      .resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
        if (const auto found = parameters.find(std::string(name)); found != parameters.end()) {
          return graph_->constant(found->second);
        }
        const auto variable = std::ranges::find(names, name);
        return variable == names.end() ? std::nullopt : std::optional(graph_->variable(name));
      },
      .known_names = names};
  expression_ = formula::parse(H, *graph_, context);
  compile();
}

Hamiltonian::Hamiltonian(std::shared_ptr<formula::Graph> graph, std::vector<std::string> q, std::vector<std::string> p,
                         formula::Expression H)
    : graph_(std::move(graph)), q_names_(std::move(q)), p_names_(std::move(p)), expression_(H) {
  for (const auto* names : {&q_names_, &p_names_}) {
    for (const std::string& name : *names) {
      variables_.push_back(graph_->variable(name));
    }
  }
  compile();
}

std::vector<std::string> Hamiltonian::numbered(std::string_view stem, std::size_t n) {
  std::vector<std::string> names;
  for (std::size_t i = 1; i <= n; ++i) {
    names.push_back(fmt::format("{}{}", stem, i));
  }
  return names;
}

namespace {

using formula::Expression;

Expression gamma_of(std::span<const Expression> gradient, std::span<const formula::HessianEntry> entries) {
  const std::size_t dimension = gradient.size(), n = dimension / 2;
  std::vector<Expression> f;
  for (std::size_t i = 0; i < dimension; ++i) {
    f.push_back(i < n ? gradient[n + i] : -gradient[i - n]);
  }
  // Both triangles, the columns of each row in their order.
  std::vector<std::map<std::size_t, Expression>> rows(dimension);
  for (const auto& [row, column, entry] : entries) {
    rows[row].emplace(column, entry);
    rows[column].emplace(row, entry);
  }
  std::vector<Expression> sums;
  for (std::size_t i = 0; i < dimension; ++i) {
    std::vector<Expression> terms;
    for (const auto& [column, entry] : rows[i]) {
      terms.push_back(entry * f[column]);
    }
    if (!terms.empty()) {
      sums.push_back(f[i] * formula::folded_sum(std::move(terms)));
    }
  }
  return sums.empty() ? gradient.front().graph()->constant(0.0) : formula::folded_sum(std::move(sums));
}

}  // namespace

void Hamiltonian::compile() {
  if (q_names_.empty() || q_names_.size() != p_names_.size()) {
    throw std::invalid_argument(fmt::format(
        "a Hamiltonian needs as many momenta as coordinates, at least one: got {} coordinates [{}] and {} momenta [{}]",
        q_names_.size(), fmt::join(q_names_, ", "), p_names_.size(), fmt::join(p_names_, ", ")));
  }
  std::set<std::string_view> seen;
  for (const auto* names : {&q_names_, &p_names_}) {
    for (const std::string& name : *names) {
      if (!seen.insert(name).second) {
        throw std::invalid_argument(fmt::format("'{}' is used twice among the coordinates and momenta", name));
      }
    }
  }
  const formula::WithoutConstant separated = formula::separate_constant(expression_);
  if (separated.constant != 0.0) {
    constant_ = separated.constant;
    reduced_ = std::make_shared<Hamiltonian>(graph_, q_names_, p_names_, separated.rest);
  }
  size_ = std::make_shared<formula::Bytecode>(formula::sum_size_code(expression_, variables_));
  std::vector<formula::Expression> outputs{expression_};
  value_ = std::make_shared<formula::Bytecode>(outputs, variables_);
  std::ranges::copy(formula::gradient(expression_, variables_), std::back_inserter(outputs));
  gradient_ = std::make_shared<formula::Bytecode>(outputs, variables_);
  const std::vector<formula::HessianEntry> entries = formula::hessian_entries(expression_, variables_);
  gamma_expression_ = gamma_of(std::span(outputs).subspan(1), entries);
  gamma_ = std::make_shared<formula::Bytecode>(std::array{expression_, gamma_expression_}, variables_);
  std::vector<Place> places;
  for (const auto& [row, column, entry] : entries) {
    outputs.push_back(entry);
    places.push_back({row, column});
  }
  hessian_ = std::make_shared<formula::Bytecode>(outputs, variables_);
  places_ = std::make_shared<const std::vector<Place>>(std::move(places));
}

Hamiltonian Hamiltonian::constrained(const Constraints& constraints) const {
  Hamiltonian result = *this;
  result.constraints_ = constraints;
  if (reduced_) {
    result.reduced_ = std::make_shared<Hamiltonian>(reduced_->constrained(constraints));
  }
  return result;
}

HamiltonianEvaluator::HamiltonianEvaluator(const Hamiltonian& hamiltonian)
    : dimension_(2 * hamiltonian.degrees_of_freedom()),
      value_(hamiltonian.value_code()),
      gradient_(hamiltonian.gradient_code()),
      hessian_(hamiltonian.hessian_code()),
      gamma_(hamiltonian.gamma_code()),
      places_(hamiltonian.hessian_places()) {}

double HamiltonianEvaluator::value(const double* z) {
  return *value_.at(z);
}

double HamiltonianEvaluator::gradient(const double* z, double* gradient) {
  const double* const outputs = gradient_.at(z);
  std::copy_n(outputs + 1, dimension_, gradient);
  return outputs[0];
}

double HamiltonianEvaluator::hessian(const double* z, double* gradient, double* hessian) {
  const double* const outputs = hessian_.at(z);
  std::copy_n(outputs + 1, dimension_, gradient);
  std::fill_n(hessian, dimension_ * dimension_, 0.0);
  const double* next = outputs + 1 + dimension_;
  for (const auto [row, column] : places_) {
    hessian[row * dimension_ + column] = hessian[column * dimension_ + row] = *next++;
  }
  return outputs[0];
}

std::span<const double> HamiltonianEvaluator::hessian_entries(const double* z) {
  return {hessian_.at(z) + 1 + dimension_, places_.size()};
}

double HamiltonianEvaluator::gamma(const double* z, double& energy) {
  const double* const outputs = gamma_.at(z);
  energy = outputs[0];
  return outputs[1];
}

}  // namespace rubato
