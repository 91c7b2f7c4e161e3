#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <ranges>
#include <regex>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/branches.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/pde/field_system.hpp>
#include <rubato/pde/inverse_problem.hpp>
#include <rubato/pde/linear_symmetries.hpp>
#include <rubato/pde/multisymplectic_form.hpp>
#include <rubato/problem/complex_parts.hpp>
#include <rubato/problem/jet_formulas.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/mixed_rates.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {
namespace {

/// The names of equations that have derivatives, in the order in which they come.
std::vector<std::string> fields_in(const std::vector<const Value*>& equations) {
  std::vector<std::pair<std::size_t, std::string>> places;
  for (std::size_t i = 0; i < equations.size(); ++i) {
    const std::string& text = read_string(*equations[i], "equation");
    for (const std::string& name : names_in(text)) {
      const std::size_t bar = name.rfind('_');
      if (bar != std::string::npos && bar > 0 && bar + 1 < name.size() &&
          name.find_first_not_of("txyz", bar + 1) == std::string::npos) {
        places.emplace_back(1'000'000 * i + text.find(name), name.substr(0, bar));
      }
    }
  }
  std::ranges::sort(places);
  std::vector<std::string> fields;
  for (const auto& [place, name] : places) {
    if (std::ranges::find(fields, name) == fields.end()) {
      fields.push_back(name);
    }
  }
  return fields;
}

/// What `psi` says where equations with i, abs2 or conj name psi, or psi1, psi2, …, and it is left out: p and q, or p1,
/// q1, …
std::optional<Entry> usual_parts(const std::vector<const Value*>& equations, const Location& place) {
  if (std::ranges::none_of(equations, [](const Value* text) {
        const std::set<std::string> names = names_in(read_string(*text, "equation"));
        return std::ranges::any_of(std::array{"i", "abs2", "conj"}, [&](const char* n) { return names.contains(n); });
      })) {
    return std::nullopt;
  }
  const std::vector<std::string> fields = fields_in(equations);
  const auto pair_of = [&](const std::string& number) {
    return Value{Value::Array{{"p" + number, place}, {"q" + number, place}}, place};
  };
  Value::Array pairs;
  if (std::ranges::find(fields, "psi") != fields.end()) {
    return Entry{"psi", place, pair_of("")};
  }
  for (int i = 1; std::ranges::find(fields, fmt::format("psi{}", i)) != fields.end(); ++i) {
    pairs.push_back(pair_of(std::to_string(i)));
  }
  return pairs.empty() ? std::nullopt : std::optional(Entry{"psi", place, Value{pairs, place}});
}

constexpr DerivativeOrder by_t = {1, 0, 0, 0};

/// True if the terms of a sum cancel whatever their variables are, as those of the imaginary part of psi*conj(psi) do.
bool vanishes(formula::Expression sum) {
  const std::vector<formula::Expression> terms = formula::terms_of(sum, formula::Products::expanded);
  constexpr int points = 16;
  constexpr double rounding = 1e-12;
  for (formula::ScalarEvaluator& evaluate : formula::evaluators_on_branches(terms)) {
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> value(0.5, 1.5);
    std::vector<double> point(evaluate.code().input_count()), values(terms.size());
    for (int n = 0; n < points; ++n) {
      std::ranges::generate(point, [&] { return value(random); });
      evaluate(point, values);
      double total = 0.0, size = 0.0;
      for (const double term : values) {
        total += term;
        size += std::abs(term);
      }
      if (!(std::abs(total) <= rounding * size)) {
        return false;
      }
    }
  }
  return true;
}

/// [field]: L, H with its structure, or equations, as a density.
class FieldReader {
public:
  FieldReader(Section& root, Section& section) : root_(root), section_(section), jets_(root), density_(jets_.density) {}

  /// [multisymplectic] of the problem, and where it was stated.
  Entry derive() {
    const std::array<const Entry*, 3> ways = {section_.take("L"), section_.take("H"), section_.take("equation")};
    const auto given = std::ranges::count_if(ways, [](const Entry* way) { return way != nullptr; });
    if (given != 1) {
      throw ProblemError(
          section_.location(),
          "[field] has a Lagrangian density L, a Hamiltonian density H, or an equation: give one of them");
    }
    const auto [L, H, equation] = ways;
    const Entry* structure = section_.take("structure");
    if (H == nullptr && structure != nullptr) {
      throw ProblemError(structure->location, "structure belongs to a Hamiltonian density H; leave it out");
    }
    const Entry& stated = **std::ranges::find_if(ways, [](const Entry* way) { return way != nullptr; });
    try {
      if (equation != nullptr) {
        read_equations(equation->value);
      } else {
        read_fields(section_.require("fields", R"(the names of the fields, such as ["u"])").value);
        jets_.parameters = read_parameters(root_, jets_.taken);
        const FormulaText text = read_formula(stated.value, stated.key);
        jets_.name_derivatives(text.text);
        check_rates(L != nullptr ? 1 : 0);
        const formula::Expression density = jets_.build(text);
        L != nullptr ? void(density_.L = density) : take_structure(density, *H, structure);
      }
      section_.finish();
      form_ = multisymplectic_form(density_);
      root_.rewrite(data());
      Entry derived = {"multisymplectic", stated.location, form_table(form_, jets_.axes, stated.value.location)};
      name_vectors(derived.value);
      return derived;
    } catch (const ProblemError&) {
      throw;
    } catch (const std::invalid_argument& error) {
      throw ProblemError(stated.value.location, error.what());
    }
  }

  /// The real and imaginary parts of complex unknowns.
  [[nodiscard]] std::vector<std::array<std::string, 2>> psi() const {
    std::vector<std::array<std::string, 2>> names;
    for (const auto& [re, im] : jets_.psi) {
      names.push_back({density_.fields[re], density_.fields[im]});
    }
    return names;
  }

  /// What the fields of the form stand for.
  [[nodiscard]] std::vector<StatedUnknown> unknowns() const {
    std::vector<StatedUnknown> all;
    for (std::size_t i = 0; i < jets_.psi.size(); ++i) {
      const std::string name = complex_name(i, jets_.psi.size());
      const auto add = [&](const std::string& unknown, const std::string& re, const std::string& im) {
        if (has_field(re) && has_field(im)) {
          all.push_back({.name = unknown, .re = {{re, 1.0}}, .im = {{im, 1.0}}});
        }
      };
      const std::string &re = density_.fields[jets_.psi[i][0]], &im = density_.fields[jets_.psi[i][1]];
      add(name, re, im);
      add(derivative_name(name, by_t), derivative_name(re, by_t), derivative_name(im, by_t));
    }
    if (!damped_.empty()) {
      const double rate = density_.damping / 2.0;
      const std::string scaled = "scaled_" + damped_;
      all.push_back({.name = damped_, .rate = rate, .re = {{scaled, 1.0}}});
      for (const std::string& name : form_.fields) {
        const auto derivative = derivative_named(name, {scaled});
        if (derivative && derivative->order == by_t) {
          all.push_back({.name = derivative_name(damped_, by_t), .rate = rate, .re = {{name, 1.0}, {scaled, -rate}}});
        } else if (derivative && derivative->order[0] == 0) {
          all.push_back({.name = derivative_name(damped_, derivative->order), .rate = rate, .re = {{name, 1.0}}});
        }
      }
    }
    return all;
  }

  /// L, as it is stated or was found.
  [[nodiscard]] std::string density() const { return formula::to_string(density_.L); }
  /// Fields of the form that are given by their derivatives by x: potential_u_t by u_t.
  [[nodiscard]] std::vector<InitialSlope> slopes() const {
    std::vector<InitialSlope> all;
    for (const auto& [field, potential] : density_.potentials) {
      for (const std::string& name : form_.fields) {
        if (const auto of_potential = derivative_named(name, {density_.fields[potential]});
            of_potential && of_potential->order == by_t) {
          all.push_back({derivative_name(density_.fields[field], by_t), name});
        }
      }
    }
    return all;
  }

private:
  void read_fields(const Value& value) {
    stated_ = read_names(value, "fields", "a field", jets_.taken);
    density_.fields = stated_.names;
  }
  /// Vectors of fields are listed as such in the form that was derived, so that [initial] takes r = [..], too.
  void name_vectors(Value& form) const {
    auto& fields = std::get<Value::Array>(find(*form.table(), "fields")->value.data);
    if (!std::equal(stated_.names.begin(), stated_.names.end(), form_.fields.begin(),
                    form_.fields.begin() + std::ssize(stated_.names))) {
      return;
    }
    for (const NameList::Group& group : stated_.groups | std::views::reverse) {
      if (group.is_vector) {
        const auto first = fields.begin() + static_cast<std::ptrdiff_t>(group.first);
        first->data = fmt::format("{}[{}]", group.base, group.count);
        fields.erase(first + 1, first + static_cast<std::ptrdiff_t>(group.count));
      }
    }
  }

  /// \throws std::invalid_argument if a derivative of a density has more than so many by t
  void check_rates(int most) const {
    for (const auto& [field, order, variable] : density_.derivatives) {
      if (order[0] > most) {
        throw std::invalid_argument(fmt::format(
            "{} is {}", derivative_name(density_.fields[field], order),
            most == 0
                ? "a derivative by t, and H has none: structure says how fields move; write L in place of H"
                : "of second order in time, and L has first derivatives by t: integrate by parts, or name the rate "
                  "as a field v with its multiplier, L = ... + p*(u_t - v)"));
      }
    }
  }

  void read_equations(const Value& value) {
    std::vector<const Value*> texts;
    if (value.array() != nullptr) {
      for (const Value& one : *value.array()) {
        texts.push_back(&one);
      }
    } else {
      texts.push_back(&value);
    }
    const Entry* psi = section_.take("psi");
    std::optional<Entry> usual;
    if (const Entry* fields = section_.take("fields")) {
      read_fields(fields->value);
    } else {
      if (psi == nullptr && (usual = usual_parts(texts, value.location))) {
        psi = &*usual;
      }
      for (const std::string& name : fields_in(texts)) {
        if (psi == nullptr || (!is_complex_name(name, pairs_of_psi(*psi).size()) && !is_part(name, *psi))) {
          jets_.taken.declare(name, "a field", value.location);
          density_.fields.push_back(name);
        }
      }
    }
    if (psi != nullptr) {
      for (const Value* pair : pairs_of_psi(*psi)) {
        const std::vector<std::string> both = read_names(*pair, "psi", "a field", jets_.taken).names;
        if (both.size() != 2) {
          throw ProblemError(pair->location, fmt::format("psi: expected two fields, got {}", both.size()));
        }
        jets_.psi.push_back({density_.fields.size(), density_.fields.size() + 1});
        density_.fields.insert(density_.fields.end(), both.begin(), both.end());
      }
    }
    jets_.parameters = read_parameters(root_, jets_.taken);
    FieldEquations equations{density_.graph, density_.fields, {}, density_.dimensions, {}};
    for (const Value* text : texts) {
      add_equation(*text, equations.equations);
    }
    equations.derivatives = density_.derivatives;
    if (!equations.derivatives.empty() &&
        std::ranges::none_of(equations.derivatives, [](const auto& one) { return one.order[0] > 0; })) {
      throw ProblemError(texts.front()->location,
                         "no equation has a derivative by t, such as u_t: there is nothing to go on in time");
    }
    density_ = density_of(equations);
    if (density_.damping != 0.0) {
      damped_ = equations.fields.front();
    }
  }

  /// What `psi` gives: one pair of fields, or several.
  static std::vector<const Value*> pairs_of_psi(const Entry& psi) {
    const Value::Array* const pairs = psi.value.array();
    if (pairs == nullptr || pairs->empty() || pairs->front().array() == nullptr) {
      return {&psi.value};
    }
    std::vector<const Value*> all;
    std::ranges::transform(*pairs, std::back_inserter(all), [](const Value& pair) { return &pair; });
    return all;
  }
  static bool is_complex_name(std::string_view name, std::size_t count) {
    return std::ranges::any_of(std::views::iota(std::size_t{0}, count),
                               [&](std::size_t i) { return name == complex_name(i, count); });
  }
  /// One of the fields that `psi` names.
  static bool is_part(const std::string& name, const Entry& psi) {
    return std::ranges::any_of(pairs_of_psi(psi), [&name](const Value* pair) {
      return pair->array() != nullptr && std::ranges::any_of(*pair->array(), [&name](const Value& part) {
               return part.string() != nullptr && *part.string() == name;
             });
    });
  }
  void add_equation(const Value& value, std::vector<formula::Expression>& equations) {
    const std::string& text = read_string(value, "equation");
    const std::size_t sign = at_location(value.location, [&] { return sign_of_equation(text); });
    const Complex left = jets_.side({text.substr(0, sign), value.location}),
                  right = jets_.side({text.substr(sign + 1), place_in_file(value.location, 1, sign + 2)});
    equations.push_back(left.re - right.re);
    const formula::Expression zero = density_.graph->constant(0.0);
    if (const auto im = left.im.value_or(zero) - right.im.value_or(zero); !vanishes(im)) {
      equations.push_back(im);
    }
  }

  /// The problem with [initial] and [exact] of psi by its parts, and with [initial] of [exact] where there is none.
  Value::Table data() {
    Value::Table root = root_.entries();
    Entry *const exact = find(root, "exact"), *initial = find(root, "initial");
    for (Entry* const table : {exact, initial}) {
      if (table == nullptr || table->value.table() == nullptr) {
        continue;
      }
      take_apart(*table->value.table());
      scale(*table->value.table());
      if (table == initial) {
        follow(*table->value.table());
      }
      if (Entry* next = find(*table->value.table(), "next"); next != nullptr && next->value.table() != nullptr) {
        take_apart(*next->value.table());
      }
    }
    if (initial == nullptr && exact != nullptr && exact->value.table() != nullptr) {
      Entry start{"initial", exact->location, exact->value};
      add_rates(*start.value.table());
      follow(*start.value.table());
      root.push_back(std::move(start));
    }
    if (!damped_.empty()) {
      add_damped(root);
    }
    return root;
  }

  /// u = "…" of a damped equation becomes scaled_u = "exp(at/2)*(…)", and so does u_t.
  void scale(Value::Table& table) const {
    if (damped_.empty()) {
      return;
    }
    const std::string rate = derivative_name(damped_, by_t), grown = fmt::format("exp({}*t)*(", density_.damping / 2.0);
    const Entry* const stated = find(table, damped_);
    const std::string whole = stated == nullptr ? "" : read_formula(stated->value, damped_).text;
    for (Entry& entry : table) {
      if (entry.key != damped_ && entry.key != rate) {
        continue;
      }
      const std::string text = grown + read_formula(entry.value, entry.key).text;
      if (entry.key == rate && stated == nullptr) {
        throw ProblemError(entry.location, fmt::format("{} needs {} beside it", rate, damped_));
      }
      const std::string more = entry.key == rate ? fmt::format(" + {}*({})", density_.damping / 2.0, whole) : "";
      Location location = entry.value.location;
      location.column -= static_cast<int>(grown.size());  // messages count from the beginning of the formula
      entry = {"scaled_" + entry.key, entry.location, {text + more + ")", location}};
    }
  }
  /// Defines u and its derivatives by what the form has in their places.
  void add_damped(Value::Table& root) const {
    if (find(root, "definitions") == nullptr) {
      root.push_back({"definitions", section_.location(), {Value::Table{}, section_.location()}});
    }
    Value::Table& definitions = *find(root, "definitions")->value.table();
    for (const StatedUnknown& unknown : unknowns()) {
      std::string sum;
      for (const auto& [field, factor] : unknown.re) {
        sum += sum.empty() ? field : fmt::format(" + ({})*{}", factor, field);
      }
      const std::string text = fmt::format("exp({}*t)*({})", -unknown.rate, sum);
      definitions.push_back({unknown.name, section_.location(), {text, section_.location()}});
    }
  }
  [[nodiscard]] bool has_field(const std::string& name) const {
    return std::ranges::find(form_.fields, name) != form_.fields.end();
  }

  /// psi = "…" becomes p = "…" and q = "…", and psi_t likewise.
  void take_apart(Value::Table& table) {
    for (std::size_t i = 0; i < jets_.psi.size(); ++i) {
      const std::string name = complex_name(i, jets_.psi.size());
      const std::string &re = density_.fields[jets_.psi[i][0]], &im = density_.fields[jets_.psi[i][1]];
      take_apart(table, name, re, im);
      if (has_field(derivative_name(re, by_t))) {
        take_apart(table, derivative_name(name, by_t), derivative_name(re, by_t), derivative_name(im, by_t));
      }
    }
  }
  void take_apart(Value::Table& table, const std::string& name, const std::string& re, const std::string& im) {
    const auto place = std::ranges::find(table, name, &Entry::key);
    if (place == table.end()) {
      return;
    }
    const Entry whole = *place;
    const FormulaText text = read_formula(whole.value, name);
    formula::Graph& graph = *density_.graph;
    std::map<formula::NodeIndex, Complex> parts;
    parts[graph.variable("i").index()] = {graph.constant(0.0), graph.constant(1.0)};
    const Complex value =
        at_location(text.location, [&] { return ComplexParts(graph, std::move(parts))(jets_.build(text)); });
    const auto entry = [&](const std::string& field, formula::Expression e) {
      return Entry{field, whole.location, {formula::to_string(e), whole.value.location}};
    };
    *place = entry(re, value.re);
    table.insert(std::ranges::find(table, re, &Entry::key) + 1, entry(im, value.im.value_or(graph.constant(0.0))));
  }
  /// Adds u_t, the derivative of u = "…" by t, where the form has it and the table has not.
  void add_rates(Value::Table& table) {
    const Value::Table given = table;
    std::vector<std::string> wanted = form_.fields;
    std::ranges::transform(slopes(), std::back_inserter(wanted), &InitialSlope::name);
    for (const std::string& name : wanted) {
      const auto rate = derivative_named(name, density_.fields);
      const Entry* const of = rate && rate->order == by_t ? find(given, density_.fields[rate->field]) : nullptr;
      if (of == nullptr || find(given, name) != nullptr || of->value.table() != nullptr) {
        continue;
      }
      const FormulaText text = read_formula(of->value, of->key);
      const formula::Expression by_time = formula::derivative(jets_.build(text), density_.graph->variable("t"));
      table.push_back({name, of->location, {formula::to_string(by_time), of->value.location}});
    }
  }
  void follow(Value::Table& table) {
    follow_rates(table, {form_.fields, density_.fields, jets_.axes}, *density_.graph,
                 [this](const FormulaText& text) { return jets_.build(text); });
  }
  std::size_t read_field_name(const Value& value, std::string_view what) {
    const std::string& name = read_string(value, what);
    const auto found = std::ranges::find(density_.fields, name);
    if (found == density_.fields.end()) {
      throw ProblemError(value.location, fmt::format("{}: {} is not a field; the fields are {}", what, name,
                                                     fmt::join(density_.fields, ", ")));
    }
    return static_cast<std::size_t>(found - density_.fields.begin());
  }
  /// Two fields.
  std::array<std::size_t, 2> read_pair(const Value& value, std::string_view what) {
    const auto& both = read_array(value, what, "two fields");
    if (both.size() != 2) {
      throw ProblemError(value.location, fmt::format("{}: expected two fields, got {}", what, both.size()));
    }
    return {read_field_name(both[0], what), read_field_name(both[1], what)};
  }
  /// The entries of `pairs`, if it is given.
  std::vector<std::array<std::size_t, 2>> read_pairs() {
    std::vector<std::array<std::size_t, 2>> pairs;
    if (const Entry* entry = section_.take("pairs")) {
      std::vector<std::size_t> paired;
      for (const Value& pair : read_array(entry->value, "pairs", "pairs of fields")) {
        pairs.push_back(read_pair(pair, "pairs"));
        for (const std::size_t f : pairs.back()) {
          if (std::ranges::find(paired, f) != paired.end()) {
            throw ProblemError(pair.location, fmt::format("pairs: {} is in a pair twice; a field that is not coupled "
                                                          "with another is left out",
                                                          density_.fields[f]));
          }
          paired.push_back(f);
        }
      }
    }
    return pairs;
  }

  /// L = Σ (what gives the structure) - H.
  void take_structure(formula::Expression H, const Entry& stated, const Entry* structure) {
    if (structure == nullptr) {
      throw ProblemError(stated.location, fmt::format("H needs its structure: {}", fmt::join(structure_words, ", ")));
    }
    const std::size_t word = read_word(structure->value, "structure", structure_words);
    formula::Expression L = -H;
    const auto pairs = word == 2 ? read_psi() : read_pairs();
    if (word == 0 && pairs.empty()) {
      throw ProblemError(structure->location, R"(canonical needs pairs = [["u", "v"]]: u_t = dH/dv, v_t = -dH/du)");
    }
    if (word == 0 || word == 2) {
      const double factor = word == 2 ? 2.0 : 1.0;
      for (const auto& [u, v] : pairs) {
        L = L + factor * jets_.field(v) * jets_.derivative(u, by_t);
      }
    } else {
      L = L + of_dx(pairs, word == 3);
      if (word == 3 && !pairs.empty()) {
        throw ProblemError(structure->location, "dx/(1-dxx) is for single fields; leave pairs out");
      }
    }
    density_.L = L;
  }

  std::vector<std::array<std::size_t, 2>> read_psi() {
    const Entry& psi = section_.require("psi", R"(its real and imaginary part, such as ["p", "q"])");
    for (const Value* pair : pairs_of_psi(psi)) {
      jets_.psi.push_back(read_pair(*pair, "psi"));
    }
    return jets_.psi;
  }

  static constexpr DerivativeOrder by_x = {0, 1, 0, 0};

  /// u_t = ∂_x δH/δu has L = ½ φ_t φ_x - H, u = φ_x; of a pair, u_t = ∂_x δH/δv, it is φ_t v - H. With (1 - ∂_xx)⁻¹ the
  /// term ½ u_t u_x more.
  formula::Expression of_dx(const std::vector<std::array<std::size_t, 2>>& pairs, bool with_inverse) {
    formula::Expression sum = density_.graph->constant(0.0);
    const auto potential_of = [&](std::size_t u) {
      const std::size_t potential = density_.fields.size();
      density_.fields.push_back("potential_" + density_.fields[u]);
      density_.potentials.push_back({u, potential});
      return potential;
    };
    if (!pairs.empty()) {
      for (const auto& [u, v] : pairs) {
        sum = sum + jets_.field(v) * jets_.derivative(potential_of(u), by_t);
      }
      return sum;
    }
    const std::size_t count = density_.fields.size();
    for (std::size_t u = 0; u < count; ++u) {
      sum = sum + 0.5 * jets_.field(u) * jets_.derivative(potential_of(u), by_t);
      if (with_inverse) {
        sum = sum + 0.5 * jets_.derivative(u, by_t) * jets_.derivative(u, by_x);
      }
    }
    return sum;
  }

  Section& root_;
  Section& section_;
  JetFormulas jets_;
  FieldDensity& density_;  ///< of jets_
  std::string damped_;     ///< the field of a damped equation, of which the form has a multiple
  MultisymplecticForm form_;
  NameList stated_;  ///< fields, where they are listed
};

}  // namespace

namespace {

/// Adds the linear symmetries of the equation to those that the problem states, whose names are free: that of the phase
/// of psi as `charge`, of psi1, psi2 as `charge_1`, `charge_2`, others as `symmetry_1` and so on. \return them as a
/// table
Value::Table find_symmetries(const std::vector<std::array<std::string, 2>>& psi, const Location& place,
                             Problem& problem) {
  auto& pde = std::get<MultisymplecticProblem>(problem.system);
  const MultisymplecticSystem system = make_laboratory_system(problem);
  const LinearSymmetries all(system);
  std::vector<Eigen::MatrixXd> known;
  for (const StatedSymmetry& symmetry : pde.symmetries) {
    known.push_back(dense(symmetry.B));
  }
  Value::Table table;
  const auto is_free = [&](const std::string& name) {
    return std::ranges::find(pde.symmetries, name, &StatedSymmetry::name) == pde.symmetries.end() &&
           std::ranges::find(pde.invariants, name, &NamedFormula::name) == pde.invariants.end();
  };
  const auto add = [&](const std::string& name, const Eigen::MatrixXd& B) {
    const std::size_t d = pde.fields.size();
    Matrix matrix{d, {}, place};
    Value::Array triples;
    for (std::size_t i = 0; i < d; ++i) {
      for (std::size_t j = 0; j < d; ++j) {
        const double entry = B(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
        matrix.entries.push_back(entry);
        if (entry != 0.0) {
          triples.push_back({Value::Array{{pde.fields[i], place}, {pde.fields[j], place}, {entry, place}}, place});
        }
      }
    }
    pde.symmetries.push_back({name, std::move(matrix), true});
    table.push_back({name, place, {triples, place}});
    known.push_back(B);
  };
  for (std::size_t i = 0; i < psi.size(); ++i) {
    const std::string name = psi.size() == 1 ? "charge" : fmt::format("charge_{}", i + 1);
    const auto B = all.phase(system.field(psi[i][0]), system.field(psi[i][1]));
    if (B && is_free(name) && LinearSymmetries::is_beside(*B, known)) {
      add(name, *B);
    }
  }
  for (const Eigen::MatrixXd& B : all.beside(known)) {
    std::size_t number = 1;
    while (!is_free(fmt::format("symmetry_{}", number))) {
      ++number;
    }
    add(fmt::format("symmetry_{}", number), B);
  }
  return table;
}

}  // namespace

Value form_table(const MultisymplecticForm& form, std::span<const std::string> axes, const Location& place) {
  const auto text = [&](std::string_view word) { return Value{std::string(word), place}; };
  Value::Array fields;
  for (const std::string& name : form.fields) {
    fields.push_back(text(name));
  }
  const auto matrix = [&](std::size_t mu) {
    Value::Array entries;
    for (const auto& [row, column, value] : form.terms.at(mu)) {
      entries.push_back({Value::Array{text(form.fields[row]), text(form.fields[column]), Value{value, place}}, place});
    }
    return Value{entries, place};
  };
  Value::Table K;
  for (std::size_t a = 0; a < axes.size(); ++a) {
    K.push_back({axes[a], place, matrix(1 + a)});
  }
  return {Value::Table{{"fields", place, {fields, place}},
                       {"M", place, matrix(0)},
                       {"K", place, {K, place}},
                       {"S", place, text(formula::to_string(form.S))}},
          place};
}

void read_field(Section& root, Section& section, Problem& problem) {
  FieldReader reader(root, section);
  const Entry derived = reader.derive();
  Section form(*derived.value.table(), section.location(), "[multisymplectic]");
  read_multisymplectic(root, form, problem, reader.slopes());
  auto& pde = std::get<MultisymplecticProblem>(problem.system);
  Value::Table text = {derived};
  if (!pde.driven) {
    if (Value::Table found = find_symmetries(reader.psi(), section.location(), problem); !found.empty()) {
      text.push_back({"symmetries", section.location(), {std::move(found), section.location()}});
    }
  }
  pde.derived = write_document({std::move(text), section.location()});
  pde.density = reader.density();
  pde.unknowns = reader.unknowns();
}

}  // namespace rubato
