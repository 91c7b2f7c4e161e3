#include <rubato/ode/constrained_kick.hpp>

#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/larger.hpp>

namespace rubato {

using Eigen::Index;
using formula::Expression;

namespace {

/// Sums by place, of terms that are there.
class SparseSum {
public:
  void add(std::size_t row, std::size_t column, Expression term) {
    const auto [found, is_new] = sums_.try_emplace({row, column}, term);
    if (!is_new) {
      found->second = found->second + term;
    }
  }
  [[nodiscard]] const std::map<std::pair<std::size_t, std::size_t>, Expression>& all() const { return sums_; }

private:
  std::map<std::pair<std::size_t, std::size_t>, Expression> sums_;
};

/// A sum of terms, each added to what is there.
void add_term(std::optional<Expression>& sum, Expression term) {
  sum = sum ? *sum + term : term;
}

}  // namespace

ConstrainedKick::ConstrainedKick(Expression T, std::span<const Expression> variables, const Constraints& constraints,
                                 Then then)
    : n_(static_cast<Index>(variables.size() / 2)),
      c_(static_cast<Index>(constraints.count())),
      m_(static_cast<Index>(constraints.places().size())) {
  const bool drifts = then == Then::drift;
  const std::size_t n = variables.size() / 2, c = constraints.count();
  const std::vector<Constraints::Place>& places = constraints.places();
  formula::Graph graph;
  std::vector<Expression> inputs;
  const auto add_inputs = [&](std::size_t count) {
    const std::size_t first = inputs.size();
    for (std::size_t i = 0; i < count; ++i) {
      inputs.push_back(graph.variable(fmt::format("input {}", inputs.size())));
    }
    return first;
  };
  const std::size_t z = add_inputs(2 * n), low = add_inputs(2 * n), delta = add_inputs(2 * n),
                    entry = add_inputs(places.size()), mu = add_inputs(c), length = add_inputs(1);

  // Derivatives of T and g in variables of their own, so that no other graph grows.
  std::vector<Expression> own;
  for (std::size_t i = 0; i < 2 * n; ++i) {
    own.push_back(graph.variable(fmt::format("own {}", i)));
  }
  const auto own_q = std::span<const Expression>(own).first(n), own_p = std::span<const Expression>(own).last(n);
  std::vector<Expression> kinetic = formula::substitute(std::vector{T}, graph, variables, own);
  const std::vector<Expression> velocity = formula::gradient(kinetic.front(), own_p);
  const std::vector<formula::HessianEntry> hessian = formula::hessian_entries(kinetic.front(), own_p);
  kinetic.insert(kinetic.end(), velocity.begin(), velocity.end());
  for (const formula::HessianEntry& one : hessian) {
    kinetic.push_back(one.value);
  }
  std::vector<Expression> holonomic = formula::substitute(constraints.values(), graph, constraints.variables(), own_q);
  for (const auto& [row, column] : places) {
    holonomic.push_back(formula::derivative(holonomic[row], own_q[column]));
  }

  std::vector<Expression> moved(inputs.begin() + static_cast<std::ptrdiff_t>(delta),
                                inputs.begin() + static_cast<std::ptrdiff_t>(delta + 2 * n));
  for (std::size_t k = 0; k < places.size(); ++k) {
    Expression& p = moved[n + places[k].column];
    p = p - inputs[entry + k] * inputs[mu + places[k].row];
  }
  std::vector<Expression> there(2 * n);
  const auto displace = [&](std::size_t first) {
    for (std::size_t i = first; i < first + n; ++i) {
      there[i] = inputs[z + i] + (inputs[low + i] + moved[i]);
    }
  };
  displace(n);
  displace(0);
  const std::vector<Expression> of_T = formula::substitute(kinetic, graph, own, there);
  const auto v = std::span<const Expression>(of_T).subspan(1, n);
  std::vector<Expression> entries_there(inputs.begin() + static_cast<std::ptrdiff_t>(entry),
                                        inputs.begin() + static_cast<std::ptrdiff_t>(mu));
  std::vector<Expression> g;
  if (drifts) {
    for (std::size_t i = 0; i < n; ++i) {
      moved[i] = moved[i] + inputs[length] * v[i];
    }
    displace(0);
    g = formula::substitute(holonomic, graph, own_q, std::span<const Expression>(there).first(n));
    entries_there.assign(g.begin() + static_cast<std::ptrdiff_t>(c), g.end());
    g.resize(c);
  }

  // What rounds in the factors of G: the coordinates, with what they moved by, or the velocities, with what the kicks
  // made of them, which is more than they are where the motion turns round.
  std::vector<Expression> sizes;
  for (std::size_t i = 0; i < n; ++i) {
    sizes.push_back(drifts ? abs(there[i]) + abs(moved[i]) : abs(v[i]));
  }
  if (!drifts) {
    std::vector<Expression> kicks;
    for (std::size_t i = n; i < 2 * n; ++i) {
      kicks.push_back(abs(inputs[delta + i]));
    }
    for (std::size_t k = 0; k < places.size(); ++k) {
      kicks[places[k].column] += abs(inputs[entry + k] * inputs[mu + places[k].row]);
    }
    for (std::size_t k = 0; k < hessian.size(); ++k) {
      const std::size_t row = hessian[k].row, column = hessian[k].column;
      const Expression size = abs(of_T[1 + n + k]);
      sizes[row] += size * kicks[column];
      if (row != column) {
        sizes[column] += size * kicks[row];
      }
    }
  }
  std::vector<std::optional<Expression>> rates(c), bounds(c), sums(c);
  std::optional<Expression> largest;
  for (std::size_t k = 0; k < places.size(); ++k) {
    const auto [row, column] = places[k];
    const Expression factor = drifts ? there[column] : v[column], size = abs(entries_there[k]);
    add_term(rates[row], entries_there[k] * factor);
    add_term(bounds[row], size * sizes[column]);
    add_term(sums[row], size);
    largest = largest ? max(*largest, sizes[column]) : sizes[column];
  }
  SparseSum product, matrix;
  for (std::size_t k = 0; k < hessian.size(); ++k) {
    const auto add = [&](std::size_t from, std::size_t to) {
      for (std::size_t place = 0; place < places.size(); ++place) {
        if (places[place].column == from) {
          product.add(to, places[place].row, of_T[1 + n + k] * inputs[entry + place]);
        }
      }
    };
    add(hessian[k].row, hessian[k].column);
    if (hessian[k].row != hessian[k].column) {
      add(hessian[k].column, hessian[k].row);
    }
  }
  for (std::size_t k = 0; k < places.size(); ++k) {
    for (std::size_t j = 0; j < c; ++j) {
      if (const auto found = product.all().find({places[k].column, j}); found != product.all().end()) {
        matrix.add(places[k].row, j, entries_there[k] * found->second);
      }
    }
  }

  const Expression zero = graph.constant(0.0);
  std::vector<Expression> outputs;
  for (std::size_t i = 0; i < c; ++i) {
    outputs.push_back(drifts ? g[i] : rates[i].value_or(zero));
  }
  for (const auto* of : {&bounds, &sums}) {
    for (const std::optional<Expression>& one : *of) {
      outputs.push_back(one.value_or(zero));
    }
  }
  outputs.push_back(largest.value_or(zero));
  outputs.insert(outputs.end(), moved.begin(), moved.end());
  outputs.insert(outputs.end(), there.begin(), there.end());
  outputs.push_back(of_T.front());
  outputs.insert(outputs.end(), entries_there.begin(), entries_there.end());
  for (const auto& [place, value] : matrix.all()) {
    outputs.push_back(drifts ? inputs[length] * value : value);
    places_.push_back({place.first, place.second});
  }
  evaluator_ = formula::ScalarEvaluator(formula::Bytecode(outputs, inputs));
}

bool ConstrainedKick::is_rounding(double roundings) const {
  constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
  const double *const bounds = outputs_ + c_, *const sums = bounds + c_;
  bool all = true;
  for (Index i = 0; i < c_; ++i) {
    all = all && std::abs(outputs_[i]) <= roundings * unit * bounds[i] && std::isfinite(sums[i]);
  }
  return all;
}

double ConstrainedKick::relative() const {
  const double* const sums = outputs_ + 2 * c_;
  double largest = 0.0;
  for (Index i = 0; i < c_; ++i) {
    if (!std::isfinite(sums[i])) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    if (const double value = std::abs(outputs_[i]); value != 0.0) {
      largest = larger(largest, value / sums[i]);
    }
  }
  return largest == 0.0 ? 0.0 : largest / sums[c_];
}

void ConstrainedKick::matrix(Eigen::MatrixXd& matrix, Eigen::VectorXd& units) const {
  const double* const entries = outputs_ + 3 * c_ + 2 + 4 * n_ + m_;
  units.setOnes();
  for (std::size_t k = 0; k < places_.size(); ++k) {
    if (const double size = std::abs(entries[k]); places_[k].row == places_[k].column && std::isnormal(size)) {
      units[static_cast<Index>(places_[k].row)] = 1.0 / std::sqrt(size);
    }
  }
  matrix.setZero();
  for (std::size_t k = 0; k < places_.size(); ++k) {
    const auto row = static_cast<Index>(places_[k].row), column = static_cast<Index>(places_[k].column);
    matrix(row, column) = units[row] * entries[k] * units[column];
  }
}

}  // namespace rubato
