// The tableau of Gauss collocation.

#include <cmath>
#include <complex>
#include <limits>

#include <Eigen/LU>
#include <catch2/catch.hpp>

#include <rubato/variation/gauss_tableau.hpp>

using namespace rubato;

TEST_CASE("the eigenvalues of the inverse Gauss tableau are the zeros of the stability function's denominator") {
  for (int m = 1; m <= GaussTableau::most_stages; ++m) {
    const GaussTableau tableau(m);
    const Eigen::MatrixXcd inverse = tableau.a.inverse().cast<std::complex<double>>();
    std::complex<double> sum = 0.0, product = 1.0;
    for (const std::complex<double>& lambda : tableau.inverse_eigenvalues()) {
      CHECK(lambda.real() > 0.0);
      sum += lambda;
      product *= lambda;
      // det(A⁻¹ - λ) vanishes: beside its size a little off, |λ|/10 as an example.
      const auto determinant = [&](std::complex<double> at) {
        return std::abs((inverse - at * Eigen::MatrixXcd::Identity(m, m)).determinant());
      };
      CHECK(determinant(lambda) < 1e-8 * determinant(lambda * 1.1));
    }
    CHECK(std::abs(sum - inverse.trace()) < 1e-10 * std::abs(sum));
    CHECK(std::abs(product - inverse.determinant()) < 1e-9 * std::abs(product));
  }
}

TEST_CASE("the Gauss tableau is symplectic far beyond double precision") {
  // Products of parts of 12 and 53 bits are exact in long double where these have 64 bits, so that nothing but the
  // rounding of the parts is left: 2^-65 of what are at most 1, in some sums. A defect d makes the energy drift by
  // about d a step; by monomials, d was 3e-16 with 8 stages, and the drift seen.
  static_assert(std::numeric_limits<long double>::digits >= 64);
  using Real = long double;
  const Real bound = 16.0L * std::ldexp(1.0L, -64);
  for (int m = 1; m <= GaussTableau::most_stages; ++m) {
    INFO(m << " stages");
    const GaussTableau t(m);
    const auto b = [&](int i) { return static_cast<Real>(t.b_short[i]) + static_cast<Real>(t.b_rest[i]); };
    const auto a = [&](int i, int j) { return static_cast<Real>(t.a_short(i, j)) + static_cast<Real>(t.a_rest(i, j)); };
    Real sum = 0.0L, defect = 0.0L, in_double = 0.0L;
    for (int i = 0; i < m; ++i) {
      sum += b(i);
      for (int j = 0; j < m; ++j) {
        defect = std::max(defect, std::abs(b(i) * a(i, j) + b(j) * a(j, i) - b(i) * b(j)));
        in_double = std::max(in_double, std::abs(static_cast<Real>(t.b[i]) * static_cast<Real>(t.a(i, j)) +
                                                 static_cast<Real>(t.b[j]) * static_cast<Real>(t.a(j, i)) -
                                                 static_cast<Real>(t.b[i]) * static_cast<Real>(t.b[j])));
      }
    }
    CHECK(std::abs(sum - 1.0L) <= bound);
    CHECK(defect <= bound);
    CHECK((m == 1 || in_double > bound));  // the twin: coefficients rounded to double are not
    // Conditions B(2m) and C(m): Σ b c^{k-1} = 1/k, Σ_j a_ij c_j^{k-1} = c_i^k/k, with c in double.
    for (int k = 1; k <= m; ++k) {
      Real moment = 0.0L;
      for (int i = 0; i < m; ++i) {
        moment += b(i) * std::pow(static_cast<Real>(t.c[i]), k - 1);
        Real stage = 0.0L;
        for (int j = 0; j < m; ++j) {
          stage += a(i, j) * std::pow(static_cast<Real>(t.c[j]), k - 1);
        }
        CHECK(std::abs(stage - std::pow(static_cast<Real>(t.c[i]), k) / k) <= 4e-16L);
      }
      CHECK(std::abs(moment - 1.0L / k) <= 4e-16L);
    }
  }
}

TEST_CASE("the inverse of the Gauss tableau and the weights of increments are told beyond double precision") {
  // Products and their sums in long double: what is left of A X - I is m roundings of |A||X|, 2^-64 of it each. A's
  // parts err by less.
  using Real = long double;
  for (int m = 1; m <= GaussTableau::most_stages; ++m) {
    INFO(m << " stages");
    const GaussTableau t(m);
    const GaussTableau::Inverse inverse = t.inverse();
    Real left = 0.0L, in_double = 0.0L, of_end = 0.0L, of_end_in_double = 0.0L;
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < m; ++j) {
        Real sum = i == j ? -1.0L : 0.0L, rounded = sum;
        for (int k = 0; k < m; ++k) {
          const Real a = static_cast<Real>(t.a_short(i, k)) + static_cast<Real>(t.a_rest(i, k));
          sum += a * (static_cast<Real>(inverse.value(k, j)) + static_cast<Real>(inverse.rest(k, j)));
          rounded += a * static_cast<Real>(inverse.value(k, j));
        }
        left = std::max(left, std::abs(sum));
        in_double = std::max(in_double, std::abs(rounded));
      }
      Real sum = -(static_cast<Real>(t.b_short[i]) + static_cast<Real>(t.b_rest[i])), rounded = sum;
      for (int j = 0; j < m; ++j) {
        const Real a = static_cast<Real>(t.a_short(j, i)) + static_cast<Real>(t.a_rest(j, i));
        sum += a * (static_cast<Real>(inverse.end[j]) + static_cast<Real>(inverse.end_rest[j]));
        rounded += a * static_cast<Real>(inverse.end[j]);
      }
      of_end = std::max(of_end, std::abs(sum));
      of_end_in_double = std::max(of_end_in_double, std::abs(rounded));
    }
    const Real bound = m * (t.a.cwiseAbs() * inverse.value.cwiseAbs()).maxCoeff() * std::ldexp(1.0L, -64);
    CHECK(left <= bound);
    CHECK(of_end <= bound);
    if (m > 2) {  // the twins; the inverse for one stage is 2
      CHECK(in_double > bound);
      CHECK(of_end_in_double > 0.0L);
    }
  }
}
