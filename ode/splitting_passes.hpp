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

/// Steps of a splitting that are long as one formula, or of which most goes in loops: a kick and the drift after it are
/// one formula, a pass, which is gone through again and again, and what is left of the composition, the drift it begins
/// with or the kick it ends with, another. The operations are those of SplittingFormula, with their roundings.
class SplittingPasses {
public:
  SplittingPasses(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition);

  /// Room for two levels: numbers as those of a SplittingState, and two more.
  [[nodiscard]] std::array<std::span<double>, 2> levels();

  /// The step of length h from one of these levels to the other. \return E
  [[nodiscard]] double operator()(double h, double* here, double* there);

private:
  const Composition* composition_;
  std::size_t n_;
  formula::ScalarEvaluator pass_;
  std::optional<formula::ScalarEvaluator> drift_, kick_;  ///< the first, or the last part
  std::optional<formula::ScalarEvaluator> T_;             ///< at the last level, where the last part is a drift
  std::vector<double> memory_;
  std::array<double*, 2> levels_{}, between_{};
};

}  // namespace rubato
