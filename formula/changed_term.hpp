#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// A term of a formula that has different values at two points.
struct ChangedTerm {
  std::string term;
  double before = 0.0, after = 0.0;
};

/// Compares a formula at points with that at their images, on other branches (formula/branches.hpp): a symmetry leaves
/// the formula the same at all of them.
class ImageTest {
public:
  /// \throws std::invalid_argument as Bytecode
  ImageTest(Expression formula, std::span<const Expression> variables);

  /// The term that changes most if the formula changes by more than `same` of 1 + the largest term; nothing if it is
  /// the same. Points where the formula has no value say nothing; an image without one is a change.
  [[nodiscard]] std::optional<ChangedTerm> find_changed_term(std::span<const double> point,
                                                             std::span<const double> image, double same);

private:
  std::vector<Expression> terms_;  ///< the last one is the formula
  std::vector<ScalarEvaluator> evaluators_;
  std::vector<double> before_, after_;
};

}  // namespace rubato::formula
