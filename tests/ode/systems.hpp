#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/integrate.hpp>

/// Problems that several tests use: each an orbit along which Γ keeps its sign.
namespace systems {

struct System {
  std::string name;
  rubato::Hamiltonian hamiltonian;
  rubato::InitialState initial;
  double step;  ///< a first step that resolves the orbit well
};

inline System pendulum() {
  return {"pendulum", {{"q"}, {"p"}, "p^2/2 - cos(q)"}, {.q = {0.0}, .p = {1.9}}, 0.1};
}

/// At the pericentre; the step is a part of the time scale there.
inline System kepler(double eccentricity) {
  return {"Kepler",
          {{"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)"},
          {.q = {1.0 - eccentricity, 0.0}, .p = {0.0, std::sqrt((1.0 + eccentricity) / (1.0 - eccentricity))}},
          0.02 * std::pow(1.0 - eccentricity, 1.5)};
}

inline System henon_heiles() {
  const double energy = 1.0 / 12.0;
  const double y = 0.1;
  return {"Henon-Heiles",
          {{"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3"},
          {.q = {0.0, y}, .p = {std::sqrt(2.0 * energy - y * y + 2.0 * y * y * y / 3.0), 0.0}},
          0.1};
}

inline System double_well() {
  return {"double well", {{"q"}, {"p"}, "p^2/2 + (q^4 - q^2)/2"}, {.q = {0.9}, .p = {0.0}}, 0.1};
}

inline System non_separable() {
  return {"non-separable", {{"q"}, {"p"}, "(q^2 + 1)*(p^2 + 1)/2"}, {.q = {1.0}, .p = {0.0}}, 0.1};
}

inline System oscillator(double frequency = 1.0) {
  return {"oscillator", {{"q"}, {"p"}, "(p^2 + w^2*q^2)/2", {{"w", frequency}}}, {.q = {1.0}, .p = {0.0}}, 0.1};
}

/// (q, p) of an initial state, or of level k of an orbit.
inline std::vector<double> joined(const rubato::InitialState& state) {
  std::vector<double> z = state.q;
  z.insert(z.end(), state.p.begin(), state.p.end());
  return z;
}

inline std::vector<double> state_at(const rubato::Orbit& orbit, std::size_t level) {
  std::vector<double> z(orbit.q_at(level).begin(), orbit.q_at(level).end());
  z.insert(z.end(), orbit.p_at(level).begin(), orbit.p_at(level).end());
  return z;
}

inline std::vector<double> middle(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> z(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    z[i] = 0.5 * (a[i] + b[i]);
  }
  return z;
}

/// J∇H(z).
inline std::vector<double> velocity(rubato::HamiltonianEvaluator& hamiltonian, const std::vector<double>& z) {
  const std::size_t n = z.size() / 2;
  std::vector<double> gradient(z.size());
  hamiltonian.gradient(z.data(), gradient.data());
  std::vector<double> f(z.size());
  for (std::size_t i = 0; i < n; ++i) {
    f[i] = gradient[n + i];
    f[n + i] = -gradient[i];
  }
  return f;
}

/// One explicit Runge–Kutta step from z: of order 4 a reference that shares nothing with the schemes under test, of
/// order 2 (the explicit midpoint rule) a scheme that holds no law.
inline std::vector<double> runge_kutta(rubato::HamiltonianEvaluator& hamiltonian, const std::vector<double>& z,
                                       double h, int order) {
  const auto at = [&](double scale, const std::vector<double>& k) {
    std::vector<double> point = z;
    for (std::size_t i = 0; i < z.size(); ++i) {
      point[i] += scale * h * k[i];
    }
    return point;
  };
  const std::vector<double> k1 = velocity(hamiltonian, z);
  const std::vector<double> k2 = velocity(hamiltonian, at(0.5, k1));
  if (order == 2) {
    return at(1.0, k2);
  }
  const std::vector<double> k3 = velocity(hamiltonian, at(0.5, k2));
  const std::vector<double> k4 = velocity(hamiltonian, at(1.0, k3));
  std::vector<double> mean(z.size());
  for (std::size_t i = 0; i < z.size(); ++i) {
    mean[i] = (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0;
  }
  return at(1.0, mean);
}

inline double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]));
  }
  return largest;
}

}  // namespace systems
