// M, K and S derived from a Lagrangian density: on fields that are the derivatives they stand for, the action of the
// form is that of the density, whatever the multipliers are, and the rows of the added fields hold. With the action the
// Euler–Lagrange equations are the same, as what is added has no other solution.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/multisymplectic_form.hpp>

using namespace rubato;

namespace {

/// A sum of waves on the torus of x and t.
class Waves {
public:
  explicit Waves(std::mt19937_64& random) {
    std::uniform_real_distribution<double> amplitude(-0.5, 0.5);
    std::uniform_int_distribution<int> number(-2, 2);
    for (int i = 0; i < 3; ++i) {
      waves_.push_back({amplitude(random), number(random), number(random), 6.0 * amplitude(random)});
    }
  }
  /// The derivative by t and x, so many times.
  [[nodiscard]] double operator()(double t, double x, int by_t, int by_x) const {
    double sum = 0.0;
    for (const auto& [c, w, k, phase] : waves_) {
      sum += c * std::pow(w, by_t) * std::pow(k, by_x) *
             std::cos(w * t + k * x + phase + 0.5 * std::numbers::pi * (by_t + by_x));
    }
    return sum;
  }

private:
  struct Wave {
    double c;
    int w, k;
    double phase;
  };
  std::vector<Wave> waves_;
};

/// What a field of a form is: a derivative of a wave.
struct Stands {
  Waves wave;
  int by_t = 0, by_x = 0;
};

class FormTest {
public:
  FormTest(FieldDensity density, std::mt19937_64& random) : density_(std::move(density)) {
    for (std::size_t f = 0; f < density_.fields.size(); ++f) {
      waves_.emplace_back(random);
    }
    form_ = multisymplectic_form(density_);
    for (std::size_t i = 0; i < form_.fields.size(); ++i) {
      stands_.push_back(stand_for(form_.fields[i], random));
    }
  }

  MultisymplecticForm& form() { return form_; }

  /// ∫L of the density, and of the form.
  std::array<double, 2> actions() {
    std::vector<formula::Expression> inputs;
    for (const std::string& name : density_.fields) {
      inputs.push_back(density_.graph->variable(name));
    }
    for (const auto& derivative : density_.derivatives) {
      inputs.push_back(derivative.variable);
    }
    formula::ScalarEvaluator L(formula::Bytecode(std::array{density_.L}, inputs));
    formula::ScalarEvaluator S(formula::Bytecode(std::array{form_.S}, variables()));
    std::array<double, 2> sums{};
    for_all_points([&](double t, double x) {
      std::vector<double> at;
      for (const Waves& wave : waves_) {
        at.push_back(wave(t, x, 0, 0));
      }
      for (const auto& [field, order, variable] : density_.derivatives) {
        at.push_back(waves_[field](t, x, order[0], order[1]));
      }
      sums[0] += L.at(at.data())[0];
      const std::vector<double> z = state(t, x, 0, 0);
      double sum = -S.at(z.data())[0];
      for (std::size_t mu = 0; mu < 2; ++mu) {
        const std::vector<double> slope = state(t, x, mu == 0 ? 1 : 0, mu == 1 ? 1 : 0);
        for (const auto& [row, column, value] : form_.terms[mu]) {
          sum += 0.5 * value * (z[row] * slope[column] - z[column] * slope[row]);
        }
      }
      sums[1] += sum;
    });
    return {sums[0] / (points * points), sums[1] / (points * points)};
  }

  /// The largest residual of the rows of the fields that equal a derivative by Legendre's transform, and of
  /// multipliers.
  double rows_of_added() {
    std::vector<formula::Expression> gradient = formula::gradient(form_.S, variables());
    formula::ScalarEvaluator dS(formula::Bytecode(gradient, variables()));
    double worst = 0.0;
    for_all_points([&](double t, double x) {
      const std::vector<double> z = state(t, x, 0, 0);
      const double* const rhs = dS.at(z.data());
      std::vector<double> left(z.size(), 0.0);
      for (std::size_t mu = 0; mu < 2; ++mu) {
        const std::vector<double> slope = state(t, x, mu == 0 ? 1 : 0, mu == 1 ? 1 : 0);
        for (const auto& [row, column, value] : form_.terms[mu]) {
          left[row] += value * slope[column];
          left[column] -= value * slope[row];
        }
      }
      for (std::size_t i = density_.fields.size(); i < z.size(); ++i) {
        const bool has_multiplier =
            std::ranges::find(form_.fields, "multiplier_" + form_.fields[i]) != form_.fields.end();
        if (!has_multiplier) {
          worst = std::max(worst, std::abs(left[i] - rhs[i]));
        }
      }
    });
    return worst;
  }

private:
  /// Waves have at most 2 turns, and products at most 6 factors of second derivatives.
  static constexpr int points = 30;

  template <typename Visit>
  static void for_all_points(Visit&& visit) {
    for (int i = 0; i < points; ++i) {
      for (int j = 0; j < points; ++j) {
        visit(2.0 * std::numbers::pi * i / points, 2.0 * std::numbers::pi * j / points);
      }
    }
  }
  Stands stand_for(const std::string& name, std::mt19937_64& random) const {
    for (std::size_t f = 0; f < density_.fields.size(); ++f) {
      if (name == density_.fields[f]) {
        return {waves_[f]};
      }
      if (name.starts_with(density_.fields[f] + "_")) {
        const std::string suffix = name.substr(density_.fields[f].size() + 1);
        return {waves_[f], static_cast<int>(std::ranges::count(suffix, 't')),
                static_cast<int>(std::ranges::count(suffix, 'x'))};
      }
    }
    return {Waves(random)};  // a multiplier
  }
  [[nodiscard]] std::vector<double> state(double t, double x, int by_t, int by_x) const {
    std::vector<double> z;
    for (const Stands& one : stands_) {
      z.push_back(one.wave(t, x, one.by_t + by_t, one.by_x + by_x));
    }
    return z;
  }
  [[nodiscard]] std::vector<formula::Expression> variables() const {
    std::vector<formula::Expression> all;
    for (const std::string& name : form_.fields) {
      all.push_back(density_.graph->variable(name));
    }
    return all;
  }

  FieldDensity density_;
  std::vector<Waves> waves_;
  MultisymplecticForm form_;
  std::vector<Stands> stands_;
};

/// A polynomial of up to three fields and their derivatives up to second order, by t at most once.
FieldDensity random_density(std::mt19937_64& random) {
  FieldDensity density;
  density.graph = std::make_shared<formula::Graph>();
  std::uniform_int_distribution<int> fields(1, 3), terms(1, 5), degree(1, 4), choice(0, 4);
  std::uniform_real_distribution<double> coefficient(-1.0, 1.0);
  for (int f = 0, count = fields(random); f < count; ++f) {
    density.fields.push_back(fmt::format("u{}", f));
  }
  constexpr std::array<DerivativeOrder, 5> orders = {
      {{0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {1, 1, 0, 0}, {0, 2, 0, 0}}};
  std::map<std::string, bool> stated;
  const auto factor = [&] {
    const auto f = static_cast<std::size_t>(
        std::uniform_int_distribution<int>(0, static_cast<int>(density.fields.size()) - 1)(random));
    const DerivativeOrder& order = orders.at(static_cast<std::size_t>(choice(random)));
    if (order == orders[0]) {
      return density.graph->variable(density.fields[f]);
    }
    const std::string name = derivative_name(density.fields[f], order);
    const formula::Expression variable = density.graph->variable(name);
    if (stated.emplace(name, true).second) {
      density.derivatives.push_back({f, order, variable});
    }
    return variable;
  };
  density.L = density.graph->constant(0.0);
  for (int i = 0, count = terms(random); i < count; ++i) {
    formula::Expression term = density.graph->constant(coefficient(random));
    for (int j = 0, n = degree(random); j < n; ++j) {
      term = term * factor();
    }
    density.L = density.L + term;
  }
  return density;
}

}  // namespace

TEST_CASE("the form derived from a density has its action") {
  std::mt19937_64 random(1);
  int altered = 0, found = 0;
  for (int i = 0; i < 200; ++i) {
    FormTest test(random_density(random), random);
    const auto [action, of_form] = test.actions();
    INFO("density " << i << ", form of " << test.form().fields.size() << " fields");
    // Means of at most 30 terms of size up to 4⁴, summed over 900 points.
    CHECK(std::abs(action - of_form) < 1e-12);
    CHECK(test.rows_of_added() < 1e-12);
    for (auto& entries : test.form().terms) {  // the twin
      if (!entries.empty()) {
        entries.front().value *= 1.5;
        const auto [same, other] = test.actions();
        ++altered;
        found += std::abs(same - other) > 1e-9 || test.rows_of_added() > 1e-9 ? 1 : 0;
        entries.front().value /= 1.5;
      }
    }
  }
  CHECK(altered > 200);
  CHECK(found > altered * 9 / 10);  // waves that do not meet have no part in the action
}

TEST_CASE("a form has as few fields as its density allows") {
  const auto fields_of = [](const std::vector<std::string>& names, const auto& make) {
    FieldDensity density;
    density.graph = std::make_shared<formula::Graph>();
    density.fields = names;
    const auto d = [&density](std::size_t field, const DerivativeOrder& order) {
      density.derivatives.push_back(
          {field, order, density.graph->variable(derivative_name(density.fields[field], order))});
      return density.derivatives.back().variable;
    };
    density.L = make(density, d);
    return multisymplectic_form(density).fields;
  };
  using Names = std::vector<std::string>;
  CHECK(fields_of({"u"}, [](FieldDensity& density, const auto& d) {
          const auto u = density.graph->variable("u");
          return 0.5 * pow(d(0, {1, 0, 0, 0}), 2.0) - 0.5 * pow(d(0, {0, 1, 0, 0}), 2.0) + cos(u);
        }) == Names{"u", "u_x", "u_t"});
  // A nonlinear derivative: u_x is a field with its multiplier.
  CHECK(fields_of({"u"}, [](FieldDensity&, const auto& d) {
          return 0.5 * pow(d(0, {1, 0, 0, 0}), 2.0) - sqrt(1.0 + pow(d(0, {0, 1, 0, 0}), 2.0));
        }) == Names{"u", "u_x", "multiplier_u_x", "u_t"});
  // A derivative that is differentiated again.
  CHECK(fields_of({"u"}, [](FieldDensity&, const auto& d) {
          return 0.5 * pow(d(0, {1, 0, 0, 0}), 2.0) - 0.5 * pow(d(0, {0, 2, 0, 0}), 2.0);
        }) == Names{"u", "u_x", "multiplier_u_x", "u_xx", "u_t"});
}

TEST_CASE("a density with a name that the form needs is refused") {
  FieldDensity density;
  density.graph = std::make_shared<formula::Graph>();
  density.fields = {"u", "u_t"};
  density.derivatives.push_back({0, {1, 0, 0, 0}, density.graph->variable("rate")});
  density.L = pow(density.derivatives.front().variable, 2.0) + density.graph->variable("u_t");
  CHECK_THROWS_WITH(multisymplectic_form(density), Catch::Contains("the name u_t is taken"));
  density.fields[1] = "v";
  density.L = pow(density.derivatives.front().variable, 2.0) + density.graph->variable("v");
  CHECK(multisymplectic_form(density).fields.size() == 3);
}
