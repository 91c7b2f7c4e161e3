// M, K and S of random densities, judged by GiNaC in exact arithmetic, which shares nothing with this code but the
// texts.
//
// With fields that equal derivatives put in for them, the density ½zᵀMz_t + ½zᵀKz_x - S(z) of the form has to have the
// Euler-Lagrange equations of L for each field of L, whatever the multipliers are, and none for these; and the rows of
// the fields that have no multiplier have to hold. The rows of the others give the multipliers.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <ginac/ginac.h>

#include <fmt/format.h>

#include <rubato/formula/expression.hpp>
#include <rubato/pde/multisymplectic_form.hpp>

using namespace rubato;
using GiNaC::ex;

namespace {

using Orders = std::array<int, 2>;  ///< by t and x

/// Symbols of fields and their derivatives.
class Symbols {
public:
  ex operator()(const std::string& field, const Orders& orders) {
    const auto [place, is_new] = all_.try_emplace({field, orders});
    if (is_new) {
      place->second = GiNaC::symbol(fmt::format("{}_{}_{}", field, orders[0], orders[1]));
    }
    return place->second;
  }
  /// D_mu.
  ex derivative(const ex& e, std::size_t mu) {
    ex sum = 0;
    for (const auto& [jet, symbol] : std::map(all_)) {
      if (const ex slope = e.diff(symbol); !slope.is_zero()) {
        Orders orders = jet.second;
        ++orders.at(mu);
        sum += slope * (*this)(jet.first, orders);
      }
    }
    return sum;
  }
  ex derivative(ex e, const Orders& orders) {
    for (std::size_t mu = 0; mu < orders.size(); ++mu) {
      for (int n = 0; n < orders.at(mu); ++n) {
        e = derivative(e, mu);
      }
    }
    return e;
  }
  /// Σ_J (-D)^J ∂L/∂u_J.
  ex euler(const ex& L, const std::string& field) {
    ex sum = 0;
    for (const auto& [jet, symbol] : std::map(all_)) {
      if (jet.first == field) {
        const ex moved = derivative(L.diff(symbol), jet.second);
        sum += (jet.second[0] + jet.second[1]) % 2 == 0 ? moved : -moved;
      }
    }
    return sum.expand();
  }

private:
  std::map<std::pair<std::string, Orders>, GiNaC::symbol> all_;
};

/// "u_xt" as u and its orders; another name as itself.
std::pair<std::string, Orders> jet_of(const std::string& name, const std::vector<std::string>& fields) {
  for (const std::string& field : fields) {
    if (name.starts_with(field + "_") && name.find_first_not_of("tx", field.size() + 1) == std::string::npos) {
      Orders orders{};
      for (const char letter : name.substr(field.size() + 1)) {
        ++orders.at(letter == 't' ? 0 : 1);
      }
      return {field, orders};
    }
  }
  return {name, {}};
}

/// An expression of this code as GiNaC's: all its numbers are multiples of a power of 1/2, and so exact.
ex exact(const formula::Graph& graph, formula::Expression e, const std::map<std::string, ex>& values) {
  const formula::Node node = graph.node(e.index());
  const auto of = [&](formula::NodeIndex index) { return exact(graph, formula::Expression(e.graph(), index), values); };
  switch (node.operation) {
    case formula::Operation::constant: return GiNaC::numeric(static_cast<long>(node.value * 1024.0), 1024);
    case formula::Operation::variable: return values.at(std::string(graph.variable_name(node.a)));
    case formula::Operation::add: return of(node.a) + of(node.b);
    case formula::Operation::subtract: return of(node.a) - of(node.b);
    case formula::Operation::negate: return -of(node.a);
    case formula::Operation::multiply: return of(node.a) * of(node.b);
    case formula::Operation::divide: return of(node.a) / of(node.b);
    case formula::Operation::power: return GiNaC::pow(of(node.a), of(node.b));
    default: throw std::logic_error("not polynomial");
  }
}

/// Two to five products of up to four fields and derivatives, up to the second in space, the first in time, mixed.
FieldDensity random_density(std::mt19937_64& random) {
  static constexpr std::array<Orders, 5> known = {{{0, 0}, {1, 0}, {0, 1}, {0, 2}, {1, 1}}};
  FieldDensity density;
  density.graph = std::make_shared<formula::Graph>();
  density.fields = {"u", "v", "w"};
  density.fields.resize(1 + random() % 3);
  std::map<std::pair<std::size_t, Orders>, formula::Expression> jets;
  const auto jet = [&](std::size_t f, const Orders& orders) {
    const auto found = jets.find({f, orders});
    if (found != jets.end()) {
      return found->second;
    }
    const DerivativeOrder order = {orders[0], orders[1], 0, 0};
    const bool plain = orders == Orders{};
    const formula::Expression variable =
        density.graph->variable(plain ? density.fields[f] : derivative_name(density.fields[f], order));
    if (!plain) {
      density.derivatives.push_back({f, order, variable});
    }
    return jets.emplace(std::pair(f, orders), variable).first->second;
  };
  density.L = density.graph->constant(0.0);
  for (std::size_t term = 0, terms = 2 + random() % 4; term < terms; ++term) {
    formula::Expression product = density.graph->constant((1.0 + static_cast<double>(random() % 8)) / 4.0);
    for (std::size_t factor = 0, factors = 1 + random() % 4; factor < factors; ++factor) {
      product = product * jet(random() % density.fields.size(), known.at(random() % known.size()));
    }
    density.L = density.L + product;
  }
  return density;
}

/// What is left of the form's equations; 0 if it is right. \param broken S with another coefficient
std::vector<ex> left_by(const FieldDensity& density, bool broken) {
  const MultisymplecticForm form = multisymplectic_form(density);
  Symbols symbols;
  std::map<std::string, ex> values;
  std::vector<ex> z;
  std::vector<std::string> multipliers;
  for (const std::string& name : form.fields) {
    const auto [field, orders] = jet_of(name, density.fields);
    z.push_back(symbols(field, orders));
    values[name] = z.back();
    if (name.starts_with("multiplier_")) {
      multipliers.push_back(name);
    }
  }
  for (std::size_t f = 0; f < density.fields.size(); ++f) {
    values[density.fields[f]] = symbols(density.fields[f], {});
  }
  for (const auto& derivative : density.derivatives) {
    const std::string name = derivative_name(density.fields[derivative.field], derivative.order);
    values[name] = symbols(density.fields[derivative.field], {derivative.order[0], derivative.order[1]});
  }
  const ex L = exact(*density.graph, density.L, values);
  ex S = exact(*form.S.graph(), form.S, values);
  if (broken) {
    S += GiNaC::pow(symbols(density.fields.front(), {}), 2);
  }
  ex of_form = -S;
  for (std::size_t mu = 0; mu < 2; ++mu) {
    for (const auto& [row, column, value] : form.terms.at(mu)) {
      const ex half = GiNaC::numeric(static_cast<long>(value * 1024.0), 2048);
      of_form += half * (z[row] * symbols.derivative(z[column], mu) - z[column] * symbols.derivative(z[row], mu));
    }
  }
  std::vector<ex> left;
  for (const std::string& field : density.fields) {
    left.push_back((symbols.euler(of_form, field) - symbols.euler(L, field)).expand());
  }
  for (const std::string& multiplier : multipliers) {
    left.push_back(symbols.euler(of_form, multiplier));
  }
  // The rows of added fields without a multiplier, with ∂S/∂z_i before anything is put in.
  std::map<std::string, ex> own;
  GiNaC::exmap put_in;
  for (std::size_t i = 0; i < form.fields.size(); ++i) {
    const GiNaC::symbol symbol(form.fields[i]);
    own[form.fields[i]] = symbol;
    put_in[symbol] = z[i];
  }
  const ex own_S = exact(*form.S.graph(), form.S, own);
  for (std::size_t i = density.fields.size(); i < form.fields.size(); ++i) {
    if (std::ranges::find(multipliers, "multiplier_" + form.fields[i]) != multipliers.end()) {
      continue;
    }
    ex row = -own_S.diff(GiNaC::ex_to<GiNaC::symbol>(own[form.fields[i]])).subs(put_in);
    for (std::size_t mu = 0; mu < 2; ++mu) {
      for (const auto& entry : form.terms.at(mu)) {
        const ex value = GiNaC::numeric(static_cast<long>(entry.value * 1024.0), 1024);
        row += entry.row == i ? value * symbols.derivative(z[entry.column], mu) : ex(0);
        row -= entry.column == i ? value * symbols.derivative(z[entry.row], mu) : ex(0);
      }
    }
    left.push_back(row.expand());
  }
  return left;
}

}  // namespace

TEST_CASE("forms of 200 random densities have their Euler-Lagrange equations, by exact arithmetic") {
  std::mt19937_64 random(2026);
  int judged = 0, caught = 0;
  for (int i = 0; i < 200; ++i) {
    const FieldDensity density = random_density(random);
    INFO(i << ": " << formula::to_string(density.L));
    for (const ex& rest : left_by(density, false)) {
      INFO(rest);
      CHECK(rest.is_zero());
    }
    ++judged;
    bool is_caught = false;
    for (const ex& rest : left_by(density, true)) {
      is_caught = is_caught || !rest.is_zero();
    }
    caught += is_caught ? 1 : 0;
  }
  CHECK(judged == 200);
  CHECK(caught == 200);
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
