#include <rubato/ode/first_step.hpp>

#include <rubato/ode/tuning.hpp>
#include <rubato/variation/first_step.hpp>

namespace rubato {

namespace {

using namespace tuning::first_step_of_orbit;

}  // namespace

double choose_first_step(const Hamiltonian& hamiltonian, const InitialState& initial, IntegrationOptions options,
                         double tolerance) {
  const auto make = [&](double step) {
    options.step = step;
    return std::make_unique<OrbitIntegrator>(hamiltonian, initial, options);
  };
  return choose_first_step(make, options.until - initial.t, tolerance, most_first_steps);
}

double choose_first_step(const Lagrangian& lagrangian, const InitialMotion& initial, IntegrationOptions options,
                         double tolerance) {
  const auto make = [&](double step) {
    options.step = step;
    return std::make_unique<OrbitIntegrator>(lagrangian, initial, options);
  };
  return choose_first_step(make, options.until - initial.t, tolerance, most_first_steps);
}

}  // namespace rubato
