#include <rubato/run/local_frequency.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace rubato {

namespace {

/// Differences of this relative size: rounding errors and curvature are both small beside them.
constexpr double small = 1e-6;
/// Each squares the ratio of the largest eigenvalue to the next once more; the growth is that of the last half.
constexpr int squares = 6;

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
  v_.resize(names.size());
}

void LocalFrequency::gradient(std::span<const double> z, std::vector<double>& into) {
  const std::span<const double> values = gradient_.front()(z);
  into.assign(values.begin(), values.end());
}

void LocalFrequency::apply(std::span<const double> z, std::span<double> v) {
  const std::size_t n = z.size() / 2;
  point_.resize(z.size());
  for (std::size_t i = 0; i < z.size(); ++i) {
    point_[i] = z[i] + v[i];
  }
  gradient(point_, there_);
  for (std::size_t i = 0; i < n; ++i) {
    v[i] = there_[n + i] - here_[n + i];
    v[n + i] = here_[i] - there_[i];
  }
}

double LocalFrequency::operator()(std::span<const double> z, double h) {
  constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
  if (gradient_.empty()) {
    return undefined;
  }
  const std::size_t n = z.size() / 2;
  gradient(z, here_);
  const double size = small * (length(z.first(n)) + std::abs(h) * length(std::span(here_).last(n)));
  if (!std::isfinite(size) || size == 0.0) {
    return undefined;
  }
  for (std::size_t i = 0; i < n; ++i) {
    v_[i] = size * (0.6 + 0.4 * std::cos(2.4 * static_cast<double>(i + 1)));
    v_[n + i] = 0.0;
  }
  double growth = 1.0;
  int counted = 0;
  for (int k = 0; k < squares; ++k) {
    // Displacements are multiplied by J H'' over their size: the second one begins from momenta of any size.
    const double before = length(std::span(v_).first(n));
    apply(z, v_);
    // A momentum too small to be distinguished from rounding, or too large for a difference, is scaled, and the result
    // back.
    const double momentum = length(std::span(v_).last(n)),
                 usual = small * (length(z.last(n)) + length(here_) * std::abs(h));
    const double scale = momentum > 0.0 && usual > 0.0 ? usual / momentum : 1.0;
    std::ranges::for_each(v_, [scale](double& x) { x *= scale; });
    apply(z, v_);
    const double after = length(std::span(v_).first(n)) / scale;
    if (!std::isfinite(after)) {
      return undefined;
    }
    if (after == 0.0) {
      return 0.0;
    }
    if (2 * k >= squares) {
      growth *= after / before;
      ++counted;
    }
    const double back = size / length(std::span(v_).first(n));
    std::ranges::for_each(v_, [back](double& x) { x *= back; });
  }
  return std::sqrt(std::pow(growth, 1.0 / counted));
}

}  // namespace rubato
