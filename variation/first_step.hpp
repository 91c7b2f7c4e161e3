#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include <rubato/variation/time_levels.hpp>

namespace rubato {

/// What a trial run from some first step found.
struct TrialRun {
  Status status = Status::success;
  double deviation = 0.0;  ///< max |H(z_k) - E| / TimeLevels::energy_scale(), the first level included
  bool whole = false;      ///< whether it came to the end of the run
};

/// A first step h_0 with which the node energy H(z_k) stays within `tolerance` of the discrete energy E, relative to
/// TimeLevels::energy_scale, which knows no zero of H, and not by much more than it has to: between 0.7 and 1 times the
/// tolerance where trials settle. No longer than a tenth of the run.
///
/// By the node law the largest deviation is c·max|Γ|^(1/(s+1)) with c proportional to h_0^s (theory, section 3), so
/// that one trial tells the next step: h_0 (tolerance/deviation)^(1/s). Γ at the start says little about its largest
/// value, which is why trials run along the orbit, and begin with a coarse tolerance, with which they come far.
///
/// \param run a trial run from a first step
/// \param start the first level, whose Γ gives the first guess, with `energy_scale`: about the size of H's terms
/// \param length of the run; its sign is that of the step
/// \throws std::invalid_argument if the tolerance is not in (0, 1), or no trial keeps to it
[[nodiscard]] double choose_first_step(const std::function<TrialRun(double)>& run, const LevelNode& start,
                                       double energy_scale, int order, double tolerance, double length);

/// The size of H's terms at the start, or of what their rounding says of them, where they all happen to vanish.
[[nodiscard]] inline double starting_scale(const TimeLevels& levels) {
  return std::max(levels.energy_scale(), levels.energy_rounding() / std::numeric_limits<double>::epsilon());
}

/// Follows an integrator from its start for at most `most_steps` steps.
template <typename Integrator>
TrialRun trial_run(Integrator& integrator, std::size_t most_steps) {
  double low = integrator.bare_node().energy;
  double high = low;
  TrialRun result;
  for (std::size_t k = 0; k < most_steps && !integrator.finished(); ++k) {
    result.status = integrator.step().status;
    if (result.status != Status::success) {
      return result;
    }
    const double energy = integrator.bare_node().energy;
    low = std::min(low, energy);
    high = std::max(high, energy);
  }
  result.whole = integrator.finished();
  // While the run still waits beside a zero of Γ there is no E yet.
  const double set = integrator.levels().bare_energy();
  const double E = std::isnan(set) ? 0.5 * (low + high) : set;
  const double scale = integrator.levels().energy_scale();
  result.deviation = scale == 0.0 ? 0.0 : std::max(high - E, E - low) / scale;
  return result;
}

}  // namespace rubato
