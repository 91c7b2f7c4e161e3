#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <rubato/formula/expression.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// T or V of a separable H, with its gradient: formulas of the n variables that it depends on.
struct SplittingHalf {
  SplittingHalf(formula::Expression energy, std::span<const formula::Expression> variables);

  /// The value and the gradient at a point that is told by formulas of another graph.
  [[nodiscard]] std::vector<formula::Expression> at(std::span<const formula::Expression> point,
                                                    formula::Graph& graph) const;

  std::vector<formula::Expression> variables;
  std::vector<formula::Expression> outputs;  ///< the value, then its gradient
  formula::Bytecode code;                    ///< of `outputs`
};

/// A whole step of a splitting as formulas of one graph, (z in its two parts, h) ↦ (E, δ): the operations of part after
/// part, with their numbers, which machine code then keeps in registers from one part to the next.
struct SplittingFormula {
  std::shared_ptr<formula::Graph> graph;
  std::vector<formula::Expression> high, low;  ///< z = high + low, 2n entries each
  formula::Expression h;
  formula::Expression energy;              ///< E
  std::vector<formula::Expression> delta;  ///< δ, 2n entries

  /// high, low and h.
  [[nodiscard]] std::vector<formula::Expression> inputs() const;
};

/// Whether a step would be long as one formula.
[[nodiscard]] bool is_long(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition);

/// None where that would be long: more than longest_splitting_formula instructions.
[[nodiscard]] std::optional<SplittingFormula> splitting_formula(const SplittingHalf& T, const SplittingHalf& V,
                                                                const Composition& composition);
/// To compile so many takes a millisecond.
inline constexpr std::size_t longest_splitting_formula = 4000;

}  // namespace rubato
