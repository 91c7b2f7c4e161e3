// Densities found for equations: equations that were derived from a random density, by total derivatives of formulas,
// have one with the same action, up to a factor; with a term more that no density has they are refused.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/inverse_problem.hpp>

using namespace rubato;
using Catch::Matchers::Contains;
using formula::Expression;

namespace {

/// The variables of fields and their derivatives, and what is made of them.
class Jets {
public:
  explicit Jets(std::vector<std::string> fields) : fields_(std::move(fields)) {}

  Expression operator()(std::size_t field, const DerivativeOrder& order) {
    const auto found = all_.find({field, order});
    if (found != all_.end()) {
      return found->second;
    }
    const bool plain = order == DerivativeOrder{};
    const Expression variable = graph_->variable(plain ? fields_[field] : derivative_name(fields_[field], order));
    return all_.emplace(std::pair(field, order), variable).first->second;
  }
  /// D_mu, by the chain rule.
  Expression total_derivative(Expression e, std::size_t mu) {
    Expression sum = graph_->constant(0.0);
    for (const auto& [jet, variable] : std::map(all_)) {
      const Expression slope = formula::derivative(e, variable);
      if (!slope.is_constant(0.0)) {
        DerivativeOrder order = jet.second;
        ++order.at(mu);
        sum = sum + slope * (*this)(jet.first, order);
      }
    }
    return sum;
  }
  /// Σ_J (-D)^J ∂L/∂u_J.
  Expression euler(Expression L, std::size_t field) {
    Expression sum = graph_->constant(0.0);
    for (const auto& [jet, variable] : std::map(all_)) {
      if (jet.first != field) {
        continue;
      }
      Expression term = formula::derivative(L, variable);
      for (std::size_t mu = 0; mu < jet.second.size(); ++mu) {
        for (int n = 0; n < jet.second[mu]; ++n) {
          term = -total_derivative(term, mu);
        }
      }
      sum = sum + term;
    }
    return sum;
  }
  FieldEquations equations(std::vector<Expression> all) {
    FieldEquations stated{graph_, fields_, {}, 1, std::move(all)};
    for (const auto& [jet, variable] : all_) {
      if (jet.second != DerivativeOrder{}) {
        stated.derivatives.push_back({jet.first, jet.second, variable});
      }
    }
    return stated;
  }
  [[nodiscard]] formula::Graph& graph() { return *graph_; }
  [[nodiscard]] const std::vector<std::string>& fields() const { return fields_; }
  [[nodiscard]] const auto& all() const { return all_; }

private:
  std::shared_ptr<formula::Graph> graph_ = std::make_shared<formula::Graph>();
  std::vector<std::string> fields_;
  std::map<std::pair<std::size_t, DerivativeOrder>, Expression> all_;
};

/// ∫ of a density over the torus, of waves that a seed chooses.
double action(const FieldDensity& density, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> amplitude(-1.0, 1.0);
  constexpr int waves = 3, points = 24;  // at most two turns in each of at most four factors
  std::vector<std::array<double, 4>> all;
  for (std::size_t i = 0; i < waves * density.fields.size(); ++i) {
    all.push_back({amplitude(random), std::floor(2.5 * amplitude(random)), std::floor(2.5 * amplitude(random)),
                   3.0 * amplitude(random)});
  }
  std::vector<Expression> inputs;
  std::vector<std::pair<std::size_t, DerivativeOrder>> jets;
  for (std::size_t f = 0; f < density.fields.size(); ++f) {
    inputs.push_back(density.graph->variable(density.fields[f]));
    jets.emplace_back(f, DerivativeOrder{});
  }
  for (const auto& [field, order, variable] : density.derivatives) {
    inputs.push_back(variable);
    jets.emplace_back(field, order);
  }
  formula::ScalarEvaluator L(formula::Bytecode(std::array{density.L}, inputs));
  double sum = 0.0;
  for (int i = 0; i < points; ++i) {
    for (int j = 0; j < points; ++j) {
      std::vector<double> at;
      for (const auto& [field, order] : jets) {
        double value = 0.0;
        for (std::size_t n = 0; n < waves; ++n) {
          const auto& [c, w, k, phase] = all[field * waves + n];
          const double argument = 2.0 * std::numbers::pi * (w * i + k * j) / points + phase;
          value += c * std::pow(w, order[0]) * std::pow(k, order[1]) *
                   std::cos(argument + 0.5 * std::numbers::pi * (order[0] + order[1]));
        }
        at.push_back(value);
      }
      sum += L.at(at.data())[0];
    }
  }
  return sum / (points * points);
}

/// A random polynomial density of u and v and their first derivatives and second ones by x.
Expression random_density(Jets& jets, std::mt19937_64& random) {
  constexpr std::array<DerivativeOrder, 4> orders = {{{0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {0, 2, 0, 0}}};
  std::uniform_real_distribution<double> coefficient(0.2, 1.0);
  const auto choose = [&](std::size_t count) {
    return std::uniform_int_distribution<std::size_t>(0, count - 1)(random);
  };
  Expression L = jets.graph().constant(0.0);
  for (std::size_t i = 0, count = 2 + choose(4); i < count; ++i) {
    Expression term = jets.graph().constant(coefficient(random));
    for (std::size_t j = 0, factors = 2 + choose(3); j < factors; ++j) {
      term = term * jets(choose(jets.fields().size()), orders.at(choose(orders.size())));
    }
    L = L + term;
  }
  return L;
}

FieldDensity density_of(Jets& jets, Expression L) {
  FieldDensity density{jets.equations({}).graph, jets.fields(), jets.equations({}).derivatives, 1, L, {}};
  return density;
}

std::string refusal(const FieldEquations& equations) {
  try {
    static_cast<void>(density_of(equations));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "found";
}

}  // namespace

TEST_CASE("equations of a density have a density with its action") {
  std::mt19937_64 random(7);
  int compared = 0;
  for (int i = 0; i < 100; ++i) {
    Jets jets(i % 2 == 0 ? std::vector<std::string>{"u"} : std::vector<std::string>{"u", "v"});
    const Expression L = random_density(jets, random);
    std::vector<Expression> rows;
    for (std::size_t f = 0; f < jets.fields().size(); ++f) {
      rows.push_back(jets.euler(L, f));
    }
    if (std::ranges::any_of(rows, [](Expression row) { return formula::variables_of(row).empty(); })) {
      continue;  // a field that the action does not have
    }
    const FieldDensity stated = density_of(jets, L), found = density_of(jets.equations(rows));
    INFO("density " << i << ": " << formula::to_string(L) << " became " << formula::to_string(found.L));
    std::optional<double> factor;
    for (const std::uint64_t seed : {1U, 2U, 3U}) {
      const double one = action(stated, seed), other = action(found, seed);
      if (std::abs(one) > 1e-3) {
        factor = factor.value_or(other / one);
        CHECK(std::abs(std::abs(*factor) - 1.0) < 1e-9);
        CHECK(std::abs(other - *factor * one) < 1e-9 * (1.0 + std::abs(one)));
        ++compared;
      }
    }
  }
  CHECK(compared > 150);
}

TEST_CASE("equations without a density are refused with a term") {
  std::mt19937_64 random(11);
  int refused = 0, stated = 0, by_potential = 0;
  for (int i = 0; i < 100; ++i) {
    Jets jets({"u", "v"});
    const Expression L = random_density(jets, random);
    std::vector<Expression> rows = {jets.euler(L, 0), jets.euler(L, 1)};
    if (std::ranges::any_of(rows, [](Expression row) { return formula::variables_of(row).empty(); })) {
      continue;
    }
    // Friction, a current, a force that one field has on the other alone.
    const Expression more = i % 3 == 0   ? 0.3 * jets(0, {1, 0, 0, 0})
                            : i % 3 == 1 ? 0.3 * jets(0, {0, 0, 0, 0}) * jets(0, {0, 1, 0, 0})
                                         : 0.3 * jets(1, {0, 0, 0, 0}) * jets(1, {0, 0, 0, 0}) * jets(1, {0, 0, 0, 0});
    rows[0] = rows[0] + more;
    ++stated;
    if (refusal(jets.equations(rows)) != "found") {
      ++refused;
    } else {
      // v_xx - d v_xt + 0.3 u_t and u_xx - d u_xt: with u = φ_x the friction is the row of -0.15 φ_t φ_x, and the
      // second equation, integrated, that of v. So it is where neither field has a term of its own.
      ++by_potential;
      CHECK(density_of(jets.equations(rows)).potentials.size() == 1);
    }
  }
  CHECK(stated > 80);
  CHECK(by_potential <= 2);
  CHECK(refused == stated - by_potential);
}

TEST_CASE("what has no density is named") {
  Jets jets({"u"});
  const auto u = jets(0, {}), u_t = jets(0, {1, 0, 0, 0}), u_tt = jets(0, {2, 0, 0, 0}), u_x = jets(0, {0, 1, 0, 0}),
             u_xx = jets(0, {0, 2, 0, 0});
  CHECK(refusal(jets.equations({u_tt - u_xx + sin(u)})) == "found");
  CHECK(refusal(jets.equations({u_tt + 0.1 * u_t - u_xx + sin(u)})) == "found");  // by exp(0.1 t)
  CHECK_THAT(refusal(jets.equations({u_t - u_xx})), Contains("u_xx beside a first derivative by t is diffusion"));
  CHECK_THAT(refusal(jets.equations({u_tt - u_xx + asin(u)})), Contains("asin(u) has no integral"));
  CHECK_THAT(refusal(jets.equations({u_tt - sin(u_x)})), Contains("sin(u_x)") && Contains("no polynomial"));
  CHECK_THAT(refusal(jets.equations({u_tt - u_xx, u})), Contains("2 equations for 1 fields"));
  CHECK_THAT(refusal(Jets({}).equations({})), Contains("there is no equation"));
}

TEST_CASE("terms of several fields without polynomial form have a potential") {
  Jets jets({"u", "v"});
  const auto u = jets(0, {}), v = jets(1, {}), u_tt = jets(0, {2, 0, 0, 0}), v_tt = jets(1, {2, 0, 0, 0}),
             u_xx = jets(0, {0, 2, 0, 0}), v_xx = jets(1, {0, 2, 0, 0});
  const Expression s = pow(u, 2.0) + pow(v, 2.0);
  const std::vector<std::array<Expression, 2>> forces = {
      {sin(u - v), -sin(u - v)},
      {sin(u - v), -2.0 * sin(u - v)},  // with a factor 1/2 of the second equation
      {exp(u - v), -exp(u - v)},
      {sin(u) * cos(v), cos(u) * sin(v)},
      {u / (1.0 + s), v / (1.0 + s)},
      {u * s / (1.0 + s), v * s / (1.0 + s)},
      {u / pow(1.0 + s, 2.0), v / pow(1.0 + s, 2.0)},
      {u * log(s), v * log(s)},
      {u * sin(s), v * sin(s)},
      {u * exp(-s), v * exp(-s)},
      {u * sqrt(s), v * sqrt(s)},
  };
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> value(0.2, 1.2);
  for (const auto& [of_u, of_v] : forces) {
    CAPTURE(formula::to_string(of_u));
    const FieldDensity density = density_of(jets.equations({u_tt - u_xx + of_u, v_tt - 2.0 * v_xx + of_v}));
    // -dL/du is the force, -dL/dv is it times the factor of v_t^2 beside that of u_t^2.
    const auto square = [&](std::size_t field) {
      const Expression moving = jets.graph().variable(derivative_name(jets.fields()[field], {1, 0, 0, 0}));
      return formula::derivative(formula::derivative(density.L, moving), moving);
    };
    const std::array found = {
        formula::derivative(density.L, u), formula::derivative(density.L, v), of_u, of_v, square(0), square(1)};
    formula::ScalarEvaluator evaluate(formula::Bytecode(found, std::array{u, v}));
    for (int n = 0; n < 5; ++n) {
      const std::vector<double> point = {value(random), value(random)};
      std::vector<double> values(found.size());
      evaluate(point, values);
      // The logarithms and powers of one field's integral cancel against the other's: rounding of some units.
      CHECK(values[0] == Approx(-values[2] * values[4]).epsilon(1e-12).margin(1e-14));
      CHECK(values[1] == Approx(-values[3] * values[5]).epsilon(1e-12).margin(1e-14));
    }
  }
  // Twins: forces that are no gradient, with whatever positive factor, and one whose integral is not known.
  const auto refused = [&](Expression of_u, Expression of_v) {
    return refusal(jets.equations({u_tt - u_xx + of_u, v_tt - 2.0 * v_xx + of_v}));
  };
  CHECK_THAT(refused(sin(u - v), cos(u - v)), Contains("the terms sin(u - v) and cos(u - v), without"));
  CHECK_THAT(refused(u * asin(s), v * asin(s)), Contains("asin(") && Contains("has no integral in closed form"));
}

TEST_CASE("the term without which the rest has a density is named") {
  Jets jets({"u"});
  const auto u = jets(0, {}), u_t = jets(0, {1, 0, 0, 0}), u_tt = jets(0, {2, 0, 0, 0}), u_x = jets(0, {0, 1, 0, 0}),
             u_xx = jets(0, {0, 2, 0, 0}), u_xxx = jets(0, {0, 3, 0, 0}), u_xxt = jets(0, {1, 2, 0, 0});
  const auto kdv = u_t + 6.0 * u * u_x + u_xxx;
  CHECK(refusal(jets.equations({kdv})) == "found");
  CHECK_THAT(refusal(jets.equations({kdv + 0.1 * u})), Contains("the term 0.1*u, without which") && Contains("\"dx\""));
  CHECK_THAT(refusal(jets.equations({u_tt - (1.0 + u) * u_xx})), Contains("the term u*u_xx, without"));
  CHECK_THAT(refusal(jets.equations({u_tt - u_xx + pow(u_t, 3.0)})), Contains("the term u_t*u_t*u_t, without"));
  CHECK_THAT(refusal(jets.equations({u_t - u_xxt + 4.0 * u * u_x - 3.0 * u_x * u_xx - u * u_xxx})),
             Contains("all of these terms, nor all but one"));
}
