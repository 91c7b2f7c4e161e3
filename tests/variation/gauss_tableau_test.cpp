// The tableau of Gauss collocation.

#include <cmath>
#include <complex>

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
