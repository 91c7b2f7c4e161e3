// The continuous theory of the paper, (1.6)-(1.9) and (2.13)-(2.21), as identities in exact arithmetic (GiNaC) on three
// Hamiltonians: a pendulum, Kepler's problem, and a polynomial that is not separable. Each has a twin that is wrong.

#include <catch2/catch.hpp>

#include <array>
#include <string>
#include <vector>

#include <ginac/ginac.h>

using GiNaC::ex;
using GiNaC::symbol;

namespace {

/// A point of a curve in R × T*Q, with the velocity there.
struct Curve {
  symbol t{"t"};
  std::vector<symbol> q, p, q_dot, p_dot;

  explicit Curve(int n) {
    for (int i = 1; i <= n; ++i) {
      const std::string index = std::to_string(i);
      q.emplace_back("q" + index);
      p.emplace_back("p" + index);
      q_dot.emplace_back("q_dot" + index);
      p_dot.emplace_back("p_dot" + index);
    }
  }
  /// D_t of a function of (t, q, p).
  [[nodiscard]] ex rate(const ex& f) const {
    ex sum = f.diff(t);
    for (std::size_t i = 0; i < q.size(); ++i) {
      sum += f.diff(q[i]) * q_dot[i] + f.diff(p[i]) * p_dot[i];
    }
    return sum;
  }
};

struct Problem {
  std::string name;
  Curve curve;
  ex H;
};

std::vector<Problem> problems() {
  std::vector<Problem> all;
  Curve one(1);
  all.push_back({"pendulum", one, GiNaC::pow(one.p[0], 2) / 2 - GiNaC::cos(one.q[0])});
  Curve plane(2);
  const ex r2 = GiNaC::pow(plane.q[0], 2) + GiNaC::pow(plane.q[1], 2);
  all.push_back({"Kepler", plane,
                 (GiNaC::pow(plane.p[0], 2) + GiNaC::pow(plane.p[1], 2)) / 2 - GiNaC::pow(r2, GiNaC::numeric(-1, 2))});
  Curve mixed(2);
  all.push_back({"not separable", mixed,
                 GiNaC::pow(mixed.p[0], 2) * (1 + GiNaC::pow(mixed.q[1], 2)) / 2 +
                     mixed.p[0] * mixed.p[1] * mixed.q[0] + GiNaC::pow(mixed.p[1], 4) / 4 +
                     GiNaC::pow(mixed.q[0], 2) * mixed.q[1] + GiNaC::pow(mixed.q[1], 4)});
  return all;
}

/// A vector field on R × T*Q: ξ ∂_t + φ^i ∂_{q^i} + ψ^i ∂_{p^i}, with polynomials that have no symmetry.
struct Field {
  ex xi;
  std::vector<ex> phi, psi;

  Field(const Curve& c, bool moves_time) {
    xi = moves_time ? ex(1 + 2 * c.t * c.q[0] - GiNaC::pow(c.p[0], 2)) : ex(0);
    for (std::size_t i = 0; i < c.q.size(); ++i) {
      const std::size_t other = c.q.size() - 1 - i;
      const int k = static_cast<int>(i);
      phi.push_back(GiNaC::pow(c.q[i], 2) + (3 + k) * c.p[other] + (moves_time ? ex(c.t * c.q[other]) : ex(0)));
      psi.push_back(c.q[other] * c.p[i] - (2 - k) * GiNaC::pow(c.p[i], 2) + (moves_time ? ex(c.t) : ex(0)));
    }
  }
};

/// (q' - H_p) ψ + (-p' - H_q) φ: the Euler–Lagrange one-form (1.8) on a variation.
ex euler_lagrange(const Problem& problem, const std::vector<ex>& phi, const std::vector<ex>& psi) {
  const Curve& c = problem.curve;
  ex sum = 0;
  for (std::size_t i = 0; i < c.q.size(); ++i) {
    sum += (c.q_dot[i] - problem.H.diff(c.p[i])) * psi[i] + (-c.p_dot[i] - problem.H.diff(c.q[i])) * phi[i];
  }
  return sum;
}

bool vanishes(const ex& e) {
  return e.expand().normal().is_zero() || e.expand().is_zero();
}

}  // namespace

TEST_CASE("(1.6): the variation of the action is the Euler-Lagrange one-form and a boundary term") {
  for (const Problem& problem : problems()) {
    INFO(problem.name);
    const Curve& c = problem.curve;
    const Field V(c, false);
    ex variation = 0, boundary = 0;  // of p q' - H, by ψ ∂_p + φ ∂_q and the rate of φ; p φ
    for (std::size_t i = 0; i < c.q.size(); ++i) {
      variation += V.psi[i] * c.q_dot[i] + c.p[i] * c.rate(V.phi[i]) - problem.H.diff(c.q[i]) * V.phi[i] -
                   problem.H.diff(c.p[i]) * V.psi[i];
      boundary += c.p[i] * V.phi[i];
    }
    const ex inside = euler_lagrange(problem, V.phi, V.psi);
    CHECK(vanishes(variation - inside - c.rate(boundary)));
    CHECK_FALSE(vanishes(variation - inside + c.rate(boundary)));
  }
}

TEST_CASE("(1.9): dE + dω/dt = 0 on every pair of variations of any curve, solution or not") {
  for (const Problem& problem : problems()) {
    INFO(problem.name);
    const Curve& c = problem.curve;
    // Two variations and their rates at a point: functions of t of their own, which commute.
    struct Jet {
      std::vector<symbol> phi, psi, phi_dot, psi_dot;
    };
    const auto jet = [&](const std::string& name) {
      Jet result;
      for (std::size_t i = 0; i < c.q.size(); ++i) {
        for (auto* const part : {&result.phi, &result.psi, &result.phi_dot, &result.psi_dot}) {
          part->emplace_back(name);
        }
      }
      return result;
    };
    const Jet U = jet("U"), V = jet("V");
    const auto along = [&](const ex& e, const Jet& of) {  // the derivative of a function of the curve's point and rate
      ex sum = 0;
      for (std::size_t i = 0; i < c.q.size(); ++i) {
        sum += e.diff(c.q[i]) * of.phi[i] + e.diff(c.p[i]) * of.psi[i] + e.diff(c.q_dot[i]) * of.phi_dot[i] +
               e.diff(c.p_dot[i]) * of.psi_dot[i];
      }
      return sum;
    };
    const auto defect = [&](const Problem& of) {
      const auto E = [&](const Jet& on) {
        return euler_lagrange(of, {on.phi.begin(), on.phi.end()}, {on.psi.begin(), on.psi.end()});
      };
      ex rate = 0;  // of ω(U, V) = ψ_U φ_V - φ_U ψ_V
      for (std::size_t i = 0; i < c.q.size(); ++i) {
        rate += U.psi_dot[i] * V.phi[i] + U.psi[i] * V.phi_dot[i] - U.phi_dot[i] * V.psi[i] - U.phi[i] * V.psi_dot[i];
      }
      return ex(along(E(V), U) - along(E(U), V) + rate);
    };
    CHECK(vanishes(defect(problem)));
    if (c.q.size() > 1) {  // the twin: a force that is no gradient, (-q_2, 0), makes E not closed
      const auto E = [&](const Jet& on) {
        return euler_lagrange(problem, {on.phi.begin(), on.phi.end()}, {on.psi.begin(), on.psi.end()}) -
               c.q[1] * on.phi[0];
      };
      const ex change = along(E(V), U) - along(E(U), V) -
                        (along(euler_lagrange(problem, {V.phi.begin(), V.phi.end()}, {V.psi.begin(), V.psi.end()}), U) -
                         along(euler_lagrange(problem, {U.phi.begin(), U.phi.end()}, {U.psi.begin(), U.psi.end()}), V));
      CHECK_FALSE(vanishes(change));
    }
  }
}

TEST_CASE("(2.13)-(2.15): what a vector field with a part along t does to velocities") {
  for (const Problem& problem : problems()) {
    INFO(problem.name);
    const Curve& c = problem.curve;
    const Field V(c, true);
    const symbol epsilon("epsilon");
    for (std::size_t i = 0; i < c.q.size(); ++i) {
      // dq~/dt~ along the transformed curve, to first order in ε.
      const ex velocity = (c.q_dot[i] + epsilon * c.rate(V.phi[i])) / (1 + epsilon * c.rate(V.xi));
      const ex alpha = velocity.diff(epsilon).subs(epsilon == 0);
      CHECK(vanishes(alpha - (c.rate(V.phi[i]) - c.q_dot[i] * c.rate(V.xi))));
      CHECK_FALSE(vanishes(alpha - c.rate(V.phi[i])));
    }
  }
}

TEST_CASE("(2.17): the total variation of the action, with energy where t is varied, and its boundary form (2.20)") {
  for (const Problem& problem : problems()) {
    INFO(problem.name);
    const Curve& c = problem.curve;
    const Field V(c, true);
    const symbol epsilon("epsilon");
    // (p~ dq~/dt~ - H(q~, p~)) dt~/dt, to first order.
    GiNaC::exmap moved;
    ex momentum_part = 0, boundary = 0;
    for (std::size_t i = 0; i < c.q.size(); ++i) {
      moved[c.q[i]] = c.q[i] + epsilon * V.phi[i];
      moved[c.p[i]] = c.p[i] + epsilon * V.psi[i];
      const ex velocity = (c.q_dot[i] + epsilon * c.rate(V.phi[i])) / (1 + epsilon * c.rate(V.xi));
      momentum_part += (c.p[i] + epsilon * V.psi[i]) * velocity;
      boundary += c.p[i] * V.phi[i];
    }
    const ex integrand = (momentum_part - problem.H.subs(moved)) * (1 + epsilon * c.rate(V.xi));
    const ex variation = integrand.diff(epsilon).subs(epsilon == 0);
    const ex theta = boundary - problem.H * V.xi;  // θ = p dq - H dt on V
    const ex rest = variation - euler_lagrange(problem, V.phi, V.psi) - c.rate(theta);
    CHECK(vanishes(rest - c.rate(problem.H) * V.xi));  // dH/dt beside ξ: (2.19) where t is varied
    CHECK_FALSE(vanishes(rest));
    // (2.19) follows from (2.18).
    GiNaC::exmap motion;
    for (std::size_t i = 0; i < c.q.size(); ++i) {
      motion[c.q_dot[i]] = problem.H.diff(c.p[i]);
      motion[c.p_dot[i]] = -problem.H.diff(c.q[i]);
    }
    CHECK(vanishes(c.rate(problem.H).subs(motion)));
    // The remark: along the horizontal part, ξ(∂_t + q'∂_q + p'∂_p), nothing but the boundary term ξ(p q' - H) is left,
    // so that the Euler–Lagrange form of it is -ξ dH/dt.
    std::vector<ex> phi, psi;
    for (std::size_t i = 0; i < c.q.size(); ++i) {
      phi.push_back(V.xi * c.q_dot[i]);
      psi.push_back(V.xi * c.p_dot[i]);
    }
    CHECK(vanishes(euler_lagrange(problem, phi, psi) + V.xi * c.rate(problem.H)));
  }
}

TEST_CASE("(2.21): the flow keeps ω = dp∧dq - dH∧dt, which is closed and has the motion as its kernel") {
  for (const Problem& problem : problems()) {
    INFO(problem.name);
    const Curve& c = problem.curve;
    const std::size_t n = c.q.size(), size = 2 * n + 1;
    std::vector<symbol> z(c.q);
    z.insert(z.end(), c.p.begin(), c.p.end());
    z.push_back(c.t);
    std::vector<std::vector<ex>> omega(size, std::vector<ex>(size));  // ω_ij dz_i∧dz_j over 2, from θ = p dq - H dt
    const auto theta = [&](std::size_t i) { return i < n ? ex(c.p[i]) : i + 1 == size ? ex(-problem.H) : ex(0); };
    for (std::size_t i = 0; i < size; ++i) {
      for (std::size_t j = 0; j < size; ++j) {
        omega[i][j] = theta(j).diff(z[i]) - theta(i).diff(z[j]);
      }
    }
    std::vector<ex> X(size);
    for (std::size_t i = 0; i < n; ++i) {
      X[i] = problem.H.diff(c.p[i]);
      X[n + i] = -problem.H.diff(c.q[i]);
    }
    X.back() = 1;
    // By Cartan's formula ω is kept where dω = 0 and d(i_X ω) = 0; and i_X ω is 0.
    for (std::size_t j = 0; j < size; ++j) {
      ex contraction = 0;
      for (std::size_t i = 0; i < size; ++i) {
        contraction += X[i] * omega[i][j];
      }
      CHECK(vanishes(contraction));
      for (std::size_t i = 0; i < size; ++i) {
        for (std::size_t k = 0; k < size; ++k) {
          CHECK(vanishes(omega[i][j].diff(z[k]) + omega[j][k].diff(z[i]) + omega[k][i].diff(z[j])));
        }
      }
    }
    ex other = 0;  // the twin: another velocity is not in the kernel
    for (std::size_t i = 0; i < size; ++i) {
      other += (X[i] + (i == 0 ? 1 : 0)) * omega[i][n];
    }
    CHECK_FALSE(vanishes(other));
  }
}
