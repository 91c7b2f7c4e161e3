#include <rubato/variation/action_quadrature.hpp>

#include <cmath>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/lagrange_weight.hpp>
#include <rubato/variation/gauss_tableau.hpp>
#include <rubato/variation/legendre.hpp>

namespace rubato {

namespace {

using Real = long double;

/// The d + 1 Lobatto points on [0, 1]: the ends, and the zeros of the derivative of the Legendre polynomial of degree
/// d, by Newton's method with (1 - x²) P'' = 2x P' - d(d+1) P.
std::vector<Real> lobatto_points(int d) {
  std::vector<Real> points;
  for (int i = 0; i <= d; ++i) {
    Real x = -std::cos(3.14159265358979323846L * i / d);
    if (i == 0 || i == d) {
      points.push_back(i == 0 ? 0.0L : 1.0L);
      continue;
    }
    for (int iteration = 0; iteration < 100; ++iteration) {
      const Legendre P(d, x);
      const Real change = P.slope() * (1.0L - x * x) / (2.0L * x * P.slope() - d * (d + 1) * P.value);
      x -= change;
      if (std::abs(change) < 1e-19L) {
        break;
      }
    }
    points.push_back(2 * i == d ? 0.5L : 0.5L * (1.0L + x));
  }
  return points;
}

/// ℓ_i'(x).
Real lagrange_rate(const std::vector<Real>& points, std::size_t i, Real x) {
  Real sum = 0.0L;
  for (std::size_t j = 0; j < points.size(); ++j) {
    if (j == i) {
      continue;
    }
    Real product = 1.0L / (points[i] - points[j]);
    for (std::size_t k = 0; k < points.size(); ++k) {
      product *= k == i || k == j ? 1.0L : (x - points[k]) / (points[i] - points[k]);
    }
    sum += product;
  }
  return sum;
}

}  // namespace

ActionQuadrature::ActionQuadrature(Points which, int d) : points(which), degree(d) {
  if (d < 1 || d > most_degree) {
    throw std::invalid_argument(
        which == Points::gauss
            ? fmt::format("the number of Gauss points has to be between 1 and {}; got {}", most_degree, d)
            : fmt::format("the number of Lobatto points has to be between 2 and {}; got {}", most_degree + 1, d + 1));
  }
  const std::vector<Real> at = lobatto_points(d);
  std::vector<Real> c = at;
  control.setZero(d + 1);
  for (int i = 0; i <= d; ++i) {
    control[i] = static_cast<double>(at[static_cast<std::size_t>(i)]);
  }
  if (which == Points::gauss) {
    const GaussTableau gauss(d);
    c.assign(gauss.c.begin(), gauss.c.end());
    weights = gauss.b;
  } else {
    weights.setZero(d + 1);
    for (int i = 0; i <= d; ++i) {
      const bool end = i == 0 || i == d;
      const Real P = end ? 1.0L : Legendre(d, 2.0L * at[static_cast<std::size_t>(i)] - 1.0L).value;
      weights[i] = static_cast<double>(1.0L / (d * (d + 1) * P * P));
    }
  }
  const auto count = static_cast<Eigen::Index>(c.size());
  nodes.setZero(count);
  values.setZero(count, d + 1);
  rates.setZero(count, d + 1);
  const auto control_at = [&](std::size_t k) { return at[k]; };
  for (Eigen::Index j = 0; j < count; ++j) {
    const Real x = c[static_cast<std::size_t>(j)];
    nodes[j] = static_cast<double>(x);
    for (int i = 0; i <= d; ++i) {
      const auto number = static_cast<std::size_t>(i);
      values(j, i) = static_cast<double>(lagrange_weight(number, at.size(), x, control_at));
      rates(j, i) = static_cast<double>(lagrange_rate(at, number, x));
    }
  }
}

void ActionQuadrature::interpolation(double sigma, Eigen::VectorXd& result) const {
  for (Eigen::Index i = 0; i <= degree; ++i) {
    result[i] = lagrange_weight(static_cast<std::size_t>(i), static_cast<std::size_t>(degree) + 1, sigma,
                                [&](std::size_t k) { return control[static_cast<Eigen::Index>(k)]; });
  }
}

}  // namespace rubato
