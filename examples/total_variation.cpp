// One discrete action, everything from it (theory, section 2). A discrete Lagrangian that is not in the library is
// written down as a formula; varying its action by values gives the integrator, by time the energy law, and at the
// boundary the two-form that the two-step map preserves.

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include <fmt/format.h>

#include <rubato/rubato.hpp>

namespace {

/// (t_0, q_0, p_0, t_1, q_1, p_1) of step k.
std::vector<double> corners(const rubato::Orbit& orbit, std::size_t k) {
  return {orbit.t[k], orbit.q[k], orbit.p[k], orbit.t[k + 1], orbit.q[k + 1], orbit.p[k + 1]};
}

}  // namespace

int main() {
  const rubato::Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
  // The potential at a quarter and at three quarters of the segment, in place of its middle.
  const rubato::Custom lagrangian{
      .L = "(p_0+p_1)/2*(q_1-q_0)/(t_1-t_0) - ((p_0+p_1)/2)^2/2 + (cos((3*q_0+q_1)/4) + cos((q_0+3*q_1)/4))/2"};
  const rubato::Orbit orbit =
      rubato::integrate(pendulum, {.q = {0.0}, .p = {1.9}}, {.lagrangian = lagrangian, .step = 0.1, .until = 20});

  const std::unique_ptr<rubato::DiscreteAction> action = rubato::make_action(pendulum, lagrangian);
  double value_law = 0.0, energy_law = 0.0, two_form_kept = 0.0, two_form_broken = 0.0;
  for (std::size_t k = 0; k + 1 < orbit.steps(); ++k) {
    const std::vector<double> before = corners(orbit, k);
    const std::vector<double> after = corners(orbit, k + 1);
    const rubato::Incidence node[] = {{before, 1}, {after, 0}};
    value_law = std::max(value_law, rubato::value_variation(*action, node).cwiseAbs().maxCoeff());
    energy_law = std::max(energy_law, std::abs(rubato::coordinate_variation(*action, node, 0)));

    // TᵀW₁T = W₀, relative to what is summed; and not so with a T that is off by one part in a thousand.
    const Eigen::MatrixXd T = rubato::two_step_tangent(*action, before, after);
    const Eigen::MatrixXd W_0 = rubato::two_form(*action, before);
    const Eigen::MatrixXd W_1 = rubato::two_form(*action, after);
    const auto defect = [&](const Eigen::MatrixXd& tangent) {
      return (tangent.transpose() * W_1 * tangent - W_0).norm() / (tangent.squaredNorm() * W_1.norm());
    };
    two_form_kept = std::max(two_form_kept, defect(T));
    two_form_broken = std::max(two_form_broken, defect(1.001 * T));
  }
  fmt::print("{} steps, h from {:.3f} to {:.3f}\n", orbit.steps(), *std::ranges::min_element(orbit.h),
             *std::ranges::max_element(orbit.h));
  fmt::print("value variation  (3.3)   {:.2g}\n", value_law);
  fmt::print("time variation   (3.4)   {:.2g}\n", energy_law);
  fmt::print("two-form         (3.14)  {:.2g}\n", two_form_kept);

  // (3.3) is solved to rounding of its terms, which are at most 2: some ε. (3.4) is met to the tolerance 1e-13 relative
  // to an energy of order 1. The products of TᵀW₁T are rounded at ε of their factors.
  const bool as_expected = orbit.status == rubato::Status::success && value_law < 1e-13 && energy_law < 4e-13 &&
                           two_form_kept < 1e-14 && two_form_broken > 1e-6;
  return as_expected ? 0 : 1;
}
