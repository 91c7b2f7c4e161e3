#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <rubato/ode/integrate.hpp>

/// What a run that crosses zeros of Γ is judged by.
namespace rubato::tests {

struct Judged {
  Status status = Status::success;
  std::size_t steps = 0;
  std::size_t crossings = 0;
  std::size_t bridge_steps = 0;
  double energy_deviation = 0.0;  ///< max |E_k - E| off bridges
  double node_deviation = 0.0;    ///< max |H(z_k) - E|
  /// Means of H(z_k) - E over eighths of the run: of the levels, and by the trapezoidal rule over time.
  std::array<double, 8> level_means{}, time_means{};

  [[nodiscard]] double steps_per_crossing() const {
    return static_cast<double>(bridge_steps) / static_cast<double>(std::max<std::size_t>(crossings, 1));
  }
  /// max - min of the means over time.
  [[nodiscard]] double spread() const { return range(time_means); }
  /// (max - min)/|mean| of the means of the levels: a drift of the amplitude of H - E shows here.
  [[nodiscard]] double drift() const {
    return 8.0 * range(level_means) / std::abs(std::accumulate(level_means.begin(), level_means.end(), 0.0));
  }

private:
  [[nodiscard]] static double range(const std::array<double, 8>& means) {
    const auto [low, high] = std::ranges::minmax(means);
    return high - low;
  }
};

inline Judged judge(const Hamiltonian& hamiltonian, const InitialState& initial, const IntegrationOptions& options) {
  OrbitIntegrator integrator(hamiltonian, initial, options);
  Judged judged;
  std::array<double, 8> durations{}, levels{};
  double last_energy = integrator.node().energy;
  while (!integrator.finished()) {
    const StepReport report = integrator.step();
    if (report.status != Status::success) {
      judged.status = report.status;
      return judged;
    }
    ++judged.steps;
    judged.crossings += report.crossing ? 1 : 0;
    judged.bridge_steps += report.bridged ? 1 : 0;
    const double energy = integrator.node().energy;
    if (const double E = integrator.levels().energy(); !std::isnan(E)) {  // set by the first step that meets the law
      if (!report.bridged) {
        judged.energy_deviation = std::max(judged.energy_deviation, std::abs(report.energy - report.target));
      }
      judged.node_deviation = std::max(judged.node_deviation, std::abs(energy - E));
      const double middle = (integrator.t() - 0.5 * report.h) / options.until;
      const auto eighth = std::min<std::size_t>(7, static_cast<std::size_t>(8.0 * middle));
      judged.time_means[eighth] += (0.5 * (last_energy + energy) - E) * report.h;
      durations[eighth] += report.h;
      judged.level_means[eighth] += energy - E;
      levels[eighth] += 1.0;
    }
    last_energy = energy;
  }
  for (std::size_t i = 0; i < 8; ++i) {
    judged.time_means[i] /= durations[i];
    judged.level_means[i] /= levels[i];
  }
  return judged;
}

/// The pendulum turns over, so that |q| grows like the time and H is evaluated at a q rounded to ε|q|: E deviates by
/// ε|q||sin q|.
inline double rotation_rounding(double until) {
  return 4.0 * 2.2e-16 * 2.0 * until;
}

}  // namespace rubato::tests
