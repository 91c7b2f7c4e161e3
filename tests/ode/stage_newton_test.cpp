#include <rubato/ode/stage_newton.hpp>

#include <algorithm>
#include <limits>
#include <random>

#include <catch2/catch.hpp>

using Eigen::Index;
using Eigen::MatrixXd;
using rubato::GaussTableau;
using rubato::StageNewton;
using rubato::Status;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

MatrixXd random_symmetric(Index size, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  MatrixXd A(size, size);
  for (double& value : A.reshaped()) {
    value = uniform(random);
  }
  return 0.5 * (A + A.transpose());
}

/// What δ leaves of (I - h A⊗B) δ = r, the largest entry.
double left_over(const GaussTableau& tableau, double h, const MatrixXd& hessian, const StageNewton::Rows& r,
                 const StageNewton::Rows& delta) {
  const Index n = hessian.rows() / 2;
  MatrixXd B(2 * n, 2 * n);
  B.topRows(n) = hessian.bottomRows(n);
  B.bottomRows(n) = -hessian.topRows(n);
  const MatrixXd slopes = B * delta;
  return (delta - h * slopes * tableau.a.transpose() - r).cwiseAbs().maxCoeff();
}

/// max |A V Λ V⁻¹ - I|.
double missed(const GaussTableau& tableau) {
  const GaussTableau::Eigenbasis basis = tableau.inverse_eigenbasis();
  const Eigen::MatrixXcd inverse = basis.V * basis.values.asDiagonal() * basis.V_inverse;
  return (tableau.a * inverse - Eigen::MatrixXcd::Identity(tableau.stages, tableau.stages)).cwiseAbs().maxCoeff();
}

/// Of products with V and V⁻¹, and of elimination among as many unknowns.
double roundings(const GaussTableau& tableau, Index size) {
  const GaussTableau::Eigenbasis basis = tableau.inverse_eigenbasis();
  return 8.0 * epsilon * static_cast<double>(size) * basis.V.cwiseAbs().maxCoeff() *
         basis.V_inverse.cwiseAbs().maxCoeff() * basis.values.cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("corrections of the stages solve the equations of all stages at once") {
  std::mt19937 random(20261123);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int stages = 1; stages <= GaussTableau::most_stages; ++stages) {
    const GaussTableau tableau(stages);
    for (const Index size : {2, 4, 12, 36}) {
      INFO(stages << " stages, " << size << " components");
      const MatrixXd hessian = random_symmetric(size, random);
      const double h = 0.3;
      StageNewton::Rows r(size, stages);
      for (double& value : r.reshaped()) {
        value = uniform(random);
      }
      StageNewton newton(tableau, size);
      REQUIRE(newton.factor(h, hessian) == Status::success);
      StageNewton::Rows delta = r;
      newton.solve(delta);
      // What the basis misses of A⁻¹ (the eigenvectors are nearly dependent) enters each
      // stage from all, and so does the rounding of V⁻¹r and of Vw.
      const double size_of_r = std::max(1.0, delta.cwiseAbs().maxCoeff());
      const double bound = static_cast<double>(stages) * size_of_r * (missed(tableau) + roundings(tableau, size));
      CHECK(left_over(tableau, h, hessian, r, delta) <= bound);
      // The twin: of another step they do not.
      CHECK(left_over(tableau, 1.001 * h, hessian, r, delta) > 1e3 * bound);
      CHECK((size == 2 || newton.factor_operations() > newton.solve_operations()));
    }
  }
}

TEST_CASE("a Hessian that is not finite is told, and too many components are refused") {
  const GaussTableau tableau(3);
  StageNewton newton(tableau, 2);
  MatrixXd hessian = MatrixXd::Identity(2, 2);
  hessian(0, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(newton.factor(0.1, hessian) == Status::undefined);
  CHECK_THROWS_AS(StageNewton(tableau, StageNewton::most_components + 1), std::invalid_argument);
}
