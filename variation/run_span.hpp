#pragma once

namespace rubato {

/// Of a step: a level so near to `until` counts as at it. Levels are start + k·step only to rounding.
inline constexpr double end_slack = 1e-9;

/// The checks that the options of every run need: from `start` by a first step of `step` to `until`, the level equation
/// solved to the relative `tolerance`.
/// \throws std::invalid_argument naming the option, its value and the remedy: a value that is not finite; no step; no
/// way to go (until left out, or the start itself to 1e-9 of a step), or one away from `until`; a step lost in rounding
/// beside the start; a tolerance outside (0, 1)
void check_run_span(double start, double step, double until, double tolerance);

}  // namespace rubato
