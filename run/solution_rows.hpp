#pragma once

#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/ode/boundary_value.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// What the record of a boundary-value problem has of its levels and steps: made from the solution, and for a check
/// from the states of the record.
struct SolutionRows {
  std::vector<double> t, gamma, node_energy;            ///< of levels
  std::vector<double> q_dot;                            ///< of levels, n each, of a problem stated by L
  std::vector<double> h, energy, potential, condition;  ///< of steps
  double rounding = 0.0;                                ///< of every E_k
  std::vector<std::string> invariant_names;
  std::vector<std::vector<double>> invariants;  ///< a list of levels for each

  /// \param solution its orbit, energy and potential
  SolutionRows(const Problem& problem, const BoundaryValueSolution& solution);

  [[nodiscard]] figures::Statistics statistics(const BoundaryValueSolution& solution) const;
};

/// The options that [solve] and [scheme] stand for; of a symmetric problem those of the whole orbit.
[[nodiscard]] BoundaryValueOptions make_boundary_value_options(const Problem& problem);

/// Where the record of a solution has the numbers of its step potential, and the residual after every iteration.
///@{
inline constexpr const char* solution_potential = "/solve/step_potential";
inline constexpr const char* solution_history = "/solve/residual";
///@}

}  // namespace rubato
