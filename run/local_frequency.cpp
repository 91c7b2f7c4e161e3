#include <rubato/run/local_frequency.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace rubato {

namespace {

/// Differences of this relative size: rounding errors and curvature are both small beside them.
constexpr double small = 1e-6;

double length(std::span<const double> v) {
  double largest = 0.0;
  for (const double x : v) {
    largest = std::max(largest, std::abs(x));
  }
  return largest;
}

}  // namespace

LocalFrequency::LocalFrequency(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  if (orbit.L || !orbit.constraints.empty()) {
    return;
  }
  formula::Graph graph;
  const std::vector<std::string> names = orbit.names();
  const formula::Expression H = problem.build(orbit.H, graph, names);
  std::vector<formula::Expression> variables;
  for (const std::string& name : names) {
    variables.push_back(graph.variable(name));
  }
  gradient_.emplace_back(graph, formula::gradient(H, variables), names);
  moving_ = names.size() / 2 - (orbit.driven || orbit.fictitious_time ? 1 : 0);
}

std::vector<double> LocalFrequency::flow(std::span<const double> z) {
  const std::span<const double> gradient = gradient_.front()(z);
  const std::size_t n = z.size() / 2;
  std::vector<double> rate(z.size(), 0.0);
  for (std::size_t i = 0; i < moving_; ++i) {
    rate[i] = gradient[n + i];
    rate[n + i] = -gradient[i];
  }
  return rate;
}

std::vector<double> LocalFrequency::product(std::span<const double> z, std::span<const double> rate,
                                            std::span<const double> v, double h) {
  const std::size_t n = z.size() / 2;
  std::vector<double> result(z.size(), 0.0);
  for (const std::size_t first : {std::size_t{0}, n}) {
    const auto moving = [&](std::span<const double> of) { return length(of.subspan(first, moving_)); };
    const double reach = moving(v);
    if (reach == 0.0) {
      continue;
    }
    const double scale = small * (moving(z) + std::abs(h) * moving(rate) + h * h * reach) / reach;
    std::vector<double> there(z.begin(), z.end());
    for (std::size_t i = first; i < first + moving_; ++i) {
      there[i] += scale * v[i];
    }
    there = flow(there);
    for (std::size_t i = 0; i < result.size(); ++i) {
      result[i] += (there[i] - rate[i]) / scale;
    }
  }
  return result;
}

double LocalFrequency::operator()(std::span<const double> z, double h) {
  if (gradient_.empty()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const std::vector<double> rate = flow(z), second = product(z, rate, rate, h), third = product(z, rate, second, h);
  const auto size = [&](std::span<const double> v, std::span<const double> product) {
    double sum = 0.0;
    for (std::size_t i = 0, n = z.size() / 2; i < moving_; ++i) {
      sum += std::abs(v[i] * product[n + i]) + std::abs(v[n + i] * product[i]);
    }
    return sum;
  };
  return std::sqrt(size(second, third) / size(rate, second));
}

}  // namespace rubato
