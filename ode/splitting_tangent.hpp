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

/// T or V of a splitting with its gradient and the entries of its second derivatives that do not vanish.
class SplittingHalfTangent {
public:
  explicit SplittingHalfTangent(const SplittingHalf& half);

  /// At the numbers that it depends on.
  void evaluate(std::span<const double> point) { evaluate_(point, outputs_); }
  [[nodiscard]] std::span<const double> gradient() const {
    return std::span<const double>(outputs_).first(outputs_.size() - places_.size());
  }
  /// moved += length times the matrix of second derivatives times by.
  void shear(double length, const double* by, double* moved) const;

private:
  formula::ScalarEvaluator evaluate_;
  std::vector<std::pair<std::size_t, std::size_t>> places_;  ///< row and column of the entries
  std::vector<double> outputs_;
};

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
  const Composition& composition_;
  std::size_t n_;
  std::array<SplittingHalfTangent, 2> halves_;  ///< of kicks, of drifts
  std::vector<double> z_;
};

}  // namespace rubato
