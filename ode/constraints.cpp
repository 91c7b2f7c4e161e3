#include <rubato/ode/constraints.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Core>

#include <rubato/base/larger.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

bool vanishes(formula::Expression value) {
  return value.is_constant() && value.constant_value() == 0.0;
}

}  // namespace

Constraints::Constraints(const std::vector<std::string>& q,
                         const std::vector<std::pair<std::string, std::string>>& formulas,
                         const std::map<std::string, double>& parameters) {
  auto graph = std::make_shared<formula::Graph>();
  std::vector<formula::Expression> variables, values;
  std::vector<std::string> known = q, names;
  for (const std::string& name : q) {
    variables.push_back(graph->variable(name));
  }
  for (const auto& [name, value] : parameters) {
    known.push_back(name);
  }
  const auto resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
    if (const auto found = parameters.find(std::string(name)); found != parameters.end()) {
      return graph->constant(found->second);
    }
    const auto place = std::ranges::find(q, name);
    return place == q.end() ? std::nullopt : std::optional(variables[static_cast<std::size_t>(place - q.begin())]);
  };
  for (const auto& [name, text] : formulas) {
    names.push_back(name);
    values.push_back(formula::parse(text, *graph, {.resolve = resolve, .known_names = known}));
  }
  *this = Constraints(graph, variables, std::move(names), values);
}

Constraints::Constraints(std::shared_ptr<formula::Graph> graph, std::span<const formula::Expression> q,
                         std::vector<std::string> names, std::span<const formula::Expression> values) {
  if (names.empty()) {
    return;
  }
  if (std::set<std::string>(names.begin(), names.end()).size() != names.size()) {
    throw std::invalid_argument(fmt::format("two constraints have the same name: {}", fmt::join(names, ", ")));
  }
  if (names.size() > q.size()) {
    throw std::invalid_argument(
        fmt::format("{} constraints ({}) on {} coordinates depend on each other: leave {} of them out", names.size(),
                    fmt::join(names, ", "), q.size(), names.size() - q.size()));
  }
  auto stated = std::make_shared<Stated>();
  std::vector<formula::Expression> outputs(values.begin(), values.end());
  formula::Expression sum = graph->constant(0.0);
  std::vector<formula::Expression> inputs(q.begin(), q.end());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::vector<formula::Expression> row = formula::gradient(values[i], q);
    for (std::size_t a = 0; a < q.size(); ++a) {
      if (!vanishes(row[a])) {
        outputs.push_back(row[a]);
        stated->places.push_back({i, a});
      }
    }
    inputs.push_back(graph->variable(fmt::format("multiplier of {}", names[i])));  // no name of a user's
    sum = sum + inputs.back() * values[i];
  }
  stated->code = formula::Bytecode(outputs, q);
  std::vector<formula::Expression> second;
  for (const formula::HessianEntry& entry : formula::hessian_entries(sum, q)) {
    second.push_back(entry.value);
    stated->second_places.push_back({entry.row, entry.column});
  }
  stated->second = formula::Bytecode(second, inputs);
  inputs.resize(q.size());
  for (std::size_t a = 0; a < q.size(); ++a) {
    inputs.push_back(graph->variable(fmt::format("velocity {}", a)));
  }
  const auto velocities = std::span<const formula::Expression>(inputs).last(q.size());
  std::vector<formula::Expression> rates;
  for (std::size_t i = 0; i < values.size(); ++i) {
    formula::Expression rate = graph->constant(0.0);
    const std::vector<formula::Expression> row = formula::gradient(values[i], q);
    for (std::size_t a = 0; a < q.size(); ++a) {
      rate = rate + row[a] * velocities[a];
    }
    const std::vector<formula::Expression> derivatives = formula::gradient(rate, q);
    for (std::size_t a = 0; a < q.size(); ++a) {
      if (!vanishes(derivatives[a])) {
        rates.push_back(derivatives[a]);
        stated->rate_places.push_back({i, a});
      }
    }
  }
  stated->rate = formula::Bytecode(rates, inputs);
  stated->graph = std::move(graph);
  stated->variables.assign(q.begin(), q.end());
  stated->values.assign(values.begin(), values.end());
  stated->names = std::move(names);
  stated_ = std::move(stated);
}

ConstraintEvaluator::ConstraintEvaluator(const Constraints& constraints)
    : constraints_(constraints), evaluator_(constraints.code()) {
  g_.setZero(static_cast<Index>(constraints.count()));
  entries_.setZero(static_cast<Index>(constraints.places().size()));
  G_.setZero(g_.size(), static_cast<Index>(constraints.code().input_count()));
  ends_.assign(constraints.count(), 0);
  for (const Constraints::Place& place : constraints.places()) {
    ++ends_[place.row];
  }
  std::partial_sum(ends_.begin(), ends_.end(), ends_.begin());
}

void ConstraintEvaluator::evaluate(const double* q) {
  const double* const outputs = evaluator_.at(q);
  std::copy_n(outputs, g_.size(), g_.data());
  std::copy_n(outputs + g_.size(), entries_.size(), entries_.data());
  const double* entry = entries_.data();
  for (const auto [row, column] : constraints_.places()) {
    G_(static_cast<Index>(row), static_cast<Index>(column)) = *entry++;
  }
}

void ConstraintEvaluator::kick(const Eigen::Ref<const VectorXd>& entries, const VectorXd& mu, double* p) const {
  const double* entry = entries.data();
  for (const auto [row, column] : constraints_.places()) {
    p[column] -= *entry++ * mu[static_cast<Index>(row)];
  }
}

ConstraintEvaluator::Left ConstraintEvaluator::left_of(const VectorXd& values, const double* factors) const {
  constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
  const Constraints::Place* const places = constraints_.places().data();
  Left left;
  double largest = 0.0;
  std::size_t k = 0;
  for (std::size_t row = 0; row < ends_.size(); ++row) {
    double bound = 0.0, sum = 0.0;
    for (; k < ends_[row]; ++k) {
      const double size = std::abs(entries_[static_cast<Index>(k)]), factor = std::abs(factors[places[k].column]);
      bound += size * factor;
      sum += size;
      largest = std::max(largest, factor);
    }
    if (const double value = std::abs(values[static_cast<Index>(row)]); value != 0.0) {
      left.in_roundings = larger(left.in_roundings, value / (unit * bound));
      left.relative = larger(left.relative, value / sum);
    }
  }
  left.relative = left.relative == 0.0 ? 0.0 : left.relative / largest;
  return left;
}

ConstraintCurvature::ConstraintCurvature(const Constraints& constraints)
    : constraints_(constraints), second_(constraints.second_code()), rate_(constraints.rate_code()) {
  const auto n = static_cast<Index>(constraints.code().input_count());
  inputs_.setZero(2 * n);
  rates_.setZero(static_cast<Index>(constraints.count()), n);
}

void ConstraintCurvature::add_to(const double* q, const Eigen::Ref<const VectorXd>& mu, Eigen::Ref<MatrixXd> block) {
  const Index n = rates_.cols();
  std::copy_n(q, n, inputs_.data());
  inputs_.segment(n, mu.size()) = mu;
  const double* entry = second_.at(inputs_.data());
  for (const auto [row, column] : constraints_.second_places()) {
    const auto a = static_cast<Index>(row), b = static_cast<Index>(column);
    block(a, b) += *entry;
    if (a != b) {
      block(b, a) += *entry;
    }
    ++entry;
  }
}

const MatrixXd& ConstraintCurvature::of_rates(const double* q, const double* v) {
  const Index n = rates_.cols();
  std::copy_n(q, n, inputs_.data());
  std::copy_n(v, n, inputs_.data() + n);
  const double* entry = rate_.at(inputs_.data());
  for (const auto [row, column] : constraints_.rate_places()) {
    rates_(static_cast<Index>(row), static_cast<Index>(column)) = *entry++;
  }
  return rates_;
}

std::string ConstraintEvaluator::dependent() const {
  MatrixXd scaled = G_.transpose();
  for (Index i = 0; i < scaled.cols(); ++i) {
    const double size = scaled.col(i).norm();
    if (size == 0.0) {
      return constraints_.names()[static_cast<std::size_t>(i)];
    }
    scaled.col(i) /= size;
  }
  for (Index i = 1; i < scaled.cols(); ++i) {
    const MatrixXd before = scaled.leftCols(i);
    if ((solve::product(before, solve::least_squares(before, scaled.col(i))) - scaled.col(i)).norm() <
        least_independence) {
      return constraints_.names()[static_cast<std::size_t>(i)];
    }
  }
  return {};
}

std::string listed(std::span<const std::string> names, const VectorXd& values) {
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < names.size(); ++i) {
    parts.push_back(fmt::format("{} = {}", names[i], values[static_cast<Index>(i)]));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

bool approach_constraints(ConstraintEvaluator& at, VectorXd& q) {
  at.evaluate(q.data());
  for (int iteration = 0; iteration < most_multiplier_iterations && at.is_finite(); ++iteration) {
    if (at.left(q.data()).in_roundings <= roundings_of_start) {
      return true;
    }
    q -= solve::least_squares(at.G(), at.g());
    at.evaluate(q.data());
  }
  return false;
}

void check_constraints(const Constraints& constraints, std::span<const std::string> q_names,
                       std::span<const double> q) {
  ConstraintEvaluator at(constraints);
  VectorXd point = Eigen::Map<const VectorXd>(q.data(), static_cast<Index>(q.size()));
  at.evaluate(point.data());
  if (!at.is_finite()) {
    throw std::invalid_argument(fmt::format("a constraint or its gradient is not finite at the start ({} there)",
                                            listed(constraints.names(), at.g())));
  }
  if (const std::string name = at.dependent(); !name.empty()) {
    throw std::invalid_argument(fmt::format(
        "the gradient of the constraint {} {} at the start: {}", name,
        constraints.count() == 1 ? "vanishes" : "vanishes, or depends on those of the others,",
        constraints.count() == 1 ? "state it with a gradient that does not, without a power"
                                 : "leave out what follows from the others, and state each without a power"));
  }
  if (at.left(point.data()).in_roundings <= roundings_of_start) {
    return;
  }
  const std::string values = listed(constraints.names(), at.g());
  std::string remedy = "start where they are 0";
  if (approach_constraints(at, point)) {
    remedy = fmt::format("start from {}, which is near", listed(q_names, point));
  }
  throw std::invalid_argument(fmt::format("the start does not satisfy the constraints: {}; {}", values, remedy));
}

void refuse_start_off_hidden(const Constraints& constraints, const VectorXd& rates, const std::string& projection) {
  throw std::invalid_argument(fmt::format(
      "the start does not satisfy the hidden constraints, d/dt of {}; {}", listed(constraints.names(), rates),
      projection.empty() ? "start with velocities along the constraints"
                         : fmt::format("start with {}, the projection", projection)));
}

std::string dependence_near(const std::string& name, std::span<const std::string> q_names, const VectorXd& q) {
  return name.empty()
             ? std::string()
             : fmt::format("the gradient of the constraint {} vanishes, or depends on those of the others, near {}",
                           name, listed(q_names, q));
}

}  // namespace rubato
