#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>

namespace rubato::solve {

/// Equations F(u) = 0 of any number of unknowns, which solve for their own corrections. Both are scaled: u and F are of
/// size 1.
class Equations {
public:
  Equations() = default;
  Equations(const Equations&) = delete;
  Equations& operator=(const Equations&) = delete;
  virtual ~Equations() = default;
  /// F at u, and keeps its derivatives J there where wanted. \return Status::undefined outside the domain
  virtual Status evaluate(const Eigen::VectorXd& u, Eigen::VectorXd& residual, bool with_derivatives) = 0;
  /// Factors the derivatives that were kept last. \param damping as DampedLeastSquares has it
  virtual Status factor(double damping) = 0;
  /// The correction x of least norm: J x = -r, with the factors. \return Status::ill_conditioned where x is not finite
  virtual Status solve(const Eigen::VectorXd& r, Eigen::VectorXd& x) = 0;
  /// A row, for people.
  [[nodiscard]] virtual std::string describe(Eigen::Index row) const = 0;
  /// The place that was not defined when evaluate() failed last, for people.
  [[nodiscard]] virtual std::string describe_failure() const = 0;
};

/// An iteration of Newton's method.
struct NewtonIteration {
  int stage = 0;            ///< of a search in several parts; of orbits see BoundaryValueSolution
  double residual = 0.0;    ///< max |F| after it
  double correction = 0.0;  ///< |Δu| over |u|; 0 where the iteration starts
  double fraction = 0.0;    ///< how much of it was taken: 1 but for damping
};

/// How a search ended.
struct NewtonSearch {
  Status status = Status::not_converged;
  double residual = 0.0;  ///< max |F|
  std::string worst;      ///< the equation that leaves most, or the place that is not defined

  /// Why nothing was found, for people. \param iterations how many there were
  [[nodiscard]] std::string message(std::size_t iterations) const;
};

/// Newton's method from u, which it improves, with corrections of least norm: where solutions are not isolated it goes
/// to one near the start, and equations that follow from others do no harm.
///
/// A correction is taken as far as it brings the next one down: the natural monotonicity test |J⁺F(u + λΔu)| <=
/// (1 - λ/4)|Δu| (Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004, section 3.3), which sees distances
/// from the solution, and not residuals in units of their own.
/// \param tolerance of the largest residual; below it the iteration goes on down to rounding
/// \param history receives every iteration, with this number of the stage
/// \throws Interrupted between iterations, if that is asked for
[[nodiscard]] NewtonSearch find_zero(Equations& equations, double tolerance, std::size_t most_iterations, int stage,
                                     Eigen::VectorXd& u, std::vector<NewtonIteration>& history);

}  // namespace rubato::solve
