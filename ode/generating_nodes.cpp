#include <rubato/ode/generating_nodes.hpp>

#include <cmath>
#include <numbers>
#include <vector>

namespace rubato {

namespace {

using Eigen::Index;

/// P_0(x) … P_last(x).
std::vector<long double> legendre(long double x, int last) {
  std::vector<long double> p{1.0L, x};
  for (int l = 1; l < last; ++l) {
    const auto i = static_cast<std::size_t>(l);
    p.push_back(((2 * l + 1) * x * p[i] - l * p[i - 1]) / (l + 1));
  }
  return p;
}

struct GaussPoint {
  long double x, weight;
};
/// The points of the Gauss rule on [-1, 1], increasing.
std::vector<GaussPoint> gauss_rule(int points) {
  std::vector<GaussPoint> rule;
  const auto n = static_cast<std::size_t>(points);
  for (int i = points; i >= 1; --i) {
    long double x = std::cos(std::numbers::pi_v<long double> * (i - 0.25L) / (points + 0.5L));
    long double slope = 0.0L;
    for (int iteration = 0; iteration < 10; ++iteration) {  // quadratic from 1e-2: converged long before
      const auto p = legendre(x, points);
      slope = points * (p[n - 1] - x * p[n]) / (1 - x * x);
      x -= p[n] / slope;
    }
    rule.push_back({x, 2 / ((1 - x * x) * slope * slope)});
  }
  return rule;
}

/// ∫^x P_l/2 of the docstring.
long double antiderivative_of(const std::vector<long double>& p, int l) {
  const auto i = static_cast<std::size_t>(l);
  return (p[i + 1] - (l > 0 ? p[i - 1] : 0.0L)) / (2 * (2 * l + 1));
}

}  // namespace

GeneratingNodes::GeneratingNodes(int terms, bool with_parity)
    : count(with_parity ? (terms + 1) / 2 : terms), parity(with_parity) {
  std::vector<GaussPoint> rule = gauss_rule(parity ? 2 * count : count);
  if (parity) {
    rule.erase(rule.begin(), rule.begin() + count);
  }
  const int degrees = parity ? 2 * count : count;  // degrees below this are represented
  std::vector<std::vector<long double>> p;
  for (const GaussPoint& point : rule) {
    p.push_back(legendre(point.x, degrees));
  }
  const auto at_centre = legendre(0.0L, degrees);
  tau.resize(count);
  integral.resize(count);
  transform.resize(degrees, count);
  centre_value.setZero(count);
  for (int d = 0; d < 2; ++d) {
    antiderivative[d].setZero(count, count);
    centre_integral[d].setZero(count);
  }
  for (Index j = 0; j < count; ++j) {
    const auto [x, weight] = rule[static_cast<std::size_t>(j)];
    tau[j] = static_cast<double>(x / 2);
    integral[j] = static_cast<double>(parity ? weight : weight / 2);
    for (int l = 0; l < degrees; ++l) {
      // The coefficient of P_l is (2l+1)/2 Σ weight P_l(x) f(x), over the nodes of both signs.
      const long double coefficient =
          (2 * l + 1) * weight * p[static_cast<std::size_t>(j)][static_cast<std::size_t>(l)] / (parity ? 1 : 2);
      transform(l, j) = static_cast<double>(coefficient);
      centre_value[j] += static_cast<double>(coefficient * at_centre[static_cast<std::size_t>(l)]);
      for (int d = 0; d < 2; ++d) {
        if (parity && l % 2 != d) {
          continue;
        }
        for (Index i = 0; i < count; ++i) {
          antiderivative[d](i, j) +=
              static_cast<double>(coefficient * antiderivative_of(p[static_cast<std::size_t>(i)], l));
        }
        centre_integral[d][j] += static_cast<double>(coefficient * antiderivative_of(at_centre, l));
      }
    }
  }
}

Eigen::VectorXd GeneratingNodes::integrals_beyond(double ratio) const {
  const auto degrees = static_cast<int>(transform.rows());
  const auto p = legendre(1.0L + 2.0L * static_cast<long double>(ratio), degrees);
  Eigen::VectorXd result(degrees);
  for (int l = 0; l < degrees; ++l) {
    result[l] = static_cast<double>(antiderivative_of(p, l) - (l == 0 ? 0.5L : 0.0L));
  }
  return result;
}

}  // namespace rubato
