#include <rubato/run/pole_watch.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/formula/divisors.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato {

PoleWatch::PoleWatch(const Problem& problem) {
  const HamiltonianProblem* const orbit = problem.hamiltonian();
  if (orbit == nullptr) {
    return;
  }
  formula::Graph graph;
  const std::vector<std::string> names = orbit->names();
  std::vector<formula::Expression> terms;
  for (const formula::Expression& term :
       formula::terms_of(problem.build(orbit->statement(), graph, orbit->formula_names()))) {
    const bool has_velocities = std::ranges::any_of(formula::variables_of(term), [&](std::size_t number) {
      return std::ranges::find(names, graph.variable_name(number)) == names.end();
    });
    if (!has_velocities) {
      terms.push_back(term);
    }
  }
  if (terms.empty()) {
    return;
  }
  const formula::Expression energy = formula::folded_sum(terms);
  if (const std::vector<formula::Expression> divisors = formula::divisors_of(energy); !divisors.empty()) {
    divisors_.emplace_back(graph, divisors, names);
    energy_.emplace_back(graph, std::vector{energy}, names);
  }
}

bool PoleWatch::crosses(std::span<const double> from, std::span<const double> to) {
  const std::span<const double> at_from = divisors_.front()(from);
  before_.assign(at_from.begin(), at_from.end());
  const std::span<const double> after = divisors_.front()(to);
  for (std::size_t i = 0; i < before_.size(); ++i) {
    if (before_[i] * after[i] < 0.0 && is_pole(from, to, i)) {
      return true;
    }
  }
  return false;
}

bool PoleWatch::is_pole(std::span<const double> from, std::span<const double> to, std::size_t divisor) {
  // Towards a simple pole the energy grows by 10⁶ where twenty halvings more are done; a quotient that has a limit
  // there, such as sin(q)/q, stays as it is.
  constexpr double grows = 1e3;
  constexpr int halvings = 40;
  const auto energy = [&](std::span<const double> z) { return std::abs(energy_.front()(z).front()); };
  const auto divisor_at = [&](double fraction) {
    point_.resize(from.size());
    for (std::size_t i = 0; i < from.size(); ++i) {
      point_[i] = from[i] + fraction * (to[i] - from[i]);
    }
    return divisors_.front()(point_)[divisor];
  };
  const bool falls = divisor_at(0.0) > 0.0;
  double low = 0.0, high = 1.0, largest = std::max(energy(from), energy(to));
  for (int i = 0; i < halvings; ++i) {
    const double middle = 0.5 * (low + high);
    ((divisor_at(middle) > 0.0) == falls ? low : high) = middle;
    if (2 * i == halvings) {
      largest = std::max(largest, energy(point_));
    }
  }
  static_cast<void>(divisor_at(low));
  return energy(point_) > grows * largest;
}

}  // namespace rubato
