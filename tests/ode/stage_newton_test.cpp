#include <rubato/ode/stage_newton.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <random>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/step_matrix.hpp>

using Eigen::Index;
using Eigen::MatrixXd;
using namespace rubato;

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

/// Entries of a chain's Hessian, the degrees of freedom numbered at random; in a row further than the first from each
/// one of them nothing.
MatrixXd random_chain(Index degrees, std::mt19937& random) {
  MatrixXd A = random_symmetric(2 * degrees, random);
  std::vector<Index> order(static_cast<std::size_t>(degrees));
  std::iota(order.begin(), order.end(), Index{0});
  std::ranges::shuffle(order, random);
  for (Index i = 0; i < A.rows(); ++i) {
    for (Index j = 0; j < A.cols(); ++j) {
      const Index a = order[static_cast<std::size_t>(i % degrees)], b = order[static_cast<std::size_t>(j % degrees)];
      if (std::abs(a - b) > 1) {
        A(i, j) = 0.0;
      }
    }
  }
  return A;
}

/// ½ zᵀ A z.
Hamiltonian quadratic(const MatrixXd& A) {
  return Hamiltonian(static_cast<std::size_t>(A.rows() / 2), [&](const auto& q, const auto& p) {
    auto z = q;
    z.insert(z.end(), p.begin(), p.end());
    auto sum = 0.0 * z[0];
    for (Index i = 0; i < A.rows(); ++i) {
      for (Index j = 0; j <= i; ++j) {
        if (A(i, j) != 0.0) {
          sum += (i == j ? 0.5 : 1.0) * A(i, j) * z[static_cast<std::size_t>(i)] * z[static_cast<std::size_t>(j)];
        }
      }
    }
    return sum;
  });
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

TEST_CASE("corrections of the stages solve the equations of all stages at once, whole or within a band") {
  std::mt19937 random(20261123);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int stages = 1; stages <= GaussTableau::most_stages; ++stages) {
    const GaussTableau tableau(stages);
    for (const Index size : {2, 4, 12, 36, 62}) {
      const bool is_chain = size == 62;
      INFO(stages << " stages, " << size << " components");
      const MatrixXd hessian = is_chain ? random_chain(size / 2, random) : random_symmetric(size, random);
      const Hamiltonian H = quadratic(hessian);
      CHECK(HessianBand::of(H).has_value() == is_chain);
      const double h = 0.3;
      StageNewton::Rows r(size, stages);
      for (double& value : r.reshaped()) {
        value = uniform(random);
      }
      std::optional<StageNewton> newton = StageNewton::of(tableau, H);
      REQUIRE(newton);
      HamiltonianEvaluator evaluator(H);
      const std::vector<double> anywhere(static_cast<std::size_t>(size), 0.5);
      REQUIRE(newton->factor(evaluator, anywhere.data(), h) == Status::success);
      StageNewton::Rows delta = r;
      newton->solve(delta);
      // What the basis misses of A⁻¹ (the eigenvectors are nearly dependent) enters each
      // stage from all, and so does the rounding of V⁻¹r and of Vw.
      const double size_of_r = std::max(1.0, delta.cwiseAbs().maxCoeff());
      const double bound = static_cast<double>(stages) * size_of_r * (missed(tableau) + roundings(tableau, size));
      CHECK(left_over(tableau, h, hessian, r, delta) <= bound);
      // The twin: of another step they do not.
      CHECK(left_over(tableau, 1.001 * h, hessian, r, delta) > 1e3 * bound);
      CHECK((size == 2 || newton->factor_operations() > newton->solve_operations()));
    }
  }
}

TEST_CASE("the matrix of a midpoint step is the same within its band") {
  std::mt19937 random(7);
  const MatrixXd hessian = random_chain(40, random);
  const Hamiltonian H = quadratic(hessian);
  std::optional<HessianBand> band = HessianBand::of(H);
  REQUIRE(band);
  CHECK(band->width == 3);
  BandStepMatrix within(*std::move(band));
  DenseStepMatrix<Eigen::Dynamic> whole(H);
  HamiltonianEvaluator evaluator(H);
  const std::vector<double> anywhere(80, 0.5);
  REQUIRE(within.factor(evaluator, anywhere.data(), 0.3) == Status::success);
  REQUIRE(whole.factor(evaluator, anywhere.data(), 0.3) == Status::success);
  CHECK(std::abs(within.stiffness() - whole.stiffness()) <= 80 * epsilon * whole.stiffness());
  Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(80, -1.0, 2.0), y = x;
  within.solve(x.data());
  whole.solve(y.data());
  // Elimination is backward stable: what two kinds of it differ by is a few roundings times the condition, which of
  // I - A with ‖A‖ < 1 is small.
  const double bound = 80 * 80 * epsilon * y.norm();
  CHECK((x - y).norm() <= bound);
  REQUIRE(within.factor(evaluator, anywhere.data(), 0.3003) == Status::success);
  x = Eigen::VectorXd::LinSpaced(80, -1.0, 2.0);
  within.solve(x.data());
  CHECK((x - y).norm() > 1e3 * bound);  // the twin: another step
}

TEST_CASE("a Hessian that is not finite is told, and too many components that all meet have no matrix") {
  const GaussTableau tableau(3);
  const Hamiltonian H({"q"}, {"p"}, "p^2/2 + log(q)");
  std::optional<StageNewton> newton = StageNewton::of(tableau, H);
  HamiltonianEvaluator evaluator(H);
  const std::vector<double> outside = {-1.0, 0.0}, at_pole = {0.0, 0.0};
  CHECK(newton->factor(evaluator, at_pole.data(), 0.1) == Status::undefined);
  CHECK(newton->factor(evaluator, outside.data(), 0.1) == Status::success);  // -1/q² is finite there
  const std::size_t most = static_cast<std::size_t>(StageNewton::most_components) / 2;
  const auto meeting = [](std::size_t n) {
    return Hamiltonian(n, [](const auto& q, const auto& p) {
      auto sum = q[0] + p[0];
      for (std::size_t i = 1; i < q.size(); ++i) {
        sum += q[i] + p[i];
      }
      return sum * sum;
    });
  };
  CHECK(StageNewton::of(tableau, meeting(8)));
  CHECK_FALSE(StageNewton::of(tableau, meeting(most + 1)));
}
