#pragma once

#include <functional>
#include <memory>

#include <rubato/base/status.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/pde/action_kernel.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// The rows of a step solved together by Newton's method. Their matrix is sparse. On a line it is factored by SparseLU
/// (Eigen, COLAMD) with a border that holds what the rows do not determine; elsewhere GMRES solves with it,
/// preconditioned by its means in Fourier space. It serves for the corrections after as long as these contract. Results
/// depend on the lower level, h and where the search begins alone.
class ActionNewton {
public:
  /// Lets a code read the step.
  using Read = std::function<void(NodeCode&)>;

  ActionNewton(ActionRows& rows, const ActionEquations& equations, ActionKernel kernel);
  ~ActionNewton();
  ActionNewton(ActionNewton&&) noexcept;
  ActionNewton& operator=(ActionNewton&&) noexcept;

  /// Solves row = 0 for the solved fields in `after`. \param values room for one value of each row at each node
  [[nodiscard]] Status solve(double h, double accuracy, const grids::FieldSet& before, grids::FieldSet& after,
                             const Read& read, NodeCode& row, grids::FieldSet& values);
  /// Solves along + right = 0 for the solved fields of `direction`, in which `along` is linear.
  [[nodiscard]] bool solve_linear(double h, grids::FieldSet& direction, const Read& read, NodeCode& right,
                                  NodeCode& along, grids::FieldSet& values);
  /// The matrix of another lower level is another one, unless it depends on h alone.
  void leave_level();

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato
