#include <rubato/ode/first_step.hpp>

#include <rubato/variation/first_step.hpp>

namespace rubato {

namespace {

template <typename System, typename Start>
double choose(const System& system, const Start& initial, IntegrationOptions options, double tolerance) {
  constexpr std::size_t most_steps = 2000;
  const double length = options.until - initial.t;
  options.step = std::copysign(1e-6, length) * std::abs(length);
  OrbitIntegrator start(system, initial, options);
  const auto run = [&](double step) {
    options.step = step;
    OrbitIntegrator integrator(system, initial, options);
    return trial_run(integrator, most_steps);
  };
  return choose_first_step(run, start.node(), starting_scale(start.levels()), start.scheme().order(), tolerance,
                           length);
}

}  // namespace

double choose_first_step(const Hamiltonian& hamiltonian, const InitialState& initial, IntegrationOptions options,
                         double tolerance) {
  return choose(hamiltonian, initial, std::move(options), tolerance);
}

double choose_first_step(const Lagrangian& lagrangian, const InitialMotion& initial, IntegrationOptions options,
                         double tolerance) {
  return choose(lagrangian, initial, std::move(options), tolerance);
}

}  // namespace rubato
