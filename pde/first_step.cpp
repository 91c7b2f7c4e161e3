#include <rubato/pde/first_step.hpp>

#include <rubato/variation/first_step.hpp>

namespace rubato {

double choose_first_step(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& initial,
                         LatticeOptions options, double tolerance) {
  constexpr std::size_t most_steps = 500;
  const auto make = [&](double step) {
    options.step = step;
    return std::make_unique<LatticeIntegrator>(system, grid, initial, options);
  };
  return choose_first_step(make, options.until - options.start, tolerance, most_steps);
}

}  // namespace rubato
