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

  /// The value and the gradient at a point that is given by formulas of another graph.
  [[nodiscard]] std::vector<formula::Expression> at(std::span<const formula::Expression> point,
                                                    formula::Graph& graph) const;

  std::vector<formula::Expression> variables;
  std::vector<formula::Expression> outputs;  ///< the value, then its gradient
  formula::Bytecode code;                    ///< of `outputs`
};

/// z = high + low as formulas that follow each other along the parts of a step. What a part adds to a number takes up
/// its low part first, and what rounding leaves of the sum is the new one (Kahan, Comm. ACM 8 (1965) 40): a step loses
/// digits of what its parts add, not of z.
class SplittingState {
public:
  /// n entries each: low digits of q, q, p, low digits of p, so that z stands in one piece, and so does what a part
  /// moves.
  static constexpr std::size_t parts = 4;

  /// Variables of the graph.
  SplittingState(std::size_t n, formula::Graph& graph);

  /// All numbers, in their order.
  [[nodiscard]] std::vector<formula::Expression> all() const;
  /// z, 2n entries.
  [[nodiscard]] std::vector<formula::Expression> high() const;
  /// What a drift moves, and what a kick does: numbers and low digits as they stand in all().
  ///@{
  [[nodiscard]] std::vector<formula::Expression> positions() const;
  [[nodiscard]] std::vector<formula::Expression> momenta() const;
  ///@}

  /// Adds `length` times the gradient of T to q (a drift), or of V to p. \return T or V, and the gradient
  std::vector<formula::Expression> move(const SplittingHalf& half, bool drift, formula::Expression length);
  /// The same by a gradient that is known.
  void move_along(std::span<const formula::Expression> gradient, bool drift, formula::Expression length);

private:
  std::vector<formula::Expression> q_, p_, low_q_, low_p_;
};

/// A whole step of a splitting as formulas of one graph, (z in its two parts, h) ↦ (E, the next z in its two parts):
/// the operations of part after part, with their numbers, which machine code then keeps in registers from one part to
/// the next.
struct SplittingFormula {
  std::shared_ptr<formula::Graph> graph;
  SplittingState here, there;
  formula::Expression h, energy;

  /// Those of z, and h.
  [[nodiscard]] std::vector<formula::Expression> inputs() const;
};

/// True if a step would be long as one formula.
[[nodiscard]] bool is_long(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition);

/// None where that would be long: more than longest_splitting_formula instructions.
[[nodiscard]] std::optional<SplittingFormula> splitting_formula(const SplittingHalf& T, const SplittingHalf& V,
                                                                const Composition& composition);
/// To compile so many takes a millisecond.
inline constexpr std::size_t longest_splitting_formula = 4000;

}  // namespace rubato
