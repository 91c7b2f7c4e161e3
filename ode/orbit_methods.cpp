#include <rubato/ode/orbit_methods.hpp>

#include <limits>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/gauss_scheme.hpp>
#include <rubato/ode/generating_action.hpp>
#include <rubato/ode/generating_scheme.hpp>
#include <rubato/ode/lagrangian_scheme.hpp>
#include <rubato/ode/midpoint_scheme.hpp>
#include <rubato/ode/splitting_scheme.hpp>

namespace rubato {

namespace {

using Points = ActionQuadrature::Points;

std::unique_ptr<DiscreteAction> stated(FormulaAction action) {
  return std::make_unique<FormulaAction>(std::move(action));
}

// In the order of the alternatives of SegmentLagrangian; what is read of one is what it was made of.
const OrbitMethod all_methods[] = {
    {.name = "midpoint",
     .constrains_hamiltonian = true,
     .scheme = [](const Hamiltonian& H, const SegmentLagrangian&,
                  std::span<const double> z_0) { return make_midpoint_scheme(H, z_0); },
     .quadrature = [](const SegmentLagrangian&) { return ActionQuadrature(Points::gauss, 1); },
     .action = [](const Hamiltonian& H, const SegmentLagrangian&) { return stated(midpoint_action(H)); }},
    // The orbit is left within a few steps, which a look-ahead would not survive.
    {.name = "forward",
     .takes_potential = false,
     .action = [](const Hamiltonian& H, const SegmentLagrangian&) { return stated(forward_action(H)); }},
    {.name = "generating",
     .has_orders = true,
     .scheme = [](const Hamiltonian& H, const SegmentLagrangian& of,
                  std::span<const double> z_0) -> std::unique_ptr<OneStepScheme> {
       const auto& generating = std::get<Generating>(of);
       return make_generating_scheme(H, generating.F(H.degrees_of_freedom()), generating.order, z_0);
     },
     .action = [](const Hamiltonian& H, const SegmentLagrangian& of) -> std::unique_ptr<DiscreteAction> {
       const auto& generating = std::get<Generating>(of);
       return std::make_unique<GeneratingAction>(H, generating.F(H.degrees_of_freedom()), generating.order);
     },
     .node_law =
         [](const Hamiltonian& H, const SegmentLagrangian& of) {
           const auto& generating = std::get<Generating>(of);
           return NodeLaw(H, generating.F(H.degrees_of_freedom()), generating.order);
         }},
    // It has its own f(t_1 - t_0), if it wants one.
    {.name = "custom",
     .takes_potential = false,
     .action =
         [](const Hamiltonian& H, const SegmentLagrangian& of) {
           const auto& custom = std::get<Custom>(of);
           return stated(lagrangian_action(H, custom.L, custom.parameters));
         }},
    {.name = "gauss",
     .has_stages = true,
     .scheme = [](const Hamiltonian& H, const SegmentLagrangian& of,
                  std::span<const double> z_0) { return make_gauss_scheme(H, std::get<Gauss>(of).stages, z_0); },
     .quadrature =
         [](const SegmentLagrangian& of) { return ActionQuadrature(Points::gauss, std::get<Gauss>(of).stages); },
     .node_law = [](const Hamiltonian& H,
                    const SegmentLagrangian&) { return NodeLaw(H, std::numeric_limits<double>::quiet_NaN()); }},
    {.name = "splitting",
     .has_compositions = true,
     .constrains_hamiltonian = true,
     .scheme =
         [](const Hamiltonian& H, const SegmentLagrangian& of, std::span<const double> z_0) {
           return make_splitting_scheme(H, composition(std::get<Splitting>(of).composition), z_0);
         },
     .node_law =
         [](const Hamiltonian& H, const SegmentLagrangian& of) {
           return NodeLaw(H, composition(std::get<Splitting>(of).composition).gamma);
         }},
    {.name = "trapezoid", .quadrature = [](const SegmentLagrangian&) { return ActionQuadrature(Points::lobatto, 1); }},
    {.name = "lobatto",
     .has_stages = true,
     .quadrature =
         [](const SegmentLagrangian& of) {
           return ActionQuadrature(Points::lobatto, std::get<Lobatto>(of).points - 1);
         }},
};
static_assert(std::size(all_methods) == std::variant_size_v<SegmentLagrangian>);

}  // namespace

Eigen::MatrixXd Generating::F(std::size_t degrees_of_freedom) const {
  const auto n = static_cast<Eigen::Index>(degrees_of_freedom);
  const auto* type = std::get_if<DarbouxType>(&darboux);
  return type != nullptr ? darboux_symmetric(*type, n) : std::get<Eigen::MatrixXd>(darboux);
}

std::span<const OrbitMethod> orbit_methods() {
  return all_methods;
}

void require_constrained(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian) {
  if (hamiltonian.constraints().none() || method_of(lagrangian).constrains_hamiltonian) {
    return;
  }
  std::vector<std::string_view> names;
  for (const OrbitMethod& method : orbit_methods()) {
    if (method.constrains_hamiltonian) {
      names.push_back(method.name);
    }
  }
  throw std::invalid_argument(
      fmt::format("lagrangian = \"{}\" takes no constraints of a problem stated by H: use \"{}\", or state the problem "
                  "by its Lagrangian",
                  method_of(lagrangian).name, fmt::join(names, "\" or \"")));
}

const OrbitMethod& method_of(const SegmentLagrangian& lagrangian) {
  return all_methods[lagrangian.index()];
}

std::unique_ptr<OneStepScheme> make_one_step_scheme(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian,
                                                    std::span<const double> z_0) {
  const OrbitMethod& method = method_of(lagrangian);
  require_constrained(hamiltonian, lagrangian);
  if (method.scheme == nullptr) {
    throw std::invalid_argument(
        method.of_lagrangian()
            ? "the trapezoidal rule and Lobatto's are quadratures of L(q, q_dot): state the problem by its Lagrangian, "
              "or use Gauss collocation"
            : "this Lagrangian has no one-step form");
  }
  return method.scheme(hamiltonian, lagrangian, z_0);
}

std::unique_ptr<OneStepScheme> make_one_step_scheme(const Lagrangian& lagrangian, const SegmentLagrangian& quadrature,
                                                    std::span<const double> q, std::span<const double> q_dot) {
  const OrbitMethod& method = method_of(quadrature);
  if (!method.of_lagrangian()) {
    throw std::invalid_argument(
        "for a problem stated by L(q, q_dot) there are its quadratures: midpoint, trapezoid, lobatto and gauss; the "
        "other schemes are for problems stated by H");
  }
  return make_lagrangian_scheme(lagrangian, method.quadrature(quadrature), q, q_dot);
}

std::unique_ptr<DiscreteAction> make_action(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian) {
  if (!hamiltonian.constraints().none()) {
    throw std::invalid_argument("with constraints a scheme is a one-step map: leave out what needs its action");
  }
  if (method_of(lagrangian).is_map()) {
    throw std::invalid_argument("there is no action of a segment for this scheme");
  }
  return method_of(lagrangian).action(hamiltonian, lagrangian);
}

NodeLaw make_node_law(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian) {
  const auto make = method_of(lagrangian).node_law;
  return make == nullptr ? NodeLaw(hamiltonian) : make(hamiltonian, lagrangian);
}

}  // namespace rubato
