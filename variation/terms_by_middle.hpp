#pragma once

#include <array>
#include <map>

#include <rubato/variation/node_code.hpp>
#include <rubato/variation/weighted_terms.hpp>

namespace rubato {

/// A sum of terms, each of which counts where its middle is between walls (NodeFormulas::between_walls).
class TermsByMiddle {
public:
  /// \param middle twice its place, in nodes from this one
  void add(formula::Expression term, double weight, const std::array<int, 3>& middle) {
    by_middle_[middle].add(term, weight);
  }
  [[nodiscard]] formula::Expression sum(NodeFormulas& formulas) const {
    formula::Expression all;
    for (const auto& [middle, terms] : by_middle_) {
      if (const formula::Expression sum = terms.sum(); sum.valid()) {
        add_weighted(all, 1.0, formulas.between_walls(sum, middle));
      }
    }
    return all.valid() ? all : formulas.graph().constant(0.0);
  }

private:
  std::map<std::array<int, 3>, WeightedTerms> by_middle_;
};

}  // namespace rubato
