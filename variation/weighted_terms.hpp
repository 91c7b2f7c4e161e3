#pragma once

#include <map>
#include <utility>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato {

/// A sum Σ weight·term in which each term stands once.
///
/// Sums, differences, signs, and products and quotients with constants are taken apart; but not sums and differences of
/// mere variables, so that a difference of equal values stays exactly zero.
class WeightedTerms {
public:
  WeightedTerms() = default;
  explicit WeightedTerms(formula::Expression sum) { add(sum); }

  void add(formula::Expression sum, double weight = 1.0);
  /// In the order in which they came.
  [[nodiscard]] const std::vector<std::pair<formula::Expression, double>>& terms() const { return terms_; }
  /// The sum; invalid if there is no term.
  [[nodiscard]] formula::Expression sum() const;

private:
  std::vector<std::pair<formula::Expression, double>> terms_;
  std::map<formula::NodeIndex, std::size_t> places_;
};

}  // namespace rubato
