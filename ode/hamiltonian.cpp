#include <rubato/ode/hamiltonian.hpp>

#include <algorithm>
#include <array>
#include <iterator>
#include <map>
#include <mutex>
#include <set>
#include <span>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/loop.hpp>
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

/// f = J∇H
std::vector<Expression> flow_of(std::span<const Expression> gradient) {
  const std::size_t n = gradient.size() / 2;
  std::vector<Expression> f;
  for (std::size_t i = 0; i < gradient.size(); ++i) {
    f.push_back(i < n ? gradient[n + i] : -gradient[i - n]);
  }
  return f;
}

Expression by_hessian(std::span<const Expression> gradient, std::span<const formula::HessianEntry> entries) {
  const std::size_t dimension = gradient.size();
  const std::vector<Expression> f = flow_of(gradient);
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

/// The derivative of w·∇H along f, where w is f: the Hessian of a loop has as many entries as it has iterations.
Expression along_flow(std::span<const Expression> gradient, std::span<const Expression> variables) {
  const std::vector<Expression> f = flow_of(gradient);
  formula::Graph& graph = *gradient.front().graph();
  std::vector<Expression> w, terms;
  for (std::size_t i = 0; i < f.size(); ++i) {
    w.push_back(graph.variable(fmt::format("w {}", i)));
    terms.push_back(gradient[i] * w[i]);
  }
  const std::vector<Expression> turned = formula::gradient(formula::folded_sum(terms), variables);
  terms.clear();
  for (std::size_t i = 0; i < f.size(); ++i) {
    terms.push_back(turned[i] * f[i]);
  }
  return formula::substitute(formula::folded_sum(terms), w, f);
}

Expression gamma_of(Expression H, std::span<const Expression> variables) {
  const std::vector<Expression> gradient = formula::gradient(H, variables);
  return formula::has_loops(H) ? along_flow(gradient, variables)
                               : by_hessian(gradient, formula::hessian_entries(H, variables));
}

}  // namespace

/// Each derivative is taken in a graph of its own: they are asked for by several threads, and others may be using the
/// graph of the Hamiltonian.
class Hamiltonian::Second {
public:
  Second(Expression H, std::span<const Expression> variables) : H_(H, variables) {}

  struct Hessian {
    formula::Bytecode code;
    std::vector<Place> places;
  };
  [[nodiscard]] const Hessian& hessian() {
    std::call_once(of_hessian_, [this] {
      const OwnFormula own(H_.formula, H_.variables);
      std::vector<Expression> outputs{own.formula};
      std::ranges::copy(formula::gradient(own.formula, own.variables), std::back_inserter(outputs));
      for (const auto& [row, column, entry] : formula::hessian_entries(own.formula, own.variables)) {
        outputs.push_back(entry);
        hessian_.places.push_back({row, column});
      }
      hessian_.code = formula::Bytecode(outputs, own.variables);
    });
    return hessian_;
  }
  [[nodiscard]] const formula::Bytecode& gamma_code() {
    std::call_once(of_gamma_, [this] {
      const OwnFormula own(H_.formula, H_.variables);
      gamma_ = formula::Bytecode(std::array{own.formula, gamma_of(own.formula, own.variables)}, own.variables);
    });
    return gamma_;
  }

private:
  /// A formula and its variables in a graph of their own.
  struct OwnFormula {
    OwnFormula(Expression other, std::span<const Expression> of)
        : formula(formula::substitute(std::span(&other, 1), graph, {}, {}).front()),
          variables(formula::substitute(of, graph, {}, {})) {}
    OwnFormula(const OwnFormula&) = delete;
    OwnFormula& operator=(const OwnFormula&) = delete;

    formula::Graph graph;
    Expression formula;
    std::vector<Expression> variables;
  };

  const OwnFormula H_;
  std::once_flag of_hessian_, of_gamma_;
  Hessian hessian_;
  formula::Bytecode gamma_;
};

const formula::Bytecode& Hamiltonian::hessian_code() const {
  return second_->hessian().code;
}

const std::vector<Hamiltonian::Place>& Hamiltonian::hessian_places() const {
  return second_->hessian().places;
}

const formula::Bytecode& Hamiltonian::gamma_code() const {
  return second_->gamma_code();
}

Expression Hamiltonian::gamma() const {
  return gamma_of(expression_, variables_);
}

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
  second_ = std::make_shared<Second>(expression_, variables_);
}

Hamiltonian Hamiltonian::with_own_graph() const {
  Hamiltonian own = *this;
  own.graph_ = std::make_shared<formula::Graph>();
  own.variables_ = formula::substitute(variables_, *own.graph_, {}, {});
  own.expression_ = formula::substitute(std::array{expression_}, *own.graph_, {}, {}).front();
  if (reduced_) {
    own.reduced_ = std::make_shared<Hamiltonian>(reduced_->with_own_graph());
  }
  return own;
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
      second_(hamiltonian.second()),
      value_(hamiltonian.value_code()),
      gradient_(hamiltonian.gradient_code()) {}

formula::ScalarEvaluator& HamiltonianEvaluator::hessian_evaluator() {
  return hessian_ ? *hessian_ : hessian_.emplace(second_->hessian().code);
}

double HamiltonianEvaluator::value(const double* z) {
  return *value_.at(z);
}

double HamiltonianEvaluator::gradient(const double* z, double* gradient) {
  const double* const outputs = gradient_.at(z);
  std::copy_n(outputs + 1, dimension_, gradient);
  return outputs[0];
}

double HamiltonianEvaluator::hessian(const double* z, double* gradient, double* hessian) {
  const double* const outputs = hessian_evaluator().at(z);
  std::copy_n(outputs + 1, dimension_, gradient);
  std::fill_n(hessian, dimension_ * dimension_, 0.0);
  const double* next = outputs + 1 + dimension_;
  for (const auto [row, column] : second_->hessian().places) {
    hessian[row * dimension_ + column] = hessian[column * dimension_ + row] = *next++;
  }
  return outputs[0];
}

std::span<const double> HamiltonianEvaluator::hessian_entries(const double* z) {
  return {hessian_evaluator().at(z) + 1 + dimension_, second_->hessian().places.size()};
}

double HamiltonianEvaluator::gamma(const double* z, double& energy) {
  const double* const outputs = (gamma_ ? *gamma_ : gamma_.emplace(second_->gamma_code())).at(z);
  energy = outputs[0];
  return outputs[1];
}

}  // namespace rubato
