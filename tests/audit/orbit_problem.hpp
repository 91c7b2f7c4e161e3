#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "audit/expression.hpp"
#include "audit/level_rules.hpp"

namespace audit {

/// A random orbit and how it is to be run. Its variables are numbered q_1 … q_n, p_1 … p_n; where it is stated by
/// L(q, q̇), those of L are q_1 … q_n, q̇_1 … q̇_n, and invariants are formulas of q, p, q̇.
struct OrbitProblem {
  enum class Lagrangian { midpoint, generating, custom, forward, gauss, splitting };
  /// Of a problem stated by L: how the action of a step becomes a discrete Lagrangian.
  enum class Quadrature { none, midpoint, trapezoid, lobatto, gauss };

  std::string family;              ///< what kind of motion, and what is nasty about it
  std::vector<std::string> names;  ///< of q, then of p
  Expression H = 0.0;
  std::vector<double> start;  ///< z_0; coordinates and velocities where the problem is stated by L
  double start_time = 0.0;
  std::vector<double> next;  ///< z_1 where the problem gives it
  std::vector<std::pair<std::string, Expression>> invariants;
  /// What stands in [exact] for the first coordinate: a formula of t, exact or not.
  std::optional<Expression> exact;

  Lagrangian lagrangian = Lagrangian::midpoint;
  int order = 2;   ///< of a generating function
  int stages = 1;  ///< of Gauss collocation, or the points of Lobatto's rule
  std::string composition = "golden";
  bool by_order = false;  ///< the composition is asked for by its order
  Quadrature quadrature = Quadrature::none;
  std::string darboux = "midpoint";
  std::vector<double> F;  ///< of it, row by row; empty means 0
  Expression L = 0.0;     ///< of t_0, z_0, t_1, z_1, numbered in this order; or the one that states the problem
  bool fixed = false;
  double step = 0.0;
  std::optional<double> energy_tolerance;  ///< step = "auto"
  double until = 0.0;
  double tolerance = 1e-13;
  bool tolerance_given = false;
  std::string on_singular;  ///< empty: left out
  PotentialRule potential;
  int max_steps = 0;
  int every = 1;

  [[nodiscard]] bool is_stated_by_L() const { return quadrature != Quadrature::none; }
  /// One of the families that take a step potential where nothing is said of it.
  [[nodiscard]] bool is_family() const;
  [[nodiscard]] bool has_potential() const;
  [[nodiscard]] int order_of_scheme() const;
  [[nodiscard]] std::size_t degrees_of_freedom() const { return start.size() / 2; }
  /// Each value stands for the one before, so that the step equation needs two steps.
  [[nodiscard]] bool is_two_step() const {
    return lagrangian == Lagrangian::custom || lagrangian == Lagrangian::forward || !next.empty();
  }
  [[nodiscard]] std::vector<std::string> names_in_invariants() const;
  [[nodiscard]] LevelRules rules() const;
  [[nodiscard]] std::string toml() const;
};

/// The same for the same number, on every machine.
OrbitProblem random_orbit(std::uint64_t number);

}  // namespace audit
