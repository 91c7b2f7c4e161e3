#include <rubato/formula/special.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory_resource>
#include <numbers>
#include <stdexcept>
#include <vector>

namespace rubato::formula {

namespace {

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
constexpr double largest_order = 1000.0;
constexpr double two_over_root_pi = 2.0 * std::numbers::inv_sqrtpi;

/// Room for some series without an allocation, as long as they are of usual length.
class Room {
public:
  std::pmr::vector<double> series(std::size_t length) { return std::pmr::vector<double>(length, &memory_); }

private:
  std::array<std::byte, 8192> bytes_;
  std::pmr::monotonic_buffer_resource memory_{bytes_.data(), bytes_.size()};
};

/// What the standard library refuses by an exception is undefined here.
template <typename Function>
double or_undefined(Function function) {
  try {
    return function();
  } catch (const std::exception&) {
    return undefined;
  }
}

/// f'' = -2 x f'.
void expand_erf(double x, std::span<double> f) {
  f[0] = std::erf(x);
  if (f.size() > 1) {
    f[1] = two_over_root_pi * std::exp(-x * x);
  }
  for (std::size_t k = 2; k < f.size(); ++k) {
    const auto j = static_cast<double>(k);
    f[k] = -2.0 * (x * (j - 1.0) * f[k - 1] + (k > 2 ? (j - 2.0) * f[k - 2] : 0.0)) / (j * (j - 1.0));
  }
}

/// All derivatives are e^x.
void expand_expm1(double x, std::span<double> f) {
  f[0] = std::expm1(x);
  double coefficient = std::exp(x);
  for (std::size_t k = 1; k < f.size(); ++k) {
    coefficient /= static_cast<double>(k);
    f[k] = coefficient;
  }
}

/// (-1)^{k-1} / (k (1 + x)^k).
void expand_log1p(double x, std::span<double> f) {
  f[0] = x > -1.0 ? std::log1p(x) : undefined;
  double power = -1.0;
  for (std::size_t k = 1; k < f.size(); ++k) {
    power /= -(1.0 + x);
    f[k] = power / static_cast<double>(k);
  }
}

/// 2 f_n' = a f_{n-1} + b f_{n+1}, taken k times: 2^k f_n^(k) = Σ_j binomial(k, j) a^{k-j} b^j f_{n-k+2j}.
void expand_bessel(double (*function)(double, double), double a, double b, double n, double x, std::span<double> f) {
  const std::size_t orders = f.size();
  Room room;
  auto values = room.series(2 * orders - 1);  // f_{n-orders+1} …
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = function(n - static_cast<double>(orders - 1) + static_cast<double>(i), x);
  }
  double factor = 1.0;  // 1/(2^k k!)
  for (std::size_t k = 0; k < orders; ++k) {
    double sum = 0.0;
    double weight = std::pow(a, static_cast<double>(k));
    for (std::size_t j = 0; j <= k; ++j) {
      sum += weight * values[orders - 1 - k + 2 * j];
      weight *= b / a * static_cast<double>(k - j) / static_cast<double>(j + 1);
    }
    f[k] = factor * sum;
    factor /= 2.0 * static_cast<double>(k + 1);
  }
}

/// sn' = cn dn, cn' = -sn dn, dn' = -m sn cn; am' = dn.
void expand_jacobi(OpCode function, double m, double u, std::span<double> f) {
  const std::size_t orders = f.size();
  Room room;
  auto s = room.series(orders), c = room.series(orders), d = room.series(orders);
  const Jacobi value = jacobi(u, m);
  s[0] = value.sn;
  c[0] = value.cn;
  d[0] = value.dn;
  for (std::size_t k = 0; k + 1 < orders; ++k) {
    double cd = 0.0, sd = 0.0, sc = 0.0;
    for (std::size_t j = 0; j <= k; ++j) {
      cd += c[j] * d[k - j];
      sd += s[j] * d[k - j];
      sc += s[j] * c[k - j];
    }
    const auto next = static_cast<double>(k + 1);
    s[k + 1] = cd / next;
    c[k + 1] = -sd / next;
    d[k + 1] = -m * sc / next;
  }
  if (function == OpCode::jacobi_am) {
    f[0] = amplitude(u, m);
    for (std::size_t k = 1; k < orders; ++k) {
      f[k] = d[k - 1] / static_cast<double>(k);
    }
    return;
  }
  const auto& wanted = function == OpCode::jacobi_sn ? s : function == OpCode::jacobi_cn ? c : d;
  std::copy(wanted.begin(), wanted.end(), f.begin());
}

struct CompleteIntegrals {
  double k, e;
};

/// By arithmetic and geometric means a, g of 1 and √(1 - m): K = π/(2a), E = K (1 - Σ 2^{n-1} c_n²) with c_0² = m,
/// c_n = (a_{n-1} - g_{n-1})/2 (Abramowitz and Stegun, 17.6).
CompleteIntegrals complete_integrals(double m) {
  if (!(m >= 0.0 && m <= 1.0)) {
    return {undefined, undefined};
  }
  double a = 1.0, g = std::sqrt(1.0 - m), weight = 0.5, sum = 0.5 * m;
  constexpr double near_enough = 1e-9;  // the next difference is below its square
  while (g > 0.0 && std::abs(a - g) > near_enough * a) {
    const double c = 0.5 * (a - g);
    weight *= 2.0;
    sum += weight * c * c;
    const double mean = 0.5 * (a + g);
    g = std::sqrt(a * g);
    a = mean;
  }
  const double k = g > 0.0 ? std::numbers::pi / (a + g) : std::numeric_limits<double>::infinity();
  return {k, k * (1.0 - sum)};
}

/// (-1)^n.
double parity(double n) {
  return std::fmod(n, 2.0) == 0.0 ? 1.0 : -1.0;
}

}  // namespace

bool is_bessel_order(double n) {
  return n == std::round(n) && std::abs(n) <= largest_order;
}

double bessel_j(double n, double x) {
  return ::jn(static_cast<int>(n), x);
}
double bessel_y(double n, double x) {
  return x > 0.0 ? ::yn(static_cast<int>(n), x) : undefined;
}
double bessel_i(double n, double x) {
  const double sign = x < 0.0 ? parity(n) : 1.0;
  return or_undefined([&] { return sign * std::cyl_bessel_i(std::abs(n), std::abs(x)); });
}
double bessel_k(double n, double x) {
  return x > 0.0 ? or_undefined([&] { return std::cyl_bessel_k(std::abs(n), x); }) : undefined;
}

Jacobi jacobi(double u, double m) {
  if (!(m >= 0.0 && m <= 1.0) || !std::isfinite(u)) {
    return {undefined, undefined, undefined};
  }
  if (m == 1.0) {
    const double secant = 1.0 / std::cosh(u);
    return {std::tanh(u), secant, secant};
  }
  // The arithmetic and geometric means converge quadratically: a difference of 1e-8 is the last but rounding.
  constexpr double near_enough = 1e-8;
  std::array<double, 16> a{}, g{};
  std::size_t count = 0;
  double mean = 1.0, root = 1.0 - m, c = 1.0;
  for (; count < a.size();) {
    a[count] = mean;
    root = std::sqrt(root);
    g[count] = root;
    c = 0.5 * (mean + root);
    ++count;
    if (std::abs(mean - root) <= near_enough * mean) {
      break;
    }
    root *= mean;
    mean = c;
  }
  u *= c;
  const double sine = std::sin(u), cosine = std::cos(u);
  if (sine == 0.0) {
    return {sine, cosine, 1.0};
  }
  double ratio = cosine / sine;  // cs, from the last transformation back to the first
  double dn = 1.0;
  c *= ratio;
  for (std::size_t i = count; i-- > 0;) {
    ratio *= c;
    c *= dn;
    dn = (g[i] + ratio) / (a[i] + ratio);
    ratio = c / a[i];
  }
  const double sn = std::copysign(1.0 / std::sqrt(c * c + 1.0), sine);
  return {sn, c * sn, dn};
}

double amplitude(double u, double m) {
  const Jacobi at = jacobi(u, m);
  const double angle = std::atan2(at.sn, at.cn);
  const double quarter = elliptic_k(m);  // infinite for m = 1, where there is one branch
  // am - πu/2K has the period 2K and stays below π/2, which shows the branch.
  constexpr double turn = 2.0 * std::numbers::pi;
  return std::isfinite(quarter) ? angle + turn * std::round((0.25 * u / quarter) - angle / turn) : angle;
}

double elliptic_k(double m) {
  return complete_integrals(m).k;
}
double elliptic_e(double m) {
  return m == 1.0 ? 1.0 : complete_integrals(m).e;
}

void scaled_derivatives(OpCode function, double parameter, double x, std::span<double> coefficients) {
  switch (function) {
    case OpCode::erf: return expand_erf(x, coefficients);
    case OpCode::expm1: return expand_expm1(x, coefficients);
    case OpCode::log1p: return expand_log1p(x, coefficients);
    case OpCode::floor:
      std::ranges::fill(coefficients, 0.0);
      coefficients[0] = std::floor(x);
      return;
    case OpCode::bessel_j: return expand_bessel(bessel_j, 1.0, -1.0, parameter, x, coefficients);
    case OpCode::bessel_y: return expand_bessel(bessel_y, 1.0, -1.0, parameter, x, coefficients);
    case OpCode::bessel_i: return expand_bessel(bessel_i, 1.0, 1.0, parameter, x, coefficients);
    case OpCode::bessel_k: return expand_bessel(bessel_k, -1.0, -1.0, parameter, x, coefficients);
    case OpCode::jacobi_sn:
    case OpCode::jacobi_cn:
    case OpCode::jacobi_dn:
    case OpCode::jacobi_am: return expand_jacobi(function, parameter, x, coefficients);
    default: throw std::logic_error("scaled_derivatives: not one of its functions");
  }
}

}  // namespace rubato::formula
