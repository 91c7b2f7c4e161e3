// A generating function, looked at and used: its coefficients at a point, how well the truncated one gives the flow,
// and an orbit of order 8 with variable levels.

#include <array>
#include <cmath>

#include <fmt/format.h>

#include <rubato/rubato.hpp>

int main() {
  const rubato::Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");

  // F = 0, the midpoint type: φ(w, t) = tφ¹ + t³φ³ + …, with φ¹ = -H and φ³ = -Γ/24.
  rubato::GeneratingFunction phi(pendulum, Eigen::MatrixXd::Zero(2, 2), 7);
  const std::array<double, 2> w = {0.4, 1.1};
  if (const rubato::Status status = phi.expand(w); status != rubato::Status::success) {
    fmt::print("{}\n", phi.failure());
    return 1;
  }
  for (int j = 1; j <= 7; ++j) {
    fmt::print("φ^{} = {:+.6e}\n", j, phi.coefficient(j));
  }
  const double H = w[1] * w[1] / 2 - std::cos(w[0]);
  const double gamma = std::sin(w[0]) * std::sin(w[0]) + w[1] * w[1] * std::cos(w[0]);  // fᵀ H_zz f, f = (p, -sin q)
  // What is compared differs by the rounding of a few operations on numbers of order 1.
  bool as_expected = std::abs(phi.coefficient(1) + H) < 1e-14 && std::abs(phi.coefficient(2)) < 1e-14 &&
                     std::abs(phi.coefficient(3) + gamma / 24) < 1e-14;

  // The step law of order 2m keeps h^(2m+1) φ^(2m+1) constant; φ⁵ keeps its sign below the energy 0, as here.
  const rubato::Orbit orbit = rubato::integrate(
      pendulum, {.q = {0.0}, .p = {0.8}}, {.lagrangian = rubato::Generating{.order = 4}, .step = 0.2, .until = 100});
  fmt::print("order 4: {} steps, discrete energy constant to {:.1e}\n", orbit.steps(),
             orbit.discrete_energy_deviation());
  as_expected = as_expected && orbit.status == rubato::Status::success && orbit.discrete_energy_deviation() < 1e-12;
  return as_expected ? 0 : 1;
}
