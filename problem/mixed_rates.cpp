#include <rubato/problem/mixed_rates.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/multisymplectic_form.hpp>

namespace rubato {

namespace {

void check_rate(const Entry& given, const Entry& rate, const NamedDerivative& named, const std::string& follows,
                const std::vector<std::string>& axes, formula::Graph& graph, const BuildFormula& build) {
  formula::Expression derived = build(read_formula(rate.value, rate.key));
  std::vector<formula::Expression> places;
  for (std::size_t a = 0; a < axes.size(); ++a) {
    places.push_back(graph.variable(axes[a]));
    for (int n = 0; n < named.order.at(a + 1); ++n) {
      derived = formula::derivative(derived, places.back());
    }
  }
  places.push_back(graph.variable("t"));
  formula::ScalarEvaluator evaluate(
      formula::Bytecode(std::array{build(read_formula(given.value, given.key)), derived}, places));
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> place(0.0, 1.0);
  std::vector<double> point(places.size()), values(2);
  constexpr int points = 20;
  constexpr double same = 1e-8;
  for (int n = 0; n < points; ++n) {
    std::ranges::generate(point, [&] { return place(random); });
    evaluate(point, values);
    if (std::abs(values[0] - values[1]) > same * (1.0 + std::abs(values[1]))) {
      throw ProblemError(given.location, fmt::format("the initial {} contradicts {}, whose derivative {} it is: leave "
                                                     "it out, it follows",
                                                     given.key, rate.key, follows));
    }
  }
}

}  // namespace

void follow_rates(Value::Table& table, const RateNames& names, formula::Graph& graph, const BuildFormula& build) {
  for (const std::string& name : names.form) {
    const auto named = derivative_named(name, names.fields);
    const std::string rate = named ? derivative_name(names.fields[named->field], {1, 0, 0, 0}) : "";
    if (!named || named->order[0] != 1 || total_order(named->order) == 1 || find(table, rate) == nullptr ||
        std::ranges::find(names.form, rate) == names.form.end()) {
      continue;
    }
    const Entry of = *find(table, rate);
    std::string text = rate;
    for (std::size_t a = 0; a < names.axes.size(); ++a) {
      for (int n = 0; n < named->order.at(a + 1); ++n) {
        text = fmt::format("d{}({})", names.axes[a], text);
      }
    }
    if (Entry* const given = find(table, name)) {
      check_rate(*given, of, *named, text, names.axes, graph, build);
      continue;
    }
    table.push_back({name, of.location, {text, of.value.location}});
  }
}

}  // namespace rubato
