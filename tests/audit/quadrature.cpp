#include "audit/quadrature.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace audit {

namespace {

/// The polynomial ℓ_j by powers.
std::vector<long double> lagrange_polynomial(const std::vector<long double>& c, std::size_t j) {
  std::vector<long double> polynomial = {1.0L};
  for (std::size_t k = 0; k < c.size(); ++k) {
    if (k != j) {
      polynomial.push_back(0.0L);
      for (std::size_t power = polynomial.size(); power-- > 0;) {
        polynomial[power] = ((power > 0 ? polynomial[power - 1] : 0.0L) - c[k] * polynomial[power]) / (c[j] - c[k]);
      }
    }
  }
  return polynomial;
}

long double legendre(std::size_t degree, long double x) {
  long double last = 1.0L, value = x;
  for (std::size_t k = 2; k <= degree; ++k) {
    const auto n = static_cast<long double>(k);
    last = std::exchange(value, ((2 * n - 1) * x * value - (n - 1) * last) / n);
  }
  return degree == 0 ? 1.0L : value;
}

/// (x² - 1) P' of degree d, by n (x P_n - P_{n-1}).
long double legendre_slope(std::size_t degree, long double x) {
  return static_cast<long double>(degree) * (x * legendre(degree, x) - legendre(degree - 1, x));
}

/// The zeros of f in (-1, 1) between places where its sign changes, by bisection.
template <typename Function>
std::vector<long double> zeros(const Function& f) {
  constexpr int pieces = 4001;  // odd: no zero falls on a border
  std::vector<long double> found;
  for (int i = 1; i + 1 < pieces; ++i) {
    long double low = -1 + 2 * static_cast<long double>(i) / pieces;
    long double high = -1 + 2 * static_cast<long double>(i + 1) / pieces;
    if (f(low) * f(high) < 0) {
      for (int round = 0; round < 80; ++round) {
        const long double middle = (low + high) / 2;
        (f(low) * f(middle) <= 0 ? high : low) = middle;
      }
      found.push_back((low + high) / 2);
    }
  }
  return found;
}

}  // namespace

Quadrature::Quadrature(std::vector<long double> nodes) : c(std::move(nodes)) {
  const auto integrals = [&](long double to) {
    std::vector<long double> weights;
    for (std::size_t j = 0; j < c.size(); ++j) {
      const std::vector<long double> polynomial = lagrange_polynomial(c, j);
      long double sum = 0.0L;
      for (std::size_t power = polynomial.size(); power-- > 0;) {
        sum = (sum + polynomial[power] / static_cast<long double>(power + 1)) * to;
      }
      weights.push_back(sum);
    }
    return weights;
  };
  for (const long double node : c) {
    a.push_back(integrals(node));
  }
  b = integrals(1.0L);
}

long double Quadrature::value(std::size_t j, long double x) const {
  const std::vector<long double> polynomial = lagrange_polynomial(c, j);
  long double sum = 0.0L;
  for (std::size_t power = polynomial.size(); power-- > 0;) {
    sum = sum * x + polynomial[power];
  }
  return sum;
}

long double Quadrature::rate(std::size_t j, long double x) const {
  const std::vector<long double> polynomial = lagrange_polynomial(c, j);
  long double sum = 0.0L;
  for (std::size_t power = polynomial.size(); power-- > 1;) {
    sum = sum * x + static_cast<long double>(power) * polynomial[power];
  }
  return sum;
}

Quadrature gauss_quadrature(std::size_t m) {
  std::vector<long double> c;
  for (const long double x : zeros([m](long double x) { return legendre(m, x); })) {
    c.push_back((1 + x) / 2);
  }
  return Quadrature(c);
}

Quadrature lobatto_quadrature(std::size_t m) {
  std::vector<long double> c = {0.0L};
  if (m > 2) {
    for (const long double x : zeros([m](long double x) { return legendre_slope(m - 1, x) / (x * x - 1); })) {
      c.push_back((1 + x) / 2);
    }
  }
  c.push_back(1.0L);
  return Quadrature(c);
}

namespace {

/// Verlet steps of these lengths and of the same ones back.
std::vector<CompositionPart> verlet_steps(std::vector<long double> lengths) {
  for (std::size_t i = lengths.size() - 1; i-- > 0;) {
    lengths.push_back(lengths[i]);
  }
  std::vector<CompositionPart> parts;
  for (const long double length : lengths) {
    parts.push_back({false, length / 2});
    parts.push_back({true, length});
    parts.push_back({false, length / 2});
  }
  return parts;
}

std::vector<CompositionPart> alternating(std::vector<long double> lengths) {
  for (std::size_t i = lengths.size() - 1; i-- > 0;) {
    lengths.push_back(lengths[i]);
  }
  std::vector<CompositionPart> parts;
  for (const long double length : lengths) {
    parts.push_back({parts.size() % 2 == 0, length});
  }
  return parts;
}

}  // namespace

std::vector<CompositionPart> composition_parts(const std::string& name) {
  if (name == "golden") {  // 1/(1 + φ)/2, φ the golden ratio
    const long double a = 1 / (2 * (1 + std::numbers::phi_v<long double>));
    return alternating({a, 0.5L, 1 - 2 * a});
  }
  if (name == "verlet") {
    return verlet_steps({1.0L});
  }
  if (name == "suzuki-4") {
    const long double s = 1 / (4 - std::pow(4.0L, 1.0L / 3));
    return verlet_steps({s, s, 1 - 4 * s});
  }
  if (name == "blanes-moan-4") {
    const long double a1 = 0.0792036964311957L, a2 = 0.353172906049774L, a3 = -0.0420650803577195L;
    const long double b1 = 0.209515106613362L, b2 = -0.143851773179818L;
    return alternating({a1, b1, a2, b2, a3, 0.5L - (b1 + b2), 1 - 2 * (a1 + a2 + a3)});
  }
  if (name == "kahan-li-6") {
    return verlet_steps({0.39216144400731413927925056L, 0.33259913678935943859974864L, -0.70624617255763935980996482L,
                         0.08221359629355080023149045L, 0.79854399093482996339895035L});
  }
  if (name == "kahan-li-8") {
    return verlet_steps({0.13020248308889008087881763L, 0.56116298177510838456196441L, -0.38947496264484728640807860L,
                         0.15884190655515560089621075L, -0.39590389413323757733623154L, 0.18453964097831570709183254L,
                         0.25837438768632204729397911L, 0.29501172360931029887096624L, -0.60550853383003451169892108L});
  }
  if (name == "blanes-moan-rkn-6") {
    const long double a[] = {0.0378593198406116L, 0.102635633102435L, -0.0258678882665587L, 0.314241403071447L,
                             -0.130144459517415L, 0.106417700369543L, -0.00879424312851058L};
    const long double b[] = {0.09171915262446165L,  0.183983170005006L, -0.05653436583288827L,
                             0.004914688774712854L, 0.143761127168358L, 0.328567693746804L};
    std::vector<long double> half;
    long double drifts = 0, kicks = 0;
    for (int i = 0; i < 7; ++i) {
      half.push_back(a[i]);
      half.push_back(i < 6 ? b[i] : 0.5L - kicks);
      drifts += a[i];
      kicks += half.back();
    }
    half.push_back(1 - 2 * drifts);
    return alternating(half);
  }
  throw std::runtime_error("no composition is called " + name);
}

int composition_order(const std::string& name) {
  return name == "golden" || name == "verlet" ? 2 : name.back() - '0';
}

std::vector<long double> solved(std::vector<std::vector<long double>> rows) {
  const std::size_t n = rows.size();
  for (std::size_t p = 0; p < n; ++p) {
    const auto largest =
        std::max_element(rows.begin() + static_cast<std::ptrdiff_t>(p), rows.end(),
                         [p](const auto& a, const auto& b) { return std::abs(a[p]) < std::abs(b[p]); });
    std::swap(rows[p], *largest);
    for (std::size_t r = p + 1; r < n; ++r) {
      const long double factor = rows[r][p] / rows[p][p];
      for (std::size_t c = p; c <= n; ++c) {
        rows[r][c] -= factor * rows[p][c];
      }
    }
  }
  std::vector<long double> x(n);
  for (std::size_t p = n; p-- > 0;) {
    x[p] = rows[p][n];
    for (std::size_t c = p + 1; c < n; ++c) {
      x[p] -= rows[p][c] * x[c];
    }
    x[p] /= rows[p][p];
  }
  return x;
}

std::vector<long double> amplified(const std::vector<std::vector<long double>>& rows,
                                   const std::vector<long double>& errors) {
  const std::size_t n = errors.size();
  std::vector<long double> sums(n);
  std::vector<std::vector<long double>> system = rows;
  for (std::size_t column = 0; column < n; ++column) {
    for (std::size_t row = 0; row < n; ++row) {
      system[row].resize(n + 1);
      system[row][n] = row == column ? 1.0L : 0.0L;
    }
    const std::vector<long double> inverse = solved(system);
    for (std::size_t row = 0; row < n; ++row) {
      sums[row] += std::abs(inverse[row]) * errors[column];
    }
  }
  return sums;
}

}  // namespace audit
