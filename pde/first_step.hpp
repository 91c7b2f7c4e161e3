#pragma once

#include <rubato/pde/lattice.hpp>

namespace rubato {

/// A first step for `options`, in place of its `step`, with which the node energy 𝓔(z_k) stays within `tolerance` of
/// the discrete energy, relative to TimeLevels::energy_scale: found by trial runs of at most 500
/// steps with the same options (choose_first_step of variation/first_step.hpp). \throws std::invalid_argument as
/// LatticeIntegrator and choose_first_step do
[[nodiscard]] double choose_first_step(const MultisymplecticSystem& system, const grids::Grid& grid,
                                       const InitialFields& initial, LatticeOptions options, double tolerance);

}  // namespace rubato
