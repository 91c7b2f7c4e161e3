#include <rubato/pde/first_step.hpp>

#include <rubato/variation/first_step.hpp>

namespace rubato {

double choose_first_step(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& initial,
                         LatticeOptions options, double tolerance) {
  constexpr std::size_t most_steps = 500;
  constexpr int order = 2;
  const double length = options.until - options.start;
  options.step = std::copysign(1e-6, length) * std::abs(length);
  LatticeIntegrator start(system, grid, initial, options);
  const auto run = [&](double step) {
    options.step = step;
    LatticeIntegrator integrator(system, grid, initial, options);
    return trial_run(integrator, most_steps);
  };
  return choose_first_step(run, start.node(), starting_scale(start.levels()), order, tolerance, length);
}

}  // namespace rubato
