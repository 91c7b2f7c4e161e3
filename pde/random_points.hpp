#pragma once

#include <vector>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// S, its derivatives by the fields, and those by the coordinates that it names, at a point of both.
struct PotentialSample {
  Eigen::VectorXd point, gradient, sources;
  double S = 0.0;
};

/// S, ∂S/∂z of all fields, and the sources, of the variables of the system, on other branches at all scales
/// (formula/branches.hpp). What holds of these at random points holds of S everywhere.
[[nodiscard]] std::vector<formula::ScalarEvaluator> potentials_on_branches(const MultisymplecticSystem& system);

/// As many samples of S on other branches at random points where all of them are finite, or fewer where S is defined at
/// few: then positive points are tried, too. The same for every call. \param sizes what the fields are multiplied by
[[nodiscard]] std::vector<PotentialSample> samples_of(const MultisymplecticSystem& system, Eigen::Index wanted,
                                                      const Eigen::VectorXd& sizes);
[[nodiscard]] std::vector<PotentialSample> samples_of(const MultisymplecticSystem& system, Eigen::Index wanted);

/// The twelfth nearest to x, if x is it but for rounding errors: symmetries found by linear algebra have such numbers.
[[nodiscard]] double nearest_twelfth(double x);

}  // namespace rubato
