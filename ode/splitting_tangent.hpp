#pragma once

#include <array>
#include <span>
#include <utility>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// The tangent of a step of a splitting (theory, section 8.2), part after part:
///
///     drift  V_q += a h T_pp(p) V_p,      kick  V_p -= b h V_qq(q) V_q.
///
/// Each part is a shear with a symmetric matrix, so that the whole preserves dp∧dq to rounding errors.
class SplittingTangent {
public:
  /// Keeps a reference to `composition`.
  SplittingTangent(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition);

  /// Replaces each of the columns (2n entries) by its image under the tangent of the step of length h from z.
  [[nodiscard]] Status operator()(std::span<const double> z, double h, std::span<double> columns);

private:
  /// The gradient of T or V, and the entries of its second derivatives that do not vanish.
  struct Half {
    explicit Half(const SplittingHalf& half);

    formula::ScalarEvaluator evaluate;
    std::vector<std::pair<std::size_t, std::size_t>> places;  ///< row and column of the entries
    std::vector<double> outputs;
  };

  const Composition& composition_;
  std::size_t n_;
  std::array<Half, 2> halves_;  ///< of kicks, of drifts
  std::vector<double> z_;
};

}  // namespace rubato
