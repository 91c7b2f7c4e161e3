#include <rubato/variation/corner_differences.hpp>

#include <algorithm>
#include <array>
#include <cstddef>

#include <rubato/variation/random_values.hpp>

namespace rubato {

namespace {

using formula::Expression;

bool reads_any(Expression formula, const std::vector<Expression>& variables) {
  const auto numbers = formula::variables_of(formula);
  return std::ranges::any_of(variables, [&](const Expression& variable) {
    return std::ranges::find(numbers, formula::variables_of(variable).front()) != numbers.end();
  });
}

std::vector<Expression> by_corners(Expression formula, const CornerDensity& density, int field) {
  std::vector<Expression> corners;
  for (int c = 0; c < density.corner_count(); ++c) {
    corners.push_back(density.corner(field, c));
  }
  return formula::gradient(formula, corners);
}

Expression sum_of(const std::vector<Expression>& terms) {
  Expression sum = terms.front();
  for (std::size_t i = 1; i < terms.size(); ++i) {
    sum += terms[i];
  }
  return sum;
}

/// The a_c: constants in the cells of a step, whose sum over a level is the other's with the opposite sign, and h times
/// it has no h. Empty if there are none.
std::vector<Expression> divergence_of(const CornerDensity& density, int f, int g) {
  const std::vector<Expression> first = by_corners(density.L, density, f);
  std::vector<Expression> terms;
  for (const Expression& one : first) {
    const std::vector<Expression> second = by_corners(one, density, g);
    terms.insert(terms.end(), second.begin(), second.end());
  }
  std::vector<Expression> weights = by_corners(sum_of(first), density, g);
  std::array<Expression, 2> of_level;
  bool any = false;
  for (std::size_t c = 0; c < weights.size(); ++c) {
    Expression& weight = weights[c];
    weight = vanishes_at_random(weight, terms) ? density.graph->constant(0.0) : (f == g ? 0.5 : 1.0) * weight;
    Expression& sum = of_level[c < weights.size() / 2 ? 0 : 1];
    sum = sum.valid() ? sum + weight : weight;
    any = any || !weight.is_constant() || weight.constant_value() != 0.0;
    if (reads_any(weight, density.corners) || reads_any(weight, density.places)) {
      return {};
    }
  }
  const Expression h = density.spacings.front();
  const bool is_divergence = vanishes_at_random(of_level[0] + of_level[1], terms) &&
                             vanishes_at_random(formula::derivative(h * of_level[1], h), terms);
  return any && is_divergence ? weights : std::vector<Expression>();
}

}  // namespace

bool reads_differences(const CornerDensity& density, int field) {
  const std::vector<Expression> first = by_corners(density.L, density, field);
  return vanishes_at_random(sum_of(first), first);
}

CornerDensity by_differences(CornerDensity density, const std::vector<bool>& of_fields) {
  const auto is_one = [&](int f) { return !of_fields.empty() && of_fields[static_cast<std::size_t>(f)]; };
  for (int f = 0; f < density.fields; ++f) {
    if (!is_one(f) || !density.names(f) || reads_differences(density, f)) {
      continue;
    }
    for (int g = 0; g < density.fields; ++g) {
      if (!density.names(g) || (g < f && is_one(g))) {  // what was done for g stays
        continue;
      }
      const std::vector<Expression> weights = divergence_of(density, f, g);
      for (std::size_t c = 0; c < weights.size(); ++c) {
        const int corner = static_cast<int>(c);
        density.L = density.L - weights[c] * (density.corner(f, corner) * density.corner(g, corner));
      }
    }
  }
  return density;
}

}  // namespace rubato
