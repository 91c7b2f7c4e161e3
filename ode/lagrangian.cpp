#include <rubato/ode/lagrangian.hpp>

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Core>

#include <rubato/formula/parse.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/ode/legendre.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

Lagrangian::Lagrangian(std::vector<std::string> q, std::string_view L, const Parameters& parameters)
    : graph_(std::make_shared<formula::Graph>()), q_names_(std::move(q)), velocity_names_(dotted(q_names_)) {
  std::vector<std::string> names = q_names_;
  names.insert(names.end(), velocity_names_.begin(), velocity_names_.end());
  for (const std::string& name : names) {
    if (!formula::is_valid_name(name)) {
      throw std::invalid_argument(fmt::format("'{}' cannot name a coordinate", name));
    }
  }
  declare();
  const std::vector<std::string> variables = names;
  for (const auto& [name, value] : parameters) {
    names.push_back(name);
  }
  const formula::ParseContext context{
      .resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
        if (const auto found = parameters.find(std::string(name)); found != parameters.end()) {
          return graph_->constant(found->second);
        }
        return std::ranges::find(variables, name) == variables.end() ? std::nullopt
                                                                     : std::optional(graph_->variable(name));
      },
      .known_names = names};
  expression_ = formula::parse(L, *graph_, context);
  compile();
}

Lagrangian::Lagrangian(std::shared_ptr<formula::Graph> graph, std::vector<std::string> q,
                       std::vector<std::string> q_dot, formula::Expression L)
    : graph_(std::move(graph)), q_names_(std::move(q)), velocity_names_(std::move(q_dot)), expression_(L) {
  declare();
  compile();
}

std::vector<std::string> Lagrangian::numbered(std::size_t n) {
  std::vector<std::string> names;
  for (std::size_t i = 1; i <= n; ++i) {
    names.push_back(fmt::format("q{}", i));
  }
  return names;
}

std::vector<std::string> Lagrangian::dotted(const std::vector<std::string>& q) {
  std::vector<std::string> names;
  for (const std::string& name : q) {
    names.push_back(name + "_dot");
  }
  return names;
}

void Lagrangian::declare() {
  if (q_names_.empty() || q_names_.size() != velocity_names_.size()) {
    throw std::invalid_argument(fmt::format(
        "a Lagrangian needs as many velocities as coordinates, at least one: got {} coordinates [{}] and {} velocities "
        "[{}]",
        q_names_.size(), fmt::join(q_names_, ", "), velocity_names_.size(), fmt::join(velocity_names_, ", ")));
  }
  std::set<std::string_view> seen;
  for (const auto* names : {&q_names_, &velocity_names_}) {
    for (const std::string& name : *names) {
      if (!seen.insert(name).second) {
        throw std::invalid_argument(fmt::format("'{}' is used twice among the coordinates and velocities", name));
      }
      variables_.push_back(graph_->variable(name));
    }
  }
}

void Lagrangian::compile() {
  const formula::WithoutConstant separated = formula::separate_constant(expression_);
  if (separated.constant != 0.0) {
    constant_ = separated.constant;
    reduced_ = std::make_shared<Lagrangian>(graph_, q_names_, velocity_names_, separated.rest);
  }
  std::vector<formula::Expression> outputs{expression_};
  std::ranges::copy(formula::gradient(expression_, variables_), std::back_inserter(outputs));
  gradient_ = std::make_shared<formula::Bytecode>(outputs, variables_);
  const std::size_t n = degrees_of_freedom();
  energy_ = graph_->constant(0.0);
  for (std::size_t i = 0; i < n; ++i) {
    energy_ += variables_[n + i] * outputs[1 + n + i];
  }
  energy_ = energy_ - expression_;
  energy_size_ = std::make_shared<formula::Bytecode>(formula::sum_size_code(energy_, variables_));
  std::ranges::copy(formula::hessian_upper(expression_, variables_), std::back_inserter(outputs));
  hessian_ = std::make_shared<formula::Bytecode>(outputs, variables_);
}

Lagrangian Lagrangian::constrained(const Constraints& constraints) const {
  Lagrangian result = *this;
  result.constraints_ = constraints;
  if (reduced_) {
    result.reduced_ = std::make_shared<Lagrangian>(reduced_->constrained(constraints));
  }
  return result;
}

LagrangianEvaluator::LagrangianEvaluator(const Lagrangian& lagrangian)
    : size_(2 * lagrangian.degrees_of_freedom()),
      gradient_(lagrangian.gradient_code()),
      hessian_(lagrangian.hessian_code()) {}

double LagrangianEvaluator::gradient(const double* inputs, double* gradient) {
  std::copy_n(inputs, size_, gradient_.inputs().data());
  gradient_.run();
  for (std::size_t i = 0; i < size_; ++i) {
    gradient[i] = gradient_.output(1 + i);
  }
  return gradient_.output(0);
}

double LagrangianEvaluator::hessian(const double* inputs, double* gradient, double* hessian) {
  std::copy_n(inputs, size_, hessian_.inputs().data());
  hessian_.run();
  for (std::size_t i = 0; i < size_; ++i) {
    gradient[i] = hessian_.output(1 + i);
  }
  std::size_t next = 1 + size_;
  for (std::size_t i = 0; i < size_; ++i) {
    for (std::size_t j = i; j < size_; ++j) {
      hessian[i * size_ + j] = hessian[j * size_ + i] = hessian_.output(next++);
    }
  }
  return hessian_.output(0);
}

namespace {

/// What a singular mass matrix (n × n) leaves free, in words.
std::string free_velocities(const Lagrangian& lagrangian, const Eigen::MatrixXd& masses) {
  const std::vector<std::string>& names = lagrangian.velocity_names();
  std::vector<std::string> linear;
  for (Eigen::Index i = 0; i < masses.rows(); ++i) {
    if (masses.row(i).isZero(0.0)) {
      linear.push_back(names[static_cast<std::size_t>(i)]);
    }
  }
  if (!linear.empty()) {
    return fmt::format("there it has no second derivative by {}", fmt::join(linear, ", "));
  }
  const Eigen::VectorXd scales = velocity_scales(masses);
  const Eigen::MatrixXd scaled = scales.asDiagonal() * masses * scales.asDiagonal();
  // Of a symmetric matrix these are eigenvectors.
  Eigen::VectorXd direction = scales.asDiagonal() * solve::singular_values(scaled).vectors.rightCols<1>();
  direction /= direction.cwiseAbs().maxCoeff();
  std::vector<std::string> parts;
  for (Eigen::Index i = 0; i < direction.size(); ++i) {
    if (std::abs(direction[i]) > 1e-6) {
      parts.push_back(fmt::format("{:.3g} {}", direction[i], names[static_cast<std::size_t>(i)]));
    }
  }
  return fmt::format("nothing there resists a change of the velocities along {}", fmt::join(parts, " + "));
}

}  // namespace

std::vector<double> momenta(const Lagrangian& lagrangian, std::span<const double> q, std::span<const double> q_dot) {
  const std::size_t n = lagrangian.degrees_of_freedom();
  if (q.size() != n || q_dot.size() != n) {
    throw std::invalid_argument(
        fmt::format("the initial state has {} coordinates and {} velocities; the Lagrangian "
                    "has {} of each",
                    q.size(), q_dot.size(), n));
  }
  std::vector<double> inputs(q.begin(), q.end());
  inputs.insert(inputs.end(), q_dot.begin(), q_dot.end());
  std::vector<double> gradient(2 * n), hessian(4 * n * n);
  const double value = LagrangianEvaluator(lagrangian).hessian(inputs.data(), gradient.data(), hessian.data());
  const auto finite = [](double x) { return std::isfinite(x); };
  if (!std::ranges::all_of(inputs, finite)) {
    throw std::invalid_argument(fmt::format("the initial state is not finite: q = ({}), q_dot = ({})",
                                            fmt::join(q, ", "), fmt::join(q_dot, ", ")));
  }
  if (!finite(value) || !std::ranges::all_of(gradient, finite) || !std::ranges::all_of(hessian, finite)) {
    throw std::invalid_argument(fmt::format(
        "L or a derivative of it is not finite at the initial state, q = ({}), q_dot = ({}): L = {}, gradient ({})",
        fmt::join(q, ", "), fmt::join(q_dot, ", "), value, fmt::join(gradient, ", ")));
  }
  const auto size = static_cast<Eigen::Index>(n);
  const Eigen::MatrixXd masses =
      Eigen::Map<const Eigen::MatrixXd>(hessian.data(), 2 * size, 2 * size).bottomRightCorner(size, size);
  LegendreTransform transform(lagrangian);
  if (!transform.is_regular(masses)) {
    throw SingularLagrangianError(
        fmt::format("L is singular: its Hessian in the velocities has no inverse at the initial state; {}. Momenta "
                    "then do not determine velocities: leave out coordinates without kinetic energy, start elsewhere "
                    "if it is singular at this place only, or, if L is p q_dot - H, state H in [hamiltonian]",
                    free_velocities(lagrangian, masses)));
  }
  return {gradient.begin() + static_cast<std::ptrdiff_t>(n), gradient.end()};
}

}  // namespace rubato
