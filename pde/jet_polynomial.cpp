#include <rubato/pde/jet_polynomial.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/pde/field_structure.hpp>

namespace rubato {

namespace {

/// The direction by which one differentiates more often than the other by most: φ φ_xxyy is to become (φ_xy)², not
/// φ_xx φ_yy, whose derivatives need twice the fields. Of equal ones the last of x, y, z, and t before these.
std::size_t most_apart(const DerivativeOrder& more, const DerivativeOrder& less) {
  std::size_t found = last_direction(more);
  for (std::size_t mu = more.size(); mu-- > 0;) {
    if (more.at(mu) - less.at(mu) > more.at(found) - less.at(found)) {
      found = mu;
    }
  }
  return found;
}

}  // namespace

int total(const Jet& jet) {
  return total_order(jet.order);
}

void add(JetPolynomial& sum, JetMonomial monomial, double coefficient) {
  std::ranges::sort(monomial);
  double& place = sum[monomial];
  place += coefficient;
  constexpr double rounding = 1e-13;  // of coefficients that cancel
  if (std::abs(place) <= rounding * std::abs(coefficient)) {
    sum.erase(monomial);
  }
}
void add(JetPolynomial& sum, const JetPolynomial& other, double factor) {
  for (const auto& [monomial, coefficient] : other) {
    add(sum, monomial, factor * coefficient);
  }
}

Jet shifted(Jet jet, std::size_t mu, int by) {
  jet.order.at(mu) += by;
  return jet;
}

JetPolynomial differentiated(const JetPolynomial& polynomial, std::size_t mu) {
  JetPolynomial result;
  for (const auto& [monomial, coefficient] : polynomial) {
    for (std::size_t i = 0; i < monomial.size(); ++i) {
      JetMonomial moved = monomial;
      moved[i] = shifted(moved[i], mu);
      add(result, moved, coefficient);
    }
  }
  return result;
}

JetPolynomial euler_operator(const JetPolynomial& L, std::size_t field) {
  std::map<DerivativeOrder, JetPolynomial> partial;
  for (const auto& [monomial, coefficient] : L) {
    for (std::size_t i = 0; i < monomial.size(); ++i) {
      if (monomial[i].field == field) {
        JetMonomial rest = monomial;
        rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
        add(partial[monomial[i].order], rest, coefficient);
      }
    }
  }
  JetPolynomial sum;
  for (auto& [order, polynomial] : partial) {
    double sign = 1.0;
    for (std::size_t mu = 0; mu < order.size(); ++mu) {
      for (int n = 0; n < order[mu]; ++n) {
        polynomial = differentiated(polynomial, mu);
        sign = -sign;
      }
    }
    add(sum, polynomial, sign);
  }
  return sum;
}

JetPolynomial reduced(const JetPolynomial& L) {
  JetPolynomial left = L, result;
  while (!left.empty()) {
    const auto [monomial, coefficient] = *left.begin();
    left.erase(left.begin());
    const auto highest = std::ranges::max_element(monomial, {}, total);
    const bool is_high = highest != monomial.end() && total(*highest) >= 2;
    if (is_high && monomial.size() == 2) {
      const Jet other = monomial[highest == monomial.begin() ? 1 : 0];
      if (total(*highest) - total(other) >= 2) {
        const std::size_t mu = most_apart(highest->order, other.order);
        add(left, JetMonomial{shifted(*highest, mu, -1), shifted(other, mu)}, -coefficient);
        continue;
      }
    } else if (is_high && monomial.size() > 2) {
      const std::size_t mu = last_direction(highest->order);
      const Jet lower = shifted(*highest, mu, -1);
      const auto stays = std::ranges::count_if(monomial, [&](const Jet& jet) {  // as high as it would get by this
        return jet != lower && total(jet) + 1 >= total(*highest);
      });
      if (stays > 1) {  // beside the highest itself
        add(result, monomial, coefficient);
        continue;
      }
      JetMonomial others;
      int power = 0;
      for (const Jet& jet : monomial) {
        power += jet == lower ? 1 : 0;
        if (jet != lower && jet != *highest) {
          others.push_back(jet);
        }
      }
      // c lower^k D(lower) others = D(c lower^(k+1)/(k+1) others) - c lower^(k+1)/(k+1) D(others).
      for (const auto& [moved, factor] : differentiated(JetPolynomial{{others, 1.0}}, mu)) {
        JetMonomial whole = moved;
        whole.insert(whole.end(), static_cast<std::size_t>(power) + 1, lower);
        add(left, whole, -coefficient * factor / (power + 1));
      }
      continue;
    }
    add(result, monomial, coefficient);
  }
  return result;
}

JetPolynomial with_derivatives_of(const JetPolynomial& L, std::size_t field) {
  const Jet bare{field, {}};
  const auto is_bare = [&bare](const JetMonomial& monomial) {
    return monomial.size() > 2 && std::ranges::find(monomial, bare) != monomial.end();
  };
  JetPolynomial left = L, result;
  while (!left.empty()) {
    const auto [monomial, coefficient] = *left.begin();
    left.erase(left.begin());
    if (!is_bare(monomial)) {
      add(result, monomial, coefficient);
      continue;
    }
    // φ lower^k D(lower) others, with fields in `others` that come later, so that this ends: u v φ (uv)_x meets itself.
    const auto moving = std::ranges::find_if(monomial, [](const Jet& jet) { return jet.order[1] == 1; });
    if (moving == monomial.end() || total(*moving) != 1 || moving->field == field) {
      return L;
    }
    const Jet lower = shifted(*moving, 1, -1);
    JetMonomial others = monomial;
    others.erase(std::ranges::find(others, *moving));
    others.erase(std::ranges::find(others, bare));
    const auto power = std::erase(others, lower);
    if (std::ranges::any_of(others, [](const Jet& jet) { return total(jet) > 0; })) {
      return L;
    }
    if (std::ranges::any_of(others, [&](const Jet& jet) { return jet.field < lower.field; })) {
      add(result, monomial, coefficient);
      continue;
    }
    others.push_back(bare);
    for (const auto& [moved, factor] : differentiated(JetPolynomial{{others, 1.0}}, 1)) {
      JetMonomial whole = moved;
      whole.insert(whole.end(), power + 1, lower);
      add(left, whole, -coefficient * factor / static_cast<double>(power + 1));
    }
  }
  const bool is_named = std::ranges::any_of(result, [&](const auto& entry) { return is_bare(entry.first); });
  return is_named ? L : result;
}

std::optional<JetPolynomial> integrated_by_x(JetPolynomial polynomial) {
  JetPolynomial G;
  constexpr int most_terms = 1000;
  for (int n = 0; n < most_terms && !polynomial.empty(); ++n) {
    const auto order_by_x = [](const Jet& jet) { return jet.order[1]; };
    const auto highest_of = [&](const auto& entry) {
      return entry.first.empty() ? -1 : order_by_x(*std::ranges::max_element(entry.first, {}, order_by_x));
    };
    const auto [monomial, coefficient] = *std::ranges::max_element(polynomial, {}, highest_of);
    const auto highest = std::ranges::max_element(monomial, {}, order_by_x);
    if (monomial.empty() || order_by_x(*highest) < 1 ||
        std::ranges::count(monomial, order_by_x(*highest), order_by_x) != 1) {
      return std::nullopt;
    }
    const Jet lower = shifted(*highest, 1, -1);
    JetMonomial whole = monomial;
    std::erase(whole, *highest);
    const auto power = std::ranges::count(whole, lower);
    whole.push_back(lower);
    JetPolynomial term;
    add(term, whole, coefficient / static_cast<double>(power + 1));
    add(G, term, 1.0);
    add(polynomial, differentiated(term, 1), -1.0);
  }
  return polynomial.empty() ? std::optional(G) : std::nullopt;
}

JetPolynomial of_potential(const JetPolynomial& polynomial, std::size_t field) {
  JetPolynomial result;
  for (const auto& [monomial, coefficient] : polynomial) {
    JetMonomial moved = monomial;
    std::ranges::transform(moved, moved.begin(),
                           [field](const Jet& jet) { return jet.field == field ? shifted(jet, 1) : jet; });
    add(result, moved, coefficient);
  }
  return result;
}

}  // namespace rubato
