#include <rubato/variation/action_quadrature.hpp>

#include <cmath>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

namespace {

using Real = long double;

struct Legendre {
  Real value, slope;
};

/// The Legendre polynomial of degree n at x in (-1, 1).
Legendre legendre(int n, Real x) {
  Real before = 1.0L, value = x;
  for (int k = 2; k <= n; ++k) {
    const Real next = ((2 * k - 1) * x * value - (k - 1) * before) / k;
    before = value;
    value = next;
  }
  return {value, n * (x * value - before) / (x * x - 1.0L)};
}

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
      const Legendre P = legendre(d, x);
      const Real change = P.slope * (1.0L - x * x) / (2.0L * x * P.slope - d * (d + 1) * P.value);
      x -= change;
      if (std::abs(change) < 1e-19L) {
        break;
      }
    }
    points.push_back(2 * i == d ? 0.5L : 0.5L * (1.0L + x));
  }
  return points;
}

/// ℓ_i(x) of `points`.
Real lagrange_value(const std::vector<Real>& points, std::size_t i, Real x) {
  Real product = 1.0L;
  for (std::size_t k = 0; k < points.size(); ++k) {
    product *= k == i ? 1.0L : (x - points[k]) / (points[i] - points[k]);
  }
  return product;
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
      const Real P = end ? 1.0L : legendre(d, 2.0L * at[static_cast<std::size_t>(i)] - 1.0L).value;
      weights[i] = static_cast<double>(1.0L / (d * (d + 1) * P * P));
    }
  }
  const auto count = static_cast<Eigen::Index>(c.size());
  nodes.setZero(count);
  values.setZero(count, d + 1);
  rates.setZero(count, d + 1);
  for (Eigen::Index j = 0; j < count; ++j) {
    const Real x = c[static_cast<std::size_t>(j)];
    nodes[j] = static_cast<double>(x);
    for (int i = 0; i <= d; ++i) {
      values(j, i) = static_cast<double>(lagrange_value(at, static_cast<std::size_t>(i), x));
      rates(j, i) = static_cast<double>(lagrange_rate(at, static_cast<std::size_t>(i), x));
    }
  }
}

void ActionQuadrature::interpolation(double sigma, Eigen::VectorXd& result) const {
  for (Eigen::Index i = 0; i <= degree; ++i) {
    double product = 1.0;
    for (Eigen::Index k = 0; k <= degree; ++k) {
      product *= k == i ? 1.0 : (sigma - control[k]) / (control[i] - control[k]);
    }
    result[i] = product;
  }
}

}  // namespace rubato
