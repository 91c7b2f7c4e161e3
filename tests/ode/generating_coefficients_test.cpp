// The coefficients of generating functions against (4.10) worked symbolically, in exact rational arithmetic.
#include <catch2/catch.hpp>

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include <ginac/ginac.h>

#include <rubato/ode/generating_function.hpp>

namespace {

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;
using GiNaC::ex;

/// A polynomial Hamiltonian in both languages, at a point of small rationals.
struct Problem {
  std::vector<GiNaC::symbol> z;  ///< q, then p
  ex H;
  int degree;
  Hamiltonian hamiltonian;
  std::vector<GiNaC::numeric> w;
};

Problem one_degree() {
  const GiNaC::symbol q("q"), p("p");
  return {{q, p},
          GiNaC::pow(p, 2) / 2 + GiNaC::pow(q, 2) / 2 + q * GiNaC::pow(p, 2) / 3 + GiNaC::pow(q, 3) * p / 4,
          4,
          Hamiltonian({"q"}, {"p"}, "p^2/2 + q^2/2 + q*p^2/3 + q^3*p/4"),
          {GiNaC::numeric(3, 4), GiNaC::numeric(-5, 8)}};
}

Problem two_degrees() {
  const GiNaC::symbol x("x"), y("y"), u("u"), v("v");
  return {{x, y, u, v},
          (x * x + y * y + u * u + v * v) / 2 + x * u * v - y * y * u / 3 + x * x * y / 2,
          3,
          Hamiltonian({"x", "y"}, {"u", "v"}, "(x^2 + y^2 + u^2 + v^2)/2 + x*u*v - y^2*u/3 + x^2*y/2"),
          {GiNaC::numeric(1, 2), GiNaC::numeric(-3, 8), GiNaC::numeric(1, 4), GiNaC::numeric(5, 8)}};
}

/// φ^1 … φ^count by
///
///     φ^{k+1} = -1/(k+1) Σ_m 1/m! Σ_{j_1+…+j_m=k} D^mH(v^{j_1}, …, v^{j_m}),   v^j = (E - I)J∇φ^j,
///
/// E = (I + JF)/2: (4.10) with the sign that follows from (4.5), in general. `sign` = -1 is what the paper prints.
std::vector<ex> symbolic_coefficients(const Problem& problem, const GiNaC::matrix& F, int count, int sign = 1) {
  const unsigned size = static_cast<unsigned>(problem.z.size());
  const unsigned n = size / 2;
  GiNaC::matrix J(size, size);
  for (unsigned i = 0; i < n; ++i) {
    J(i, n + i) = 1;
    J(n + i, i) = -1;
  }
  const GiNaC::matrix JF = J.mul(F);
  GiNaC::matrix E(size, size);  // E - I
  for (unsigned i = 0; i < size; ++i) {
    for (unsigned j = 0; j < size; ++j) {
      E(i, j) = (JF(i, j) - (i == j ? 1 : 0)) / 2 * sign;
    }
  }
  const GiNaC::matrix EJ = E.mul(J);

  std::vector<ex> phi = {0, (-problem.H).expand()};
  std::vector<std::vector<ex>> v = {{}};
  while (phi.size() <= static_cast<std::size_t>(count)) {
    std::vector<ex> row(size, 0);
    for (unsigned i = 0; i < size; ++i) {
      for (unsigned j = 0; j < size; ++j) {
        row[i] += EJ(i, j) * phi.back().diff(problem.z[j]);
      }
      row[i] = row[i].expand();
    }
    v.push_back(row);
    const int k = static_cast<int>(phi.size()) - 1;
    ex sum = 0;
    // Over all (i_1, j_1), …, (i_m, j_m) with Σ j = k: partial derivatives of H times entries of v.
    const std::function<void(const ex&, const ex&, int, int)> descend = [&](const ex& derivative, const ex& product,
                                                                            int rest, int m) {
      if (rest == 0) {
        sum += (derivative * product).expand() / GiNaC::factorial(m);
        return;
      }
      for (unsigned i = 0; i < size; ++i) {
        const ex next = derivative.diff(problem.z[i]);
        if (next.is_zero()) {
          continue;
        }
        for (int j = 1; j <= rest; ++j) {
          descend(next, (product * v[static_cast<std::size_t>(j)][i]).expand(), rest - j, m + 1);
        }
      }
    };
    descend(problem.H, 1, k, 0);
    phi.push_back((-sum / (k + 1)).expand());
  }
  return phi;
}

GiNaC::matrix exact(const MatrixXd& F) {
  GiNaC::matrix result(static_cast<unsigned>(F.rows()), static_cast<unsigned>(F.rows()));
  for (Index i = 0; i < F.rows(); ++i) {
    for (Index j = 0; j < F.cols(); ++j) {
      result(static_cast<unsigned>(i), static_cast<unsigned>(j)) =
          GiNaC::numeric(static_cast<int>(std::lround(8.0 * F(i, j))), 8);
    }
  }
  return result;
}

/// Eighths between -1 and 1.
MatrixXd random_eighths(Index size) {
  std::mt19937 random(17);
  std::uniform_int_distribution<int> eighths(-8, 8);
  MatrixXd F(size, size);
  for (Index i = 0; i < size; ++i) {
    for (Index j = 0; j <= i; ++j) {
      F(i, j) = F(j, i) = eighths(random) / 8.0;
    }
  }
  return F;
}

/// Largest difference of φ^j and ∇φ^j from the oracle, relative to |φ^j| and to the largest entry of ∇φ^j.
double relative_difference(const Problem& problem, const MatrixXd& F, const std::vector<ex>& phi) {
  const int count = static_cast<int>(phi.size()) - 1;
  GeneratingFunction generating(problem.hamiltonian, F, count);
  std::vector<double> w;
  GiNaC::exmap point;
  for (std::size_t i = 0; i < problem.w.size(); ++i) {
    w.push_back(problem.w[i].to_double());
    point[problem.z[i]] = problem.w[i];
  }
  REQUIRE(generating.expand(w) == Status::success);
  const auto at = [&](const ex& e) { return GiNaC::ex_to<GiNaC::numeric>(e.subs(point)).to_double(); };
  double worst = 0.0;
  for (int j = 1; j <= count; ++j) {
    const ex& exact_phi = phi[static_cast<std::size_t>(j)];
    const double value = at(exact_phi);
    const double difference = std::abs(generating.coefficient(j) - value);
    worst = std::max(worst, value == 0.0 ? difference : difference / std::abs(value));
    double scale = 0.0;
    double largest = 0.0;
    for (std::size_t i = 0; i < w.size(); ++i) {
      const double slope = at(exact_phi.diff(problem.z[i]));
      scale = std::max(scale, std::abs(slope));
      largest = std::max(largest, std::abs(generating.gradient(j)[i] - slope));
    }
    worst = std::max(worst, scale == 0.0 ? largest : largest / scale);
  }
  return worst;
}

}  // namespace

TEST_CASE("coefficients and gradients are those of (4.10), sign corrected") {
  constexpr int count = 7;
  for (const Problem& problem : {one_degree(), two_degrees()}) {
    const auto n = static_cast<Index>(problem.z.size() / 2);
    for (const MatrixXd& F : {darboux_symmetric(DarbouxType::midpoint, n), darboux_symmetric(DarbouxType::euler_a, n),
                              darboux_symmetric(DarbouxType::euler_b, n), random_eighths(2 * n)}) {
      INFO("n = " << n << ", F = " << F);
      const std::vector<ex> phi = symbolic_coefficients(problem, exact(F), count);
      // Each series coefficient is a sum of some hundred products; terms cancel by less than 1e3.
      CHECK(relative_difference(problem, F, phi) <= 1e-12);
      if (F.isZero(0.0)) {
        for (int j = 2; j <= count; j += 2) {
          CHECK(phi[static_cast<std::size_t>(j)].is_zero());
        }
      }
    }
  }
}

TEST_CASE("the sign printed in (4.10) is harmless for F = 0 and wrong otherwise") {
  const Problem problem = one_degree();
  const MatrixXd zero = MatrixXd::Zero(2, 2);
  CHECK(relative_difference(problem, zero, symbolic_coefficients(problem, exact(zero), 5, -1)) <= 1e-12);
  const MatrixXd F = darboux_symmetric(DarbouxType::euler_a, 1);
  CHECK(relative_difference(problem, F, symbolic_coefficients(problem, exact(F), 3, -1)) > 1e-2);
}

TEST_CASE("sums of the series are one function's value and derivatives") {
  const Hamiltonian hamiltonian({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2*(1 + x^2) - cos(x*y) + exp(y - u)");
  const std::vector<double> w = {0.3, -0.4, 0.5, 0.2};
  constexpr double h = 0.3;
  // Central differences at distance 1e-4 leave 1e-8 times third derivatives, and 1e-12 of rounding.
  constexpr double step = 1e-4;
  constexpr double tolerance = 1e-6;
  for (const MatrixXd& F : {darboux_symmetric(DarbouxType::midpoint, 2), random_eighths(4)}) {
    for (const int s : {1, 3, 6}) {
      GeneratingFunction generating(hamiltonian, F, 6);
      const auto expand_at = [&](std::size_t m, double by) {
        std::vector<double> moved = w;
        moved[m] += by;
        REQUIRE(generating.expand(moved) == Status::success);
      };
      Eigen::MatrixXd hessian(4, 4);
      REQUIRE(generating.hessian_sum(w, h, s, hessian) == Status::success);
      Eigen::VectorXd up(4), down(4), gradient(4), rate(4);
      expand_at(0, 0.0);
      generating.gradient_sum(h, s, gradient);
      generating.gradient_sum_rate(h, s, rate);
      generating.gradient_sum(h + step, s, up);
      generating.gradient_sum(h - step, s, down);
      CHECK((up - down - 2 * step * rate).cwiseAbs().maxCoeff() <= tolerance * step);
      CHECK((generating.sum(h + step, s) - generating.sum(h - step, s)) / (2 * step) ==
            Approx(generating.sum_rate(h, s)).margin(tolerance));
      CHECK((generating.sum_rate(h + step, s) - generating.sum_rate(h - step, s)) / (2 * step) ==
            Approx(generating.sum_second_rate(h, s)).margin(tolerance));
      for (std::size_t m = 0; m < 4; ++m) {
        expand_at(m, step);
        const double value_up = generating.sum(h, s);
        generating.gradient_sum(h, s, up);
        expand_at(m, -step);
        const double value_down = generating.sum(h, s);
        generating.gradient_sum(h, s, down);
        const auto i = static_cast<Index>(m);
        CHECK((value_up - value_down) / (2 * step) == Approx(gradient[i]).margin(tolerance));
        CHECK(((up - down) / (2 * step) - hessian.col(i)).cwiseAbs().maxCoeff() <= tolerance);
        CHECK(((up - down) / (2 * step) - 1.01 * hessian.col(i)).cwiseAbs().maxCoeff() > tolerance);
      }
    }
  }
}

TEST_CASE("a generating function says what it cannot expand, and refuses what it is not") {
  const Hamiltonian hamiltonian({"q"}, {"p"}, "p^2/2 + abs(q)");
  const MatrixXd zero = MatrixXd::Zero(2, 2);
  GeneratingFunction generating(hamiltonian, zero, 5);
  CHECK(generating.expand(std::vector<double>{0.0, 1.0}) == Status::undefined);
  CHECK_FALSE(generating.failure().empty());
  CHECK(generating.expand(std::vector<double>{0.5, 1.0}) == Status::success);
  CHECK(generating.failure().empty());
  CHECK(generating.odd());
  CHECK_THROWS_WITH(GeneratingFunction(hamiltonian, zero, 0), Catch::Contains("got 0"));
  CHECK_THROWS_WITH(GeneratingFunction(hamiltonian, MatrixXd::Zero(4, 4), 3), Catch::Contains("4×4"));
}
