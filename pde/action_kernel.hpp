#pragma once

#include <array>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/pde/action_rows.hpp>

namespace rubato {

/// Rows to be solved for as many fields of the upper level, and their derivatives that are not zero.
struct ActionEquations {
  /// ∂row/∂(field number `column` at the node `offset` further).
  struct Entry {
    int row = 0, column = 0;
    std::array<int, 3> offset{};
    formula::Expression value;
  };
  std::vector<int> fields;
  std::vector<formula::Expression> rows;
  std::vector<Entry> entries;
};
[[nodiscard]] ActionEquations action_equations(const ActionRows& rows, std::vector<int> fields,
                                               std::vector<formula::Expression> of_fields);

/// A mode of the upper level that the rows of a step do not see, whatever the fields are: an amplitude for each solved
/// field, the same at all nodes or, along some axes, (-1)^i. A step holds `pinned` of it.
struct KernelMode {
  std::array<bool, 3> sawtooth{};
  int pinned = 0;
  int line = -1;  ///< an axis: any wave along the others
};
/// A combination of the rows that vanishes whatever the upper level is, with the same signs.
struct KernelRow {
  std::array<bool, 3> sawtooth{};
  Eigen::VectorXd weights;
};

struct ActionKernel {
  std::vector<KernelMode> modes;
  std::vector<KernelRow> rows;
  /// Of each solved field: values in ratios of these make the same of the rows, whatever the units are.
  Eigen::VectorXd units;
};

/// The kernel of the rows of a step of length h. Waves are looked at one by one, at fields that are the same
/// everywhere: the constant, the sawtooths of axes with an even number of cells, and a generic one. \throws
/// std::invalid_argument if a generic wave is in it, with the field that L does not determine
[[nodiscard]] ActionKernel find_kernel(const ActionRows& rows, const ActionEquations& equations, double h);

/// "the mean of phi", "the sawtooth (-1)^i of u"; in the plane "the mean of phi along x".
[[nodiscard]] std::string describe(const KernelMode& mode, const ActionRows& rows, const ActionEquations& equations);

}  // namespace rubato
