#pragma once

#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/formula/taylor.hpp>
#include <rubato/ode/hamiltonian.hpp>

namespace rubato {

/// The exact flow z ↦ z + δ(z; h) of a Hamiltonian to high accuracy, by one or more Taylor steps: what a high-order
/// implicit scheme starts its first step from.
class FlowMap {
public:
  FlowMap(const Hamiltonian& hamiltonian, int order);

  /// Expands the flow from z for steps of about h, in as many parts as its convergence asks for.
  Status start(const Eigen::VectorXd& z, double h);
  /// δ(z; h) for the z of start(), at any h of about that size.
  void increment(double h, Eigen::VectorXd& delta) const;

  [[nodiscard]] int parts() const { return parts_; }
  [[nodiscard]] std::string failure() const { return flow_.failure(); }

private:
  void add_part(double h, Eigen::VectorXd& delta) const;
  [[nodiscard]] bool is_resolved() const;

  int order_;
  formula::TaylorFlow flow_;
  int parts_ = 1;
  double part_ = 0.0;  ///< length of every part but the last
  Eigen::VectorXd before_last_, point_;
};

/// The tangent M - I of that map: (M - I)v = ½(δ(z + v; h) - δ(z - v; h)) for a small displacement v, by Taylor steps
/// of a low order from both points side by side. Its use is as a Newton matrix.
class FlowTangent {
public:
  FlowTangent(const Hamiltonian& hamiltonian, int order);

  Status apply(const Eigen::VectorXd& z, const Eigen::VectorXd& v, double h, Eigen::VectorXd& result);
  /// The last terms of the Taylor series that went into the last result: how wrong it is, if they decrease.
  [[nodiscard]] const Eigen::VectorXd& last_terms() const { return last_terms_; }
  [[nodiscard]] std::string failure() const { return flow_.failure(); }

private:
  Status follow(const Eigen::VectorXd& z, const Eigen::VectorXd& v, double part, int parts);
  [[nodiscard]] bool resolved_in(const Eigen::VectorXd& v, const Eigen::VectorXd& result) const;

  int order_;
  formula::TaylorFlow flow_;  ///< from z + v and from z - v
  Eigen::VectorXd points_[2], last_terms_;
  Eigen::VectorXd displaced_;  ///< v as far as it is not rounded away
};

}  // namespace rubato
