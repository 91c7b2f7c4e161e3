#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// Steps of a splitting that are long as one formula, or of which most goes in loops: a few parts at a time, most often
/// a kick and the drift after it, are one formula, a pass, which is gone through again and again. Where a step begins
/// and ends with kicks the gradient of V at its end is kept for the beginning of the next. The operations are those of
/// SplittingFormula, with their roundings.
class SplittingPasses {
public:
  SplittingPasses(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition);

  /// Room for two levels: numbers as those of a SplittingState, and some more.
  [[nodiscard]] std::array<std::span<double>, 2> levels();

  /// The step of length h from one of these levels to the other. \return E
  [[nodiscard]] double operator()(double h, double* here, double* there);

  /// The numbers of levels have been changed by others.
  void forget() { potential_.fill(std::nullopt); }

private:
  struct Pass {
    formula::ScalarEvaluator evaluate;
    std::size_t parts = 0;            ///< of the composition; 0: there is no such pass
    std::ptrdiff_t from = 0, to = 0;  ///< where its numbers stand, but for the lengths in front, and where they go
  };

  void know_potential(double* level);
  [[nodiscard]] std::optional<double>& potential_of(const double* level) {
    return potential_[level == levels_[0] ? 0 : 1];
  }

  const Composition* composition_;
  std::size_t n_;
  bool kicks_first_;
  Pass first_;                                 ///< drift, kick, drift; or a kick by what is kept, and the drift
  Pass inner_;                                 ///< kick, drift
  Pass last_;                                  ///< the last kick
  std::optional<formula::ScalarEvaluator> T_;  ///< at the last level, where the last part is a drift
  std::optional<formula::ScalarEvaluator> V_;  ///< and its gradient, where a kick is the first part
  std::vector<double> memory_;
  /// To the numbers of a SplittingState, behind which ∇V may be kept, and V and T. Before them there is room for p and
  /// its low digits, which the last kick takes from there.
  std::array<double*, 2> levels_{}, between_{};
  std::array<std::optional<double>, 2> potential_;  ///< V at these levels, if its gradient is kept there
};

}  // namespace rubato
