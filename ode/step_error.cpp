#include <rubato/ode/step_error.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <rubato/ode/tuning.hpp>

namespace rubato {

namespace {

/// Each step in two halves, the node between by the cubic through both ends with their slopes.
NodesOfOrbit halved_steps(const Hamiltonian& hamiltonian, const NodesOfOrbit& orbit) {
  HamiltonianEvaluator evaluator(hamiltonian);
  const std::size_t size = orbit.dimension, n = size / 2;
  std::vector<double> before(size), after(size);
  NodesOfOrbit halved{
      .dimension = size, .z = {orbit.z.begin(), orbit.z.begin() + static_cast<std::ptrdiff_t>(size)}, .h = {}};
  evaluator.gradient(orbit.node(0).data(), after.data());
  for (std::size_t k = 0; k < orbit.segments(); ++k) {
    before.swap(after);
    const std::span<const double> z_0 = orbit.node(k), z_1 = orbit.node(k + 1);
    evaluator.gradient(z_1.data(), after.data());
    for (std::size_t i = 0; i < size; ++i) {
      const double change = i < n ? before[n + i] - after[n + i] : after[i - n] - before[i - n];
      halved.z.push_back(0.5 * (z_0[i] + z_1[i]) + 0.125 * orbit.h[k] * change);
    }
    halved.z.insert(halved.z.end(), z_1.begin(), z_1.end());
    halved.h.insert(halved.h.end(), 2, 0.5 * orbit.h[k]);
  }
  return halved;
}

/// What the error of each coordinate and momentum is compared with.
std::vector<double> ranges_of(const NodesOfOrbit& orbit) {
  const std::size_t size = orbit.dimension, n = size / 2;
  std::vector<double> ranges(size), largest(2, 0.0);
  for (std::size_t i = 0; i < size; ++i) {
    double least = orbit.z[i], most = least;
    for (std::size_t k = 1; k <= orbit.segments(); ++k) {
      least = std::min(least, orbit.node(k)[i]);
      most = std::max(most, orbit.node(k)[i]);
    }
    ranges[i] = most - least;
    largest[i / n] = std::max(largest[i / n], ranges[i]);
  }
  for (std::size_t i = 0; i < size; ++i) {
    ranges[i] = std::max(ranges[i], tuning::boundary_value::least_range * largest[i / n]);
  }
  return ranges;
}

}  // namespace

StepError step_error(const Hamiltonian& hamiltonian, const EndConditions& ends, const NodesOfOrbit& solution,
                     const BoundaryValueOptions& options) {
  BoundaryValueOptions held = options;
  held.levels = Levels::fixed;  // in the ratios of the guess
  held.tolerance = std::max(held.tolerance, tuning::boundary_value::loose_tolerance);
  StepError error{.halved = solve_boundary_value(hamiltonian, ends, halved_steps(hamiltonian, solution), held)};
  if (!error.halved.found()) {
    error.relative = std::numeric_limits<double>::infinity();
    return error;
  }
  const int order = make_segment_equation(hamiltonian, options.lagrangian)->order();
  const double factor = 1.0 / (1.0 - std::exp2(-order));
  const std::vector<double> ranges = ranges_of(solution);
  const NodesOfOrbit& halved = error.halved.orbit;
  error.components.assign(solution.dimension, 0.0);
  for (std::size_t k = 0; k <= solution.segments(); ++k) {
    for (std::size_t i = 0; i < solution.dimension; ++i) {
      const double here = factor * std::abs(solution.node(k)[i] - halved.node(2 * k)[i]);
      error.components[i] = std::max(error.components[i], here);
      if (here > error.relative * ranges[i]) {
        error.relative = here / ranges[i];
        error.level = k;
        error.component = i;
      }
    }
  }
  const BoundaryValueSolution whole = boundary_value_residual(hamiltonian, ends, solution, {}, held);
  error.duration = options.duration ? 0.0 : factor * std::abs(solution.duration() - halved.duration());
  if (const double late = error.duration / std::abs(solution.duration()); late > error.relative) {
    error.relative = late;
    error.level = solution.segments();
  }
  error.energy = options.energy ? 0.0 : factor * std::abs(whole.mean_energy - error.halved.mean_energy);
  return error;
}

}  // namespace rubato
