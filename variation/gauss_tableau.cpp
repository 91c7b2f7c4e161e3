#include <rubato/variation/gauss_tableau.hpp>

#include <array>
#include <cmath>
#include <mutex>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/lagrange_weight.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/legendre.hpp>

namespace rubato {

namespace {

using Real = long double;
using Polynomial = std::vector<Real>;  // coefficients, constant first

/// The roots of the Legendre polynomial of degree m on [0, 1], ascending, by Newton's method on its recurrence.
std::vector<Real> nodes(int m) {
  std::vector<Real> c;
  for (int i = 0; i < m; ++i) {
    Real x = -std::cos(3.14159265358979323846L * (i + 0.75L) / (m + 0.5L));
    for (int iteration = 0; iteration < 100; ++iteration) {
      const Legendre P(m, x);
      const Real change = P.value / P.slope();
      x -= change;
      if (std::abs(change) < 1e-19L) {
        break;
      }
    }
    c.push_back(0.5L * (1.0L + x));
  }
  if (m % 2 == 1) {
    c[static_cast<std::size_t>(m / 2)] = 0.5L;
  }
  return c;
}

/// ℓ_j(origin + σ) as a polynomial in σ.
Polynomial lagrange_polynomial(const std::vector<Real>& c, std::size_t j, Real origin) {
  Polynomial result = {1.0L};
  for (std::size_t i = 0; i < c.size(); ++i) {
    if (i == j) {
      continue;
    }
    const Real scale = 1.0L / (c[j] - c[i]);
    const Real constant = (origin - c[i]) * scale;
    Polynomial next(result.size() + 1, 0.0L);
    for (std::size_t k = 0; k < result.size(); ++k) {
      next[k] += constant * result[k];
      next[k + 1] += scale * result[k];
    }
    result = std::move(next);
  }
  return result;
}

/// Coefficients p_k of ∫_origin^{origin+σ} = Σ p_k σ^{k+1}.
Polynomial integral(const Polynomial& polynomial) {
  Polynomial result;
  for (std::size_t k = 0; k < polynomial.size(); ++k) {
    result.push_back(polynomial[k] / static_cast<Real>(k + 1));
  }
  return result;
}

/// b_j = ∫₀¹ ℓ_j = 1/((1 - x²) P'_m(x)²) at x = 2c_j - 1, where (1 - x²) P'_m = m P_{m-1}.
std::vector<Real> quadrature_weights(const std::vector<Real>& c) {
  const int m = static_cast<int>(c.size());
  std::vector<Real> b;
  for (const Real node : c) {
    const Real square = 4.0L * node * (1.0L - node);  // 1 - x², and nothing cancels
    const Real slope = m * Legendre(m, 2.0L * node - 1.0L).before / square;
    b.push_back(1.0L / (square * slope * slope));
  }
  return b;
}

/// a_ij = ∫₀^{c_i} ℓ_j by the quadrature itself, which is exact for it (the polynomial's coefficients are up to 1e6
/// times as large as ℓ_j). What rounding leaves of the condition of symplecticity, that b_i a_ij + b_j a_ji is b_i b_j,
/// is taken out then: it would make the energy drift by as much in every step.
std::vector<std::vector<Real>> stage_weights(const std::vector<Real>& c, const std::vector<Real>& b) {
  const std::size_t m = c.size();
  std::vector<std::vector<Real>> a(m, std::vector<Real>(m, 0.0L));
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t j = 0; j < m; ++j) {
      for (std::size_t k = 0; k < m; ++k) {
        a[i][j] += b[k] * lagrange_weight(j, m, c[i] * c[k], [&](std::size_t at) { return c[at]; });
      }
      a[i][j] *= c[i];
    }
  }
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      const Real left = b[i] * a[i][j] + b[j] * a[j][i] - b[i] * b[j];
      a[i][j] -= 0.5L * left / b[i];
      if (i != j) {
        a[j][i] -= 0.5L * left / b[j];
      }
    }
  }
  return a;
}

/// `value` in two parts, the first with 12 bits.
void split(Real value, double& brief, double& rest) {
  constexpr Real scale = 4096.0L;
  brief = static_cast<double>(std::round(value * scale) / scale);
  rest = static_cast<double>(value - static_cast<Real>(brief));
}

}  // namespace

GaussTableau::GaussTableau(int count) : stages(count) {
  if (count < 1 || count > most_stages) {
    throw std::invalid_argument(
        fmt::format("the number of Gauss stages has to be between 1 and {}; got {}", most_stages, count));
  }
  for (Eigen::VectorXd* vector : {&c, &b, &b_short, &b_rest}) {
    vector->setZero(count);
  }
  for (Eigen::MatrixXd* matrix : {&a, &a_short, &a_rest, &from_start, &from_end}) {
    matrix->setZero(count, count);
  }
  const std::vector<Real> node = nodes(count), weight = quadrature_weights(node);
  const std::vector<std::vector<Real>> entry = stage_weights(node, weight);
  for (int j = 0; j < count; ++j) {
    const auto at = static_cast<std::size_t>(j);
    const Polynomial start = integral(lagrange_polynomial(node, at, 0.0L)),
                     end = integral(lagrange_polynomial(node, at, 1.0L));
    c[j] = static_cast<double>(node[at]);
    split(weight[at], b_short[j], b_rest[j]);
    b[j] = b_short[j] + b_rest[j];
    for (int i = 0; i < count; ++i) {
      const auto row = static_cast<std::size_t>(i);
      split(entry[row][at], a_short(i, j), a_rest(i, j));
      a(i, j) = a_short(i, j) + a_rest(i, j);
      from_start(i, j) = static_cast<double>(start[row]);
      from_end(i, j) = static_cast<double>(end[row]);
    }
  }
}

GaussTableau::Square GaussTableau::square() const {
  const auto whole = [&](int i, int j) { return static_cast<Real>(a_short(i, j)) + static_cast<Real>(a_rest(i, j)); };
  Square result{Eigen::MatrixXd(stages, stages), Eigen::MatrixXd(stages, stages), Eigen::VectorXd(stages),
                Eigen::VectorXd(stages)};
  for (int i = 0; i < stages; ++i) {
    Real node = 0.0L;
    for (int j = 0; j < stages; ++j) {
      Real sum = 0.0L;
      for (int k = 0; k < stages; ++k) {
        sum += whole(i, k) * whole(k, j);
      }
      split(sum, result.a_short(i, j), result.a_rest(i, j));
      node += whole(i, j);  // as it is in A, so that A² and c belong to the same method
    }
    split(node, result.c_short[i], result.c_rest[i]);
  }
  return result;
}

std::vector<std::complex<double>> GaussTableau::inverse_eigenvalues() const {
  using Complex = std::complex<Real>;
  const int m = stages;
  // Divided by the leading coefficient.
  Polynomial coefficients(static_cast<std::size_t>(m) + 1, 1.0L);
  for (int j = m - 1; j >= 0; --j) {
    // c_j/c_{j+1} = -(j+1)(2m-j)/(m-j)
    coefficients[static_cast<std::size_t>(j)] =
        -coefficients[static_cast<std::size_t>(j) + 1] * (j + 1) * (2 * m - j) / (m - j);
  }
  // All zeros at once (Weierstrass, Durand, Kerner), from a circle about as large as they are.
  std::vector<Complex> zeros;
  for (int i = 0; i < m; ++i) {
    zeros.push_back(std::polar(static_cast<Real>(m) + 1.0L, 0.4L + 6.283185307179586477L * i / m));
  }
  for (int iteration = 0; iteration < 500; ++iteration) {
    for (std::size_t i = 0; i < zeros.size(); ++i) {
      Complex value = 0.0L, others = 1.0L;
      for (std::size_t j = coefficients.size(); j-- > 0;) {
        value = value * zeros[i] + coefficients[j];
      }
      for (std::size_t j = 0; j < zeros.size(); ++j) {
        others *= j == i ? 1.0L : zeros[i] - zeros[j];
      }
      zeros[i] -= value / others;
    }
  }
  std::vector<std::complex<double>> result;
  for (const Complex& zero : zeros) {
    result.emplace_back(static_cast<double>(zero.real()), static_cast<double>(zero.imag()));
  }
  return result;
}

namespace {

GaussTableau::Eigenbasis inverse_eigenbasis_of(const GaussTableau& tableau) {
  const int m = tableau.stages;
  const Eigen::MatrixXd inverse = tableau.inverse().value;
  const auto eigenvalues = tableau.inverse_eigenvalues();
  GaussTableau::Eigenbasis basis{Eigen::VectorXcd(m), Eigen::MatrixXcd(m, m), {}};
  for (int e = 0; e < m; ++e) {
    basis.values[e] = eigenvalues[static_cast<std::size_t>(e)];
    Eigen::MatrixXcd shifted = inverse.cast<std::complex<double>>();
    for (int i = 0; i < m; ++i) {
      shifted(i, i) -= basis.values[e];
    }
    basis.V.col(e) = solve::singular_values(shifted).vectors.col(m - 1);
  }
  basis.V_inverse = solve::inverse_of(basis.V).matrix;
  return basis;
}

}  // namespace

const GaussTableau::Eigenbasis& GaussTableau::inverse_eigenbasis() const {
  static std::array<std::once_flag, most_stages + 1> made;
  static std::array<Eigenbasis, most_stages + 1> bases;
  const auto number = static_cast<std::size_t>(stages);
  std::call_once(made[number], [&] { bases[number] = inverse_eigenbasis_of(*this); });
  return bases[number];
}

GaussTableau::Inverse GaussTableau::inverse() const {
  // X + X (I - A X), twice: each squares what is left, and the residual is taken in extended precision.
  const Eigen::MatrixXd start = solve::quotient(a, Eigen::MatrixXd::Identity(stages, stages)).value();
  using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
  const Matrix A = a_short.cast<Real>() + a_rest.cast<Real>();
  Matrix X = start.cast<Real>();
  for (int pass = 0; pass < 2; ++pass) {
    X += X * (Matrix::Identity(stages, stages) - A * X).eval();
  }
  const Matrix w = X.transpose() * (b_short.cast<Real>() + b_rest.cast<Real>());
  Inverse result{X.cast<double>(), {}, w.cast<double>(), {}};
  result.rest = (X - result.value.cast<Real>()).cast<double>();
  result.end_rest = (w - result.end.cast<Real>()).cast<double>();
  return result;
}

double GaussTableau::lagrange(int j, double x) const {
  return lagrange_weight(static_cast<std::size_t>(j), static_cast<std::size_t>(stages), x,
                         [this](std::size_t i) { return c[static_cast<Eigen::Index>(i)]; });
}

}  // namespace rubato
