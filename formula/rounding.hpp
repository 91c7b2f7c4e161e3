#pragma once

#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>

namespace rubato::formula {

class LoopRounding;

/// Evaluates code at one point and carries with every value a bound of its rounding error: a running error
/// analysis of first order (Higham, Accuracy and Stability of Numerical Algorithms, section 3.3),
///
///     |computed - exact| ≤ u·bound (1 + O(u)),   u = 2⁻⁵³,
///
/// that is Σ over the operations |∂output/∂result·result|, and the inputs' own errors carried along. Arithmetic and
/// sqrt are taken to round correctly, the other functions to within 2 u of the result (4 u for tan and the hyperbolic
/// ones), which the C libraries in use keep to. Where a derivative is infinite (log at 0, …) the bound may be, too.
///
/// Costs some three times an evaluation by the interpreter: callers that need it often look at it every 16th or 96th
/// step. Holds the registers; no allocation in run().
class RoundingEvaluator {
public:
  explicit RoundingEvaluator(const Bytecode& code);  ///< copies the code
  RoundingEvaluator() = default;

  /// At `inputs`, which are off by up to u·`errors`; as many as the code has inputs.
  void run(std::span<const double> inputs, std::span<const double> errors);
  [[nodiscard]] double value(std::size_t output) const { return values_[code_.outputs()[output]]; }
  [[nodiscard]] double bound(std::size_t output) const { return bounds_[code_.outputs()[output]]; }
  [[nodiscard]] std::size_t output_count() const { return code_.output_count(); }
  [[nodiscard]] const Bytecode& code() const { return code_; }

private:
  Bytecode code_;
  std::vector<double> values_, bounds_;  ///< of each register
  Copied<LoopRounding> loops_;           ///< of code with loops
};

/// How large a sum is at a point, and its rounding error.
struct SumSize {
  double terms = 0.0;       ///< |sum|, or 3 % of the sum of the magnitudes of its terms where that is more
  double cancelled = 0.0;   ///< 3 % of what cancels in the sum, Σ|terms| - |sum|
  double rounding = 0.0;    ///< bound of the sum's error, absolute
  double magnitudes = 0.0;  ///< Σ|terms|
};

/// Code for a SumSizeEvaluator: the sum, then its terms. `inputs`: variables of its graph.
[[nodiscard]] Bytecode sum_size_code(Expression sum, std::span<const Expression> inputs);

/// Both for the formula of a sum_size_code().
class SumSizeEvaluator {
public:
  explicit SumSizeEvaluator(const Bytecode& code);
  SumSizeEvaluator() = default;

  /// At `inputs` that are off by u·`errors`. Where the bound is not finite, rounding is that of the terms.
  [[nodiscard]] SumSize operator()(std::span<const double> inputs, std::span<const double> errors);
  /// At `inputs` that are means of rounded values, and rounded themselves: off by 2u·|input|.
  [[nodiscard]] SumSize operator()(std::span<const double> inputs);

private:
  RoundingEvaluator evaluator_;
  std::vector<double> errors_;
};

}  // namespace rubato::formula
