// Hamiltonians with sums that stay loops, beside those whose terms are written out.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/loop.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_scheme.hpp>

using namespace rubato;

namespace {

constexpr std::size_t bodies = 48, n = 3 * bodies;
constexpr double unit = 0x1p-53;

std::vector<std::string> numbered(char stem, std::size_t count) {
  std::vector<std::string> names;
  for (std::size_t i = 1; i <= count; ++i) {
    names.push_back(fmt::format("{}{}", stem, i));
  }
  return names;
}

Hamiltonian gravity(const std::string& softening = "0.01") {
  return {numbered('q', n), numbered('p', n),
          fmt::format("sum(i, 1, {0}, p[i]^2)/2 - sum(i, 2, {1}, sum(j, 1, i - 1, 1/sqrt({2} + (q[3*i-2] - q[3*j-2])^2 "
                      "+ (q[3*i-1] - q[3*j-1])^2 + (q[3*i] - q[3*j])^2)))",
                      n, bodies, softening)};
}

/// The same without loops.
Hamiltonian written_out(const Hamiltonian& hamiltonian) {
  return {hamiltonian.graph(), hamiltonian.q_names(), hamiltonian.p_names(),
          formula::unrolled(hamiltonian.expression())};
}

std::vector<double> start() {
  std::vector<double> z(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    z[i] = 4.0 * std::sin(0.7 * static_cast<double>(i * i) + 1.0);
    z[n + i] = 0.3 * std::cos(1.9 * static_cast<double>(i * i));
  }
  return z;
}

constexpr int steps = 10;
constexpr double h = 1e-3;

struct End {
  std::vector<double> z;
  double energy, gamma;
};
End after_steps(const Hamiltonian& hamiltonian, const char* name) {
  const auto scheme = make_splitting_scheme(hamiltonian, composition(name), start());
  End end{{}, 0.0, 0.0};
  for (int k = 0; k < steps; ++k) {
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    end.energy = scheme->discrete_energy();
    scheme->accept();
  }
  end.z.assign(scheme->state().begin(), scheme->state().end());
  end.gamma = scheme->node().gamma;
  return end;
}

double farthest(std::span<const double> a, std::span<const double> b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]));
  }
  return largest;
}

}  // namespace

TEST_CASE("steps with loops are those with terms written out") {
  const Hamiltonian loops = gravity(), plain = written_out(loops);
  REQUIRE(formula::has_loops(loops.expression()));
  REQUIRE_FALSE(formula::has_loops(plain.expression()));
  // Bound of the errors of ∇H and H at the start, where they are as large as they are on this short way, by either.
  double of_force = 0.0, of_energy = 0.0;
  for (const Hamiltonian* hamiltonian : {&loops, &plain}) {
    formula::RoundingEvaluator rounding(hamiltonian->gradient_code());
    rounding.run(start(), std::vector<double>(2 * n, 0.0));
    of_energy += unit * rounding.bound(0);
    double largest = 0.0;
    for (std::size_t i = 1; i <= 2 * n; ++i) {
      largest = std::max(largest, unit * rounding.bound(i));
    }
    of_force += largest;
  }
  for (const char* const name : {"verlet", "blanes-moan-4"}) {
    const End a = after_steps(loops, name), b = after_steps(plain, name);
    // Kicks of total length Σ|w| h ≤ 3 h in a step, each with such an error, which has no time to grow to twice as
    // much; and a unit of each number in the last place.
    const double tolerance = 2.0 * 3.0 * steps * h * of_force + 2.0 * 8.0 * unit;
    CHECK(farthest(a.z, b.z) <= tolerance);
    CHECK(std::abs(a.energy - b.energy) <= 2.0 * of_energy);
    // A twin: with other forces.
    CHECK(farthest(a.z, after_steps(gravity("0.01001"), name).z) > 10.0 * tolerance);
  }
  // Γ = fᵀ H_zz f by the derivative along f, and by the Hessian: sums of some n² terms each.
  const double a = after_steps(loops, "golden").gamma, b = after_steps(plain, "golden").gamma;
  CHECK(std::abs(a - b) <= 1e-11 * std::abs(b));
  CHECK(std::abs(a - after_steps(gravity("0.01001"), "golden").gamma) > 1e-8 * std::abs(b));
}

TEST_CASE("a loop over energies of both kinds is separable") {
  constexpr std::size_t many = 220;
  const auto of_terms = [&](const std::string& term) {
    return Hamiltonian(numbered('q', many), numbered('p', many),
                       fmt::format("sum(i, 1, {}, sum(j, 1, 5, {}))", many, term));
  };
  const Hamiltonian H = of_terms("(p[i]^2 + q[i]^4)/2 - cos(q[i])");
  const Separation halves = separate(H);
  CHECK(halves.separable());
  CHECK(formula::has_loops(halves.T));
  CHECK(formula::has_loops(halves.V));
  CHECK(formula::variables_of(halves.T).size() == many);
  CHECK(is_quadratic(halves.T, std::span(H.variables()).subspan(many)));
  CHECK_FALSE(is_quadratic(halves.V, std::span(H.variables()).first(many)));
  CHECK_FALSE(separate(of_terms("(p[i]*q[i])^2")).separable());  // a twin
}
