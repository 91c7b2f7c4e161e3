#pragma once

#include <vector>

#include <Eigen/Core>

#include <rubato/base/outcome.hpp>
#include <rubato/formula/taylor.hpp>
#include <rubato/ode/hamiltonian.hpp>

namespace rubato {

/// The exact flow z ↦ z + δ(z; h) of a Hamiltonian to high accuracy, by one or more Taylor steps: what a high-order
/// implicit scheme starts from, and whose derivative is its Newton matrix. Univariate series cost O(order²), next to
/// nothing beside the O(order⁴) of a generating function.
class FlowMap {
public:
  FlowMap(const Hamiltonian& hamiltonian, int order);

  /// Expands the flow from z for steps of about h, in as many parts as its convergence asks for.
  Status start(const Eigen::VectorXd& z, double h);
  /// δ(z; h) for the z of start(), at any h of about that size.
  void increment(double h, Eigen::VectorXd& delta) const;
  /// δ(z + v; h) for another starting point, in the same parts.
  Status increment_from(const Eigen::VectorXd& z, double h, Eigen::VectorXd& delta);

  [[nodiscard]] int parts() const { return parts_; }
  [[nodiscard]] std::string failure() const { return flow_.failure(); }

private:
  Status follow(formula::TaylorFlow& flow, const Eigen::VectorXd& z, Eigen::VectorXd& before_last);
  void add_part(const formula::TaylorFlow& flow, double h, Eigen::VectorXd& delta) const;

  int order_;
  formula::TaylorFlow flow_, other_;
  int parts_ = 1;
  double part_ = 0.0;  ///< length of every part but the last
  Eigen::VectorXd before_last_, other_before_last_, point_;
};

}  // namespace rubato
