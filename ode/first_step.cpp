#include <rubato/ode/first_step.hpp>

#include <rubato/variation/first_step.hpp>

namespace rubato {

double choose_first_step(const Hamiltonian& hamiltonian, const InitialState& initial, IntegrationOptions options,
                         double tolerance) {
  constexpr std::size_t most_steps = 2000;
  const double length = options.until - initial.t;
  options.step = std::copysign(1e-6, length) * std::abs(length);
  OrbitIntegrator start(hamiltonian, initial, options);
  const auto run = [&](double step) {
    options.step = step;
    OrbitIntegrator integrator(hamiltonian, initial, options);
    return trial_run(integrator, most_steps);
  };
  return choose_first_step(run, start.node(), starting_scale(start.levels()), start.scheme().order(), tolerance,
                           length);
}

}  // namespace rubato
