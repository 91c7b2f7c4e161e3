// Γ = fᵀH_zz f with f = J∇H (theory, section 3): its formula beside the sum over all entries of H_zz.

#include <cmath>
#include <cstddef>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/hamiltonian.hpp>

#include "systems.hpp"

using namespace rubato;

namespace {

struct Sum {
  double value = 0.0;
  double terms = 0.0;  ///< of their magnitudes
};

/// From H_zz as a whole, `without` the row and column of that number.
Sum gamma_of(HamiltonianEvaluator& evaluator, const std::vector<double>& z, std::size_t without) {
  const std::size_t size = z.size(), n = size / 2;
  std::vector<double> gradient(size), hessian(size * size), f(size);
  evaluator.hessian(z.data(), gradient.data(), hessian.data());
  for (std::size_t i = 0; i < size; ++i)
    f[i] = i < n ? gradient[n + i] : -gradient[i - n];
  Sum sum;
  for (std::size_t i = 0; i < size; ++i)
    for (std::size_t j = 0; j < size; ++j)
      if (i != without && j != without) {
        const double term = f[i] * hessian[i * size + j] * f[j];
        sum.value += term;
        sum.terms += std::abs(term);
      }
  return sum;
}

Hamiltonian chain(std::size_t n) {
  std::vector<std::string> q, p;
  std::string H = "0";
  for (std::size_t i = 1; i <= n; ++i) {
    q.push_back("q" + std::to_string(i));
    p.push_back("p" + std::to_string(i));
    H += " + " + p.back() + "^2/2";
    const std::string stretch = i == 1 ? q.back() : "(" + q.back() + " - " + q[i - 2] + ")";
    H += " + " + stretch + "^2/2 + " + stretch + "^4/16";
  }
  return {q, p, H};
}

/// Every coordinate acts on every other, and momenta on coordinates.
Hamiltonian dense(std::size_t n) {
  std::vector<std::string> q, p;
  std::string inner = "0", kinetic = "0";
  for (std::size_t i = 1; i <= n; ++i) {
    q.push_back("q" + std::to_string(i));
    p.push_back("p" + std::to_string(i));
    inner += " + " + std::to_string(i) + "*" + q.back();
    kinetic += " + (1 + " + q.back() + "^2)*" + p.back() + "^2";
  }
  return {q, p, "cos(" + inner + ") + (" + kinetic + ")/2"};
}

}  // namespace

TEST_CASE("Gamma by its formula is that of all entries of the Hessian") {
  std::mt19937 random(23);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Hamiltonian> all;
  for (const systems::System& system : {systems::pendulum(), systems::kepler(0.6), systems::henon_heiles(),
                                        systems::non_separable(), systems::oscillator(2.0)})
    all.push_back(system.hamiltonian);
  for (const std::size_t n : {3, 15, 16, 17, 100})
    all.push_back(chain(n));
  for (const std::size_t n : {2, 9, 20})
    all.push_back(dense(n));
  for (const Hamiltonian& hamiltonian : all) {
    HamiltonianEvaluator evaluator(hamiltonian);
    INFO(formula::to_string(hamiltonian.expression()).substr(0, 60));
    for (int trial = 0; trial < 5; ++trial) {
      std::vector<double> z(evaluator.dimension());
      for (double& value : z)
        value = uniform(random);
      double energy = 0.0;
      const double gamma = evaluator.gamma(z.data(), energy);
      CHECK(energy == evaluator.value(z.data()));
      const Sum sum = gamma_of(evaluator, z, z.size());
      // Each way of adding up d² terms, of a few roundings each, errs by d² + 8 roundings of them at most.
      const auto count = static_cast<double>(z.size() * z.size() + 8);
      const double bound = 2.0 * count * std::numeric_limits<double>::epsilon() * sum.terms;
      CHECK(std::abs(gamma - sum.value) <= bound);
      // The twin: without one coordinate it is another.
      CHECK(std::abs(gamma - gamma_of(evaluator, z, 0).value) > bound);
    }
  }
}

TEST_CASE("Gamma of a Hamiltonian that names no coordinate vanishes, and is undefined where an entry is") {
  HamiltonianEvaluator constant(Hamiltonian({"q"}, {"p"}, "3"));
  const std::vector<double> anywhere{0.3, -0.7};
  double energy = 0.0;
  CHECK(constant.gamma(anywhere.data(), energy) == 0.0);
  CHECK(energy == 3.0);
  HamiltonianEvaluator root(Hamiltonian({"q"}, {"p"}, "p^2/2 + sqrt(q)"));
  const std::vector<double> outside{-1.0, 0.5};
  CHECK_FALSE(std::isfinite(root.gamma(outside.data(), energy)));
  CHECK_FALSE(std::isfinite(energy));
}
