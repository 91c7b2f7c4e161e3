// Smallest singular values of sparse matrices, against matrices that are built with known ones.

#include <catch2/catch.hpp>

#include <cmath>

#include <rubato/solve/singular_vectors.hpp>

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using namespace rubato;

namespace {

/// Products of reflections: orthogonal.
MatrixXd orthogonal(Index size, double seed) {
  MatrixXd Q = MatrixXd::Identity(size, size);
  for (Index k = 0; k < 3; ++k) {
    VectorXd v(size);
    for (Index i = 0; i < size; ++i) {
      v[i] = std::sin(seed * static_cast<double>(i + 1) + static_cast<double>(k));
    }
    Q -= 2.0 / v.squaredNorm() * (Q * v) * v.transpose();
  }
  return Q;
}

/// U Σ Vᵀ.
MatrixXd with_values(Index rows, Index columns, const VectorXd& values) {
  MatrixXd sigma = MatrixXd::Zero(rows, columns);
  sigma.diagonal() = values;
  return orthogonal(rows, 1.3) * sigma * orthogonal(columns, 2.1).transpose();
}

}  // namespace

TEST_CASE("singular vectors: the smallest values of matrices of any shape and rank, and what they leave of a vector") {
  constexpr Index size = 12;
  VectorXd values(size);
  for (Index i = 0; i < size; ++i) {
    values[i] = std::exp2(-static_cast<double>(i));
  }
  values[size - 2] = 1e-6;
  values[size - 1] = 0.0;
  for (const Index more_columns : {-2, 0, 2}) {
    CAPTURE(more_columns);
    const MatrixXd J =
        with_values(size + std::max<Index>(0, -more_columns), size + std::max<Index>(0, more_columns), values);
    const auto found = solve::smallest_singular_vectors(J.sparseView(), 6);
    REQUIRE(found);
    const Index zeros = 1 + std::max<Index>(0, more_columns);  // one for each column beyond the rows
    for (Index i = 0; i < zeros; ++i) {
      CHECK(found->values[i] < 1e-14);
    }
    CHECK(found->values[zeros] == Approx(1e-6).epsilon(1e-8));  // rounding errors of J beside it
    for (Index i = 0; i < 6; ++i) {
      const VectorXd v = found->vectors.col(i);
      CHECK(v.norm() == Approx(1.0).epsilon(1e-14));
      CHECK((J * v).norm() == Approx(found->values[i]).margin(1e-14));
    }
    // Twin: with the value of a regular matrix there is none.
    VectorXd regular = values;
    regular[size - 1] = 1e-5;
    const auto other = solve::smallest_singular_vectors(with_values(size, size, regular).sparseView(), 6);
    REQUIRE(other);
    CHECK(other->values[0] == Approx(1e-6).epsilon(1e-8));
  }
}
