#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include <rubato/variation/integrator.hpp>

namespace rubato {

/// What a trial run from some first step found.
struct TrialRun {
  Status status = Status::success;
  /// max |H(z_k) - E| over the scale of the node energy, the first level included; of E without the first step's f',
  /// which is K_h there.
  double deviation = 0.0;
  bool whole = false;  ///< true if it came to the end of the run
};

/// The scale of the node energy: max |H(z_k)|; where that is nothing beside what cancels among the terms of H, 3 % of
/// the latter. Where both are rounding the size that this says of the terms takes their place.
[[nodiscard]] double node_energy_scale(double largest, const formula::SumSize& sizes);

/// A first step h_0 with which the node energy H(z_k) stays within `tolerance` of the discrete energy E, its own step
/// potential f'(h_0) left out, relative to node_energy_scale(), and by not much less: between 0.7 and 1 times the
/// tolerance where trials settle. |H| is with the constants that are added to H or without them, whichever is less. No
/// longer than a tenth of the run.
///
/// By the node law the largest deviation is c·max|Γ|^(1/(s+1)) with c proportional to h_0^s (theory, section 3), so
/// that one trial shows the next step: h_0 (tolerance/deviation)^(1/s). Γ at the start says little about its largest
/// value, which is why trials run along the orbit, and begin with a coarse tolerance, with which they come far.
///
/// \param make an integrator at the start of the run, with that first step
/// \param length of the run; its sign is that of the step
/// \param most_steps of a trial
/// \throws std::invalid_argument if the tolerance is not in (0, 1), or no trial keeps to it
[[nodiscard]] double choose_first_step(const std::function<std::unique_ptr<Integrator>(double step)>& make,
                                       double length, double tolerance, std::size_t most_steps);

/// Follows an integrator from its start for at most `most_steps` steps.
[[nodiscard]] TrialRun trial_run(Integrator& integrator, std::size_t most_steps);

}  // namespace rubato
