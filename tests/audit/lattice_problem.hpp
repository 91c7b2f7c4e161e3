#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "audit/expression.hpp"
#include "audit/level_rules.hpp"

namespace audit {

/// An entry of M₊ or K₊, where M = M₊ - M₊ᵀ.
struct MatrixEntry {
  std::size_t row, column;
  double value;
};

struct Axis {
  double from = 0.0, to = 1.0;
  std::size_t cells = 1;
  [[nodiscard]] double length() const { return to - from; }
  [[nodiscard]] double width() const { return length() / static_cast<double>(cells); }
};

/// A random lattice and how it is to be run.
struct LatticeProblem {
  enum class Lagrangian { box, fourier, euler_box, splitting };

  std::string family;
  std::vector<std::string> fields;
  std::vector<MatrixEntry> M;
  std::vector<std::vector<MatrixEntry>> K;  ///< for each axis
  Expression S = 0.0;
  std::vector<Axis> axes;  ///< x, and y in a plane
  double start_time = 0.0;
  std::vector<std::pair<std::size_t, Expression>> initial;  ///< fields as formulas in x and y
  /// What stands in [exact] for the first field with an equation of its own: a formula of x, (y,) t, exact or not.
  std::optional<Expression> exact;
  std::vector<bool> slaved;              ///< which fields follow from a constraint in space
  std::vector<bool> midpoint_only;       ///< which exist in the middle of steps only
  std::optional<std::size_t> potential;  ///< of which the record keeps the periodic part
  std::size_t derivative_of_potential = 0;

  Lagrangian lagrangian = Lagrangian::box;
  int stages = 1;                      ///< of box and fourier: more than one is Gauss collocation
  std::string composition = "golden";  ///< of a splitting
  bool differences = false;            ///< its derivatives in space
  bool turns = false;                  ///< what is left of S turns pairs of fields; else it kicks
  PotentialRule step_potential;
  bool fixed = false;
  double step = 0.0, until = 0.0;
  double tolerance = 1e-13;
  bool tolerance_given = false;
  std::string on_singular;  ///< empty: left out
  int max_steps = 300;
  int every = 1;

  [[nodiscard]] std::size_t nodes() const;
  /// Maps that are no variation of an action of the corners' values: theory, section 8.
  [[nodiscard]] bool is_family() const { return lagrangian == Lagrangian::splitting || stages > 1; }
  [[nodiscard]] int order_of_scheme() const;
  [[nodiscard]] bool has_step_potential() const;
  [[nodiscard]] LevelRules rules() const;
  [[nodiscard]] std::string toml() const;
};

/// The same for the same number, on every machine.
LatticeProblem random_lattice(std::uint64_t number);

}  // namespace audit
