#include <catch2/catch.hpp>

#include <cmath>
#include <stdexcept>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <rubato/ode/darboux.hpp>

#include "matrices.hpp"

namespace {

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;

/// (I - M)⁻¹(I + M) with M = ½·size·J·(symmetric): the Cayley transform of a Hamiltonian matrix is symplectic.
MatrixXd random_symplectic(Index n, unsigned seed, double size) {
  const MatrixXd M = 0.5 * size * symplectic_unit(n) * random_symmetric(2 * n, seed);
  const MatrixXd I = MatrixXd::Identity(2 * n, 2 * n);
  return (I - M).lu().solve(I + M);
}

double largest(const MatrixXd& m) {
  return m.cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("the normal Darboux matrices are Darboux matrices, and (4.5) inverts them") {
  for (const Index n : {1, 2, 5}) {
    for (const MatrixXd& F : {darboux_symmetric(DarbouxType::midpoint, n), darboux_symmetric(DarbouxType::euler_a, n),
                              darboux_symmetric(DarbouxType::euler_b, n), random_symmetric(2 * n, 7)}) {
      MatrixXd alpha = normal_darboux(F);
      CHECK(is_darboux(alpha));  // (4.2)
      // (4.5): products of sums of 2n terms of order 1.
      CHECK(largest(alpha * normal_darboux_inverse(F) - MatrixXd::Identity(4 * n, 4 * n)) <= 1e-14 * double(n));
      CHECK(largest(alpha.leftCols(2 * n) + alpha.rightCols(2 * n) -
                    (MatrixXd(4 * n, 2 * n) << MatrixXd::Zero(2 * n, 2 * n), MatrixXd::Identity(2 * n, 2 * n))
                        .finished()) <= 1e-15);  // normal: A + B = 0, C + D = I
      alpha(2 * n, 0) += 1e-6;
      CHECK_FALSE(is_darboux(alpha));
    }
    // (4.6)
    const MatrixXd half = 0.5 * MatrixXd::Identity(2 * n, 2 * n);
    const MatrixXd alpha = normal_darboux(darboux_symmetric(DarbouxType::midpoint, n));
    CHECK(alpha.bottomLeftCorner(2 * n, 2 * n) == half);
    CHECK(alpha.bottomRightCorner(2 * n, 2 * n) == half);
  }
  CHECK_FALSE(is_darboux(MatrixXd::Identity(4, 4)));
  CHECK_FALSE(is_darboux(MatrixXd::Identity(6, 6)));
}

TEST_CASE("the Euler types read the new coordinates with the old momenta, or the other way round") {
  // w = Eẑ + (I - E)z, E = (I + JF)/2.
  const MatrixXd a = normal_darboux(darboux_symmetric(DarbouxType::euler_a, 1));
  CHECK(a.bottomRows(2) == (MatrixXd(2, 4) << 1, 0, 0, 0, 0, 0, 0, 1).finished());  // (q̂, p)
  const MatrixXd b = normal_darboux(darboux_symmetric(DarbouxType::euler_b, 1));
  CHECK(b.bottomRows(2) == (MatrixXd(2, 4) << 0, 0, 1, 0, 0, 1, 0, 0).finished());  // (q, p̂)
}

TEST_CASE("the fractional transform and its inverse are inverse to each other") {
  for (const Index n : {1, 2, 4}) {
    const MatrixXd F = random_symmetric(2 * n, 3);
    for (const MatrixXd& type : {MatrixXd(MatrixXd::Zero(2 * n, 2 * n)), F}) {
      const MatrixXd alpha = normal_darboux(type);
      for (unsigned seed = 1; seed <= 10; ++seed) {
        const MatrixXd S = random_symplectic(n, seed, 0.2);
        const MatrixXd M = fractional_transform(alpha, S);
        CHECK(largest(M - M.transpose()) <= 1e-13);
        CHECK(largest(M) > 1e-2);
        const MatrixXd back = inverse_fractional_transform(alpha, M);
        CHECK(largest(back - S) <= 1e-13);
        CHECK(is_symplectic(back));
        CHECK(largest(fractional_transform(alpha, back) - M) <= 1e-13);
        // The twin: the inverse by another type is another matrix.
        CHECK(largest(inverse_fractional_transform(normal_darboux(2.0 * F), M) - S) > 1e-6);
      }
      CHECK(largest(fractional_transform(alpha, MatrixXd::Identity(2 * n, 2 * n))) == 0.0);
      // The inverse of α follows from (4.2) for any Darboux matrix; for a normal one it is (4.5).
      const MatrixXd M = 0.1 * F;
      const MatrixXd inverse = normal_darboux_inverse(type);
      const auto block = [&](Index i, Index j) { return inverse.block(2 * n * i, 2 * n * j, 2 * n, 2 * n); };
      const MatrixXd expected = (block(0, 0) * M + block(0, 1)) * (block(1, 0) * M + block(1, 1)).inverse();
      CHECK(largest(inverse_fractional_transform(alpha, M) - expected) <= 1e-13);
    }
  }
}

TEST_CASE("fractional transforms are refused outside their domain") {
  const MatrixXd zero = MatrixXd::Zero(2, 2);
  const MatrixXd alpha = normal_darboux(zero);
  // For F = 0, CS + D = (S + I)/2: singular at S = -I, which is symplectic.
  CHECK_THROWS_WITH(fractional_transform(alpha, -MatrixXd::Identity(2, 2)), Catch::Contains("CS + D is singular"));
  CHECK_THROWS_WITH(fractional_transform(alpha, 2.0 * MatrixXd::Identity(2, 2)), Catch::Contains("symplectic"));
  CHECK_THROWS_WITH(fractional_transform(MatrixXd::Identity(4, 4), MatrixXd::Identity(2, 2)),
                    Catch::Contains("Darboux matrix"));
  CHECK_THROWS_WITH(fractional_transform(alpha, MatrixXd::Identity(4, 4)), Catch::Contains("4×4"));
  CHECK_THROWS_WITH(inverse_fractional_transform(alpha, (MatrixXd(2, 2) << 0, 1, 2, 0).finished()),
                    Catch::Contains("symmetric"));
  // C₁M + D₁ = ½JM + I: singular for M = diag(2, -2).
  CHECK_THROWS_WITH(inverse_fractional_transform(alpha, (MatrixXd(2, 2) << 2, 0, 0, -2).finished()),
                    Catch::Contains("singular"));
  CHECK_THROWS_WITH(normal_darboux((MatrixXd(2, 2) << 0, 1, 2, 0).finished()), Catch::Contains("(1, 2) is 1"));
  CHECK_THROWS_WITH(normal_darboux(MatrixXd::Zero(3, 3)), Catch::Contains("3×3"));
  CHECK_THROWS_WITH(check_darboux_symmetric(MatrixXd::Zero(4, 4), 1), Catch::Contains("2×2 matrix F; got 4×4"));
  CHECK_THROWS_AS(normal_darboux(MatrixXd::Constant(2, 2, std::nan(""))), std::invalid_argument);
}

TEST_CASE("the parasite's matrix is an involution's sign for F = 0, bounded for definite F, absent for Euler types") {
  CHECK(parasite_matrix(MatrixXd::Zero(4, 4)) == -MatrixXd::Identity(4, 4));
  const auto growth = [](const MatrixXd& F) { return parasite_matrix(F).eigenvalues().cwiseAbs().maxCoeff(); };
  const MatrixXd root = random_symmetric(4, 5);
  CHECK(growth(root * root + MatrixXd::Identity(4, 4)) == Approx(1.0).epsilon(1e-12));
  CHECK(growth(random_symmetric(4, 11)) > 1.1);
  CHECK_THROWS_WITH(parasite_matrix(darboux_symmetric(DarbouxType::euler_a, 2)), Catch::Contains("singular"));
  CHECK_THROWS_WITH(parasite_matrix(darboux_symmetric(DarbouxType::euler_b, 1)), Catch::Contains("starting pair"));
}
