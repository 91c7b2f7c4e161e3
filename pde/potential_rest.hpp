#pragma once

#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/expression.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// N = S - ½ zᵀLz as a formula of some of the fields, the others 0.
struct PotentialRest {
  std::shared_ptr<formula::Graph> graph;
  std::vector<formula::Expression> variables;  ///< one for each of the fields
  formula::Expression value;
};
/// `fields`: numbers of the fields that N is to be a formula of.
[[nodiscard]] PotentialRest rest_of_potential(const MultisymplecticSystem& system, const Eigen::MatrixXd& L,
                                              std::span<const int> fields);

/// ∇S(0): the linear terms of S. Not finite where S is not defined there.
[[nodiscard]] std::vector<double> potential_slopes_at_zero(const MultisymplecticSystem& system);

}  // namespace rubato
