#include <rubato/formula/changed_term.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/formula/branches.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato::formula {

ImageTest::ImageTest(Expression formula, std::span<const Expression> variables)
    : terms_(terms_of(formula, Products::expanded)) {
  terms_.push_back(formula);
  evaluators_ = evaluators_on_branches(terms_, variables);
  before_.resize(terms_.size());
  after_.resize(terms_.size());
}

std::optional<ChangedTerm> ImageTest::find_changed_term(std::span<const double> point, std::span<const double> image,
                                                        double same) {
  for (ScalarEvaluator& evaluate : evaluators_) {
    evaluate(point, before_);
    if (!std::isfinite(before_.back())) {
      continue;
    }
    evaluate(image, after_);
    double size = 0.0, most = 0.0;
    std::size_t worst = 0;
    for (std::size_t t = 0; t + 1 < terms_.size(); ++t) {
      size = std::max({size, std::abs(before_[t]), std::abs(after_[t])});
      if (const double change = std::abs(after_[t] - before_[t]); change > most) {
        most = change;
        worst = t;
      }
    }
    if (!(std::abs(after_.back() - before_.back()) <= same * (1.0 + size))) {
      return ChangedTerm{to_string(terms_[worst]), before_[worst], after_[worst]};
    }
  }
  return std::nullopt;
}

}  // namespace rubato::formula
