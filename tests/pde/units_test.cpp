// Powers of two in the units of length, time and field change exponents and nothing else: no scheme compares numbers
// that have units with numbers that have none.

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <rubato/pde/lattice_method.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;
using formula::Expression;

namespace {

/// Powers of 2 of the units of length, time and field.
struct Units {
  int length = 0, time = 0, field = 0;
};

/// Exponents of the units in that of a quantity.
struct Dimension {
  int length, time, field;
  [[nodiscard]] double in(const Units& units) const {
    return std::ldexp(1.0, length * units.length + time * units.time + field * units.field);
  }
};
constexpr Dimension of_length{1, 0, 0}, of_time{0, 1, 0};

struct Equation {
  std::string name;
  std::vector<std::string> fields;
  std::vector<Dimension> dimensions;
  std::vector<Triple> M, K;
  std::function<Expression(const std::vector<Expression>&)> S;
  std::vector<std::optional<Profile>> initial;
  double length, h;
};

const std::vector<Equation>& equations() {
  static const std::vector<Equation> all = {
      {"sine-Gordon",
       {"u", "v", "w"},
       {{0, 0, 1}, {0, -1, 1}, {-1, 0, 1}},
       {{"u", "v", -1}},
       {{"u", "w", 1}},
       [](const auto& z) { return (z[1] * z[1] - z[2] * z[2]) / 2.0 + (1.0 - cos(z[0])); },
       {[](double) { return 0.0; }, [](double x) { return 3.2 * sech(0.8 * x); }, std::nullopt},
       40.0,
       0.1},
      {"Schroedinger",
       {"p", "q", "v", "w"},
       {{0, 0, 1}, {0, 0, 1}, {-1, 0, 1}, {-1, 0, 1}},
       {{"p", "q", 1}},
       {{"p", "v", -1}, {"q", "w", -1}},
       [](const auto& z) {
         const Expression density = z[0] * z[0] + z[1] * z[1];
         return (z[2] * z[2] + z[3] * z[3] + density * density) / 2.0;
       },
       {[](double x) { return sech(x) * std::cos(x / 4); }, [](double x) { return sech(x) * std::sin(x / 4); },
        std::nullopt, std::nullopt},
       40.0,
       0.02},
      {"Korteweg-de Vries",
       {"phi", "u", "v", "w"},
       {{1, 0, 1}, {0, 0, 1}, {-1, 0, 1}, {1, -1, 1}},
       {{"phi", "u", 0.5}},
       {{"phi", "w", 1}, {"u", "v", -1}},
       [](const auto& z) { return z[2] * z[2] / 2.0 - z[1] * z[3] + z[1] * z[1] * z[1]; },
       {std::nullopt, [](double x) { return 2 * sech(x) * sech(x); }, std::nullopt, std::nullopt},
       20.0,
       0.01},
  };
  return all;
}

/// The fields of a level after some equal steps, in the units of the equation as it is stated; none where the scheme
/// does not take it. \param longer of each step, relative
std::optional<std::vector<std::vector<double>>> run(const Equation& equation, const LatticeMethodChoice& choice,
                                                    const Units& units, double longer = 0.0) {
  const std::size_t d = equation.fields.size();
  const auto unit = [&](std::size_t f) { return equation.dimensions[f].in(units); };
  const auto matrix = [&](const std::vector<Triple>& triples, double per) {
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(d), static_cast<Eigen::Index>(d));
    for (const auto& [row, column, value] : triples) {
      const auto i = std::ranges::find(equation.fields, row) - equation.fields.begin();
      const auto j = std::ranges::find(equation.fields, column) - equation.fields.begin();
      result(i, j) = value * unit(static_cast<std::size_t>(i)) * unit(static_cast<std::size_t>(j)) / per;
      result(j, i) = -result(i, j);
    }
    return result;
  };
  const MultisymplecticSystem system(equation.fields, matrix(equation.M, of_time.in(units)),
                                     {matrix(equation.K, of_length.in(units))}, [&](std::vector<Expression> z) {
                                       for (std::size_t f = 0; f < d; ++f) {
                                         z[f] = unit(f) * z[f];
                                       }
                                       return equation.S(z);
                                     });
  const double length = equation.length / of_length.in(units);
  const grids::Grid line({{"x", -length / 2, length / 2, 65}});
  InitialFields initial(d);
  for (std::size_t f = 0; f < d; ++f) {
    if (equation.initial[f]) {
      initial[f] = sampled(line, [&](double x) { return (*equation.initial[f])(x * of_length.in(units)) / unit(f); });
    }
  }
  const double h = equation.h / of_time.in(units) * (1.0 + longer);
  const auto method = make_lattice_method(choice);
  std::unique_ptr<LatticeScheme> scheme;
  try {
    scheme =
        method->scheme(method->seen(system), line, method->first_level(method->seen(system), line, initial).level, h);
  } catch (const std::invalid_argument& refusal) {
    UNSCOPED_INFO(refusal.what());
    return std::nullopt;
  }
  for (int step = 0; step < 20; ++step) {
    if (scheme->advance(h, 0.0) != Status::success) {
      UNSCOPED_INFO("not solved in step " << step);
      return std::nullopt;
    }
    scheme->accept();
  }
  std::vector<std::vector<double>> result;
  for (std::size_t f = 0; f < d; ++f) {
    const auto values = scheme->level().fields.field(static_cast<int>(f));
    result.emplace_back(values.begin(), values.end());
    for (double& value : result.back()) {
      value *= unit(f);
    }
  }
  return result;
}

/// The largest difference of a field, relative to the field.
double distance(const std::vector<std::vector<double>>& a, const std::vector<std::vector<double>>& b) {
  double result = 0.0;
  for (std::size_t f = 0; f < a.size(); ++f) {
    double size = 0.0;
    for (const double value : a[f]) {
      size = std::max(size, std::abs(value));
    }
    const double difference = largest_difference(a[f], b[f]);
    result = std::max(result, difference == 0.0 ? 0.0 : difference / size);
  }
  return result;
}

}  // namespace

TEST_CASE("levels of a lattice are the same in all units of length, time and field") {
  std::mt19937_64 random(1);
  std::uniform_int_distribution<int> exponent(-20, 20);
  const std::vector<LatticeMethodChoice> choices = {
      {.name = "box"},       {.name = "box", .stages = 2}, {.name = "fourier"}, {.name = "fourier", .stages = 2},
      {.name = "euler-box"}, {.name = "splitting"},        {.name = "leapfrog"}};
  for (const Equation& equation : equations()) {
    for (const LatticeMethodChoice& choice : choices) {
      const auto plain = run(equation, choice, {});
      if (!plain) {
        continue;
      }
      for (int system = 0; system < 5; ++system) {
        const Units units{exponent(random), exponent(random), exponent(random)};
        INFO(equation.name << ", " << choice.name << " with " << choice.stages << " stage(s), units 2^" << units.length
                           << ", 2^" << units.time << ", 2^" << units.field);
        const auto scaled = run(equation, choice, units);
        REQUIRE(scaled);
        // Eliminations that mix rows round differently in other units: 20 steps of some ε each, with amplification.
        CHECK(distance(*plain, *scaled) < 1e-12);
      }
      // A step that is a billionth longer is seen.
      const auto longer = run(equation, choice, {}, 1e-9);
      REQUIRE(longer);
      CHECK(distance(*plain, *longer) > 1e-12);
    }
  }
}
