#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato {

/// An expression as a polynomial of some variables, with coefficients that do not depend on them: by the numbers of
/// the variables in a monomial, ascending, with repetitions.
using Monomial = std::vector<std::size_t>;
using Polynomial = std::map<Monomial, formula::Expression>;

/// Takes expressions apart. Where a part is no polynomial, its variables are in `others`.
class Polynomials {
public:
  /// \param number of each variable of the polynomial, by its node
  Polynomials(formula::Graph& graph, const std::map<formula::NodeIndex, std::size_t>& number)
      : graph_(graph), number_(number) {}

  [[nodiscard]] std::optional<Polynomial> operator()(formula::Expression e) {
    if (const auto known = found_.find(e.index()); known != found_.end()) {
      return known->second;
    }
    std::optional<Polynomial> result = take_apart(e);
    return found_.emplace(e.index(), std::move(result)).first->second;
  }
  [[nodiscard]] const std::set<std::size_t>& others() const { return others_; }

private:
  static constexpr std::size_t most_degree = 8;

  [[nodiscard]] bool depends(formula::Expression e) const {
    const std::vector<std::size_t> variables = formula::variables_of(e);
    return std::ranges::any_of(number_, [&](const auto& entry) {
      return std::ranges::find(variables, graph_.node(entry.first).a) != variables.end();
    });
  }
  /// e is no polynomial although its parts are.
  std::optional<Polynomial> refuse(formula::Expression e) {
    const std::vector<std::size_t> variables = formula::variables_of(e);
    for (const auto& [node, number] : number_) {
      if (std::ranges::find(variables, graph_.node(node).a) != variables.end()) {
        others_.insert(number);
      }
    }
    return std::nullopt;
  }

  static void add(Polynomial& sum, const Monomial& monomial, formula::Expression coefficient) {
    const auto [place, is_new] = sum.emplace(monomial, coefficient);
    if (!is_new) {
      place->second = place->second + coefficient;
    }
  }
  static std::optional<Polynomial> product(const Polynomial& a, const Polynomial& b) {
    Polynomial result;
    for (const auto& [m, c] : a) {
      for (const auto& [n, d] : b) {
        Monomial both = m;
        both.insert(both.end(), n.begin(), n.end());
        std::ranges::sort(both);
        if (both.size() > most_degree) {
          return std::nullopt;
        }
        add(result, both, c * d);
      }
    }
    return result;
  }

  [[nodiscard]] std::optional<Polynomial> take_apart(formula::Expression e) {
    if (const auto variable = number_.find(e.index()); variable != number_.end()) {
      return Polynomial{{{variable->second}, graph_.constant(1.0)}};
    }
    if (!depends(e)) {
      return Polynomial{{{}, e}};
    }
    const formula::Node node = graph_.node(e.index());
    const formula::Expression a(&graph_, node.a), b(&graph_, node.b);
    switch (node.operation) {
      case formula::Operation::add:
      case formula::Operation::subtract: return sum(a, b, node.operation == formula::Operation::add ? 1.0 : -1.0);
      case formula::Operation::negate: return scaled((*this)(a), graph_.constant(-1.0));
      case formula::Operation::multiply: {
        const auto one = (*this)(a), other = (*this)(b);
        const auto both = one && other ? product(*one, *other) : std::nullopt;
        return both || !one || !other ? both : refuse(e);
      }
      case formula::Operation::divide: return depends(b) ? refuse(e) : scaled((*this)(a), 1.0 / b);
      case formula::Operation::power: return power(e, a, b);
      default: return refuse(e);
    }
  }
  [[nodiscard]] std::optional<Polynomial> sum(formula::Expression a, formula::Expression b, double sign) {
    auto result = (*this)(a);
    const auto other = (*this)(b);
    if (!result || !other) {
      return std::nullopt;
    }
    for (const auto& [monomial, coefficient] : *other) {
      add(*result, monomial, sign > 0 ? coefficient : -coefficient);
    }
    return result;
  }
  static std::optional<Polynomial> scaled(std::optional<Polynomial> polynomial, formula::Expression factor) {
    if (polynomial) {
      for (auto& [monomial, coefficient] : *polynomial) {
        coefficient = coefficient * factor;
      }
    }
    return polynomial;
  }
  [[nodiscard]] std::optional<Polynomial> power(formula::Expression e, formula::Expression a, formula::Expression b) {
    const double exponent = b.is_constant() ? b.constant_value() : -1.0;
    if (exponent < 1.0 || exponent > static_cast<double>(most_degree) || exponent != std::floor(exponent)) {
      return refuse(e);
    }
    const auto base = (*this)(a);
    std::optional<Polynomial> result = base;
    for (int n = 1; n < static_cast<int>(exponent) && result; ++n) {
      result = product(*result, *base);
    }
    return result || !base ? result : refuse(e);
  }

  formula::Graph& graph_;
  const std::map<formula::NodeIndex, std::size_t>& number_;
  std::map<formula::NodeIndex, std::optional<Polynomial>> found_;
  std::set<std::size_t> others_;
};

}  // namespace rubato
