#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>

#include <rubato/ode/darboux.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/lagrangian.hpp>
#include <rubato/ode/node_law.hpp>
#include <rubato/ode/segment_scheme.hpp>
#include <rubato/variation/action_quadrature.hpp>
#include <rubato/variation/discrete_action.hpp>

namespace rubato {

/// The midpoint 𝕃 (3.15), the default: order 2.
struct Midpoint {};
/// The forward 𝕃 (3.23). Refused beyond `forward_step_limit` steps unless `allow_unstable` (theory, section 2.2).
struct Forward {
  bool allow_unstable = false;
};
/// Any 𝕃, as a formula in t_0, t_1 and every coordinate and momentum with suffix _0 and _1.
struct Custom {
  std::string L;
  Hamiltonian::Parameters parameters = {};
};
/// The generating function of the flow of normal Darboux type F, truncated (theory, section 4): any order.
struct Generating {
  int order = 4;  ///< as generating_order() understands it: with F = 0 an odd one rounds up
  /// F by its name, or as a symmetric 2n × 2n matrix.
  std::variant<DarbouxType, Eigen::MatrixXd> darboux = DarbouxType::midpoint;

  [[nodiscard]] Eigen::MatrixXd F(std::size_t degrees_of_freedom) const;
};
/// Gauss collocation (make_gauss_scheme): order 2m with m stages, for any H.
struct Gauss {
  int stages = 3;
};
/// An explicit splitting of H = T(p) + V(q) (make_splitting_scheme).
struct Splitting {
  std::string composition = "golden";  ///< see composition()
};
/// The trapezoidal rule for the action of L(q, q̇) (make_lagrangian_scheme): order 2, Lobatto with two points.
struct Trapezoid {};
/// The Lobatto rule with 2 to 9 points for the action of L(q, q̇) (make_lagrangian_scheme): order 2 points - 2.
struct Lobatto {
  int points = 3;
};
/// Of a problem stated by L(q, q̇), Midpoint, Gauss, Trapezoid and Lobatto are quadratures of its action; of one stated
/// by H the last two are not available. In the order of orbit_methods().
using SegmentLagrangian = std::variant<Midpoint, Forward, Generating, Custom, Gauss, Splitting, Trapezoid, Lobatto>;

/// A discretisation of orbits: all that the integrator, the check of records and the reader of problems ask of it.
/// What it does not have is null.
struct OrbitMethod {
  std::string_view name;
  bool has_stages = false;
  bool has_compositions = false;
  bool has_orders = false;  ///< true if [scheme] has to give an order
  /// True if a step potential is chosen where a problem says nothing of it, nor of singular points.
  bool takes_potential = true;
  /// True if `scheme` takes an H with constraints; every quadrature takes an L with constraints.
  bool constrains_hamiltonian = false;

  /// The one-step map, of a problem stated by H. \param z_0 where it starts
  std::unique_ptr<OneStepScheme> (*scheme)(const Hamiltonian&, const SegmentLagrangian&,
                                           std::span<const double> z_0) = nullptr;
  /// Of the action of a problem stated by L.
  ActionQuadrature (*quadrature)(const SegmentLagrangian&) = nullptr;
  /// A = (t_1 - t_0)·𝕃 of a segment.
  std::unique_ptr<DiscreteAction> (*action)(const Hamiltonian&, const SegmentLagrangian&) = nullptr;
  /// What time levels read at a node; null: H and fᵀH_zz f.
  NodeLaw (*node_law)(const Hamiltonian&, const SegmentLagrangian&) = nullptr;

  [[nodiscard]] bool of_hamiltonian() const { return scheme != nullptr || action != nullptr; }
  [[nodiscard]] bool of_lagrangian() const { return quadrature != nullptr; }
  /// True if it is a one-step map that is reported as such, and not as an action: then there are no two-step form and
  /// no starting pair.
  [[nodiscard]] bool is_map() const { return action == nullptr; }
};

/// All there are, the default first.
[[nodiscard]] std::span<const OrbitMethod> orbit_methods();
[[nodiscard]] const OrbitMethod& method_of(const SegmentLagrangian& lagrangian);

/// \throws std::invalid_argument if H has constraints that this scheme does not take
void require_constrained(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian);

/// \throws std::invalid_argument as the scheme's own function, or if there is no one-step form
[[nodiscard]] std::unique_ptr<OneStepScheme> make_one_step_scheme(const Hamiltonian& hamiltonian,
                                                                  const SegmentLagrangian& lagrangian,
                                                                  std::span<const double> z_0);

/// The same of a problem stated by L. \throws std::invalid_argument as make_lagrangian_scheme(), or if the 𝕃 is not a
/// quadrature of an action
[[nodiscard]] std::unique_ptr<OneStepScheme> make_one_step_scheme(const Lagrangian& lagrangian,
                                                                  const SegmentLagrangian& quadrature,
                                                                  std::span<const double> q,
                                                                  std::span<const double> q_dot);

/// The action of a segment. \throws formula::ParseError (Custom); std::invalid_argument if there is none
[[nodiscard]] std::unique_ptr<DiscreteAction> make_action(const Hamiltonian& hamiltonian,
                                                          const SegmentLagrangian& lagrangian);

/// What the time levels of that 𝕃 read at a node. \throws std::invalid_argument as NodeLaw
[[nodiscard]] NodeLaw make_node_law(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian);

}  // namespace rubato
