#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <memory>
#include <optional>
#include <regex>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/pde/inverse_problem.hpp>
#include <rubato/pde/linear_symmetries.hpp>
#include <rubato/pde/multisymplectic_form.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {
namespace {

/// The directions of [grid], whose reader refuses what else is wrong with it.
std::vector<std::string> axes_of(const Section& root) {
  std::vector<std::string> axes;
  if (const Entry* grid = find(root.entries(), "grid"); grid != nullptr && grid->value.table() != nullptr) {
    for (const std::string_view axis : axis_letters) {
      if (find(*grid->value.table(), axis) != nullptr) {
        axes.emplace_back(axis);
      }
    }
  }
  return axes;
}

/// The names in a text.
std::set<std::string> names_in(std::string_view text) {
  const auto begins = [](char c) { return (std::isalpha(static_cast<unsigned char>(c)) != 0) || c == '_'; };
  const auto goes_on = [&](char c) { return begins(c) || (std::isdigit(static_cast<unsigned char>(c)) != 0); };
  std::set<std::string> names;
  for (std::size_t i = 0; i < text.size();) {
    if (!goes_on(text[i])) {
      ++i;
      continue;
    }
    const std::size_t first = i;
    while (i < text.size() && goes_on(text[i])) {
      ++i;
    }
    if (begins(text[first])) {
      names.emplace(text.substr(first, i - first));
    }
  }
  return names;
}

/// The derivative that a name says, "u_xt": of which field, and how often by each direction.
struct NamedDerivative {
  std::string name;
  std::size_t field = 0;
  DerivativeOrder order = {};
};
std::optional<NamedDerivative> derivative_of(const std::string& name, const std::vector<std::string>& fields) {
  constexpr std::string_view letters = "txyz";
  for (std::size_t f = 0; f < fields.size(); ++f) {
    if (!name.starts_with(fields[f] + "_") || name.size() == fields[f].size() + 1) {
      continue;
    }
    NamedDerivative found{name, f, {}};
    const std::string_view suffix = std::string_view(name).substr(fields[f].size() + 1);
    if (suffix.find_first_not_of(letters) != std::string_view::npos) {
      continue;
    }
    for (const char letter : suffix) {
      ++found.order.at(letters.find(letter));
    }
    return found;
  }
  return std::nullopt;
}

/// A complex number of formulas; no imaginary part: 0.
struct Complex {
  formula::Expression re;
  std::optional<formula::Expression> im;
};

/// A formula with the variables i and psi, psi_x, … in its real and imaginary part.
class ComplexParts {
public:
  /// \param parts what variables stand for that are not real, by their nodes
  ComplexParts(formula::Graph& graph, std::map<formula::NodeIndex, Complex> parts)
      : graph_(graph), parts_(std::move(parts)) {}

  /// \throws std::invalid_argument at a function of a complex number
  [[nodiscard]] Complex operator()(formula::Expression e) {
    if (const auto part = parts_.find(e.index()); part != parts_.end()) {
      return part->second;
    }
    const formula::Node node = graph_.node(e.index());
    const int arguments = formula::arity(node.operation);
    if (arguments == 0) {
      return {e, std::nullopt};
    }
    const formula::Expression first(&graph_, node.a), second(&graph_, node.b);
    const Complex a = (*this)(first), b = arguments == 2 ? (*this)(second) : Complex{first, std::nullopt};
    using formula::Operation;
    if (!a.im && !b.im) {
      return {arguments == 2 ? graph_.make(node.operation, a.re, b.re) : graph_.make(node.operation, a.re),
              std::nullopt};
    }
    const auto either = [](const auto& one, const auto& other, double sign) {
      return !other ? one : !one ? std::optional(sign * *other) : std::optional(*one + sign * *other);
    };
    switch (node.operation) {
      case Operation::add: return {a.re + b.re, either(a.im, b.im, 1.0)};
      case Operation::subtract: return {a.re - b.re, either(a.im, b.im, -1.0)};
      case Operation::negate: return {-a.re, either(std::optional<formula::Expression>(), a.im, -1.0)};
      case Operation::multiply: return product(a, b);
      case Operation::divide:
        if (!b.im) {
          return {a.re / b.re, *a.im / b.re};
        }
        break;
      case Operation::power:
        if (second.is_constant() && (second.constant_value() == 2.0 || second.constant_value() == 3.0)) {
          return second.constant_value() == 2.0 ? product(a, a) : product(a, product(a, a));
        }
        break;
      default: break;
    }
    throw std::invalid_argument(
        fmt::format("{} of a complex number: only sums, products and squares are known; abs2(psi) "
                    "is its squared modulus",
                    formula::name(node.operation)));
  }

private:
  static Complex product(const Complex& a, const Complex& b) {
    if (!a.im || !b.im) {
      return {a.re * b.re, a.im ? *a.im * b.re : a.re * *b.im};
    }
    return {a.re * b.re - *a.im * *b.im, a.re * *b.im + *a.im * b.re};
  }

  formula::Graph& graph_;
  std::map<formula::NodeIndex, Complex> parts_;
};

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

/// [field]: L, H with its structure, or equations, as a density.
class FieldReader {
public:
  FieldReader(Section& root, Section& section)
      : root_(root), section_(section), taken_(names_of_lattice(root)), axes_(axes_of(root)) {
    density_.graph = std::make_shared<formula::Graph>();
    density_.dimensions = static_cast<int>(axes_.size());
  }

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
        parameters_ = read_parameters(root_, taken_);
        const FormulaText text = read_formula(stated.value, stated.key);
        name_derivatives(text.text);
        const formula::Expression density = build(text);
        L != nullptr ? void(density_.L = density) : take_structure(density, *H, structure);
      }
      section_.finish();
      return {"multisymplectic", stated.location, table_of(multisymplectic_form(density_), stated.value.location)};
    } catch (const ProblemError&) {
      throw;
    } catch (const std::invalid_argument& error) {
      throw ProblemError(stated.value.location, error.what());
    }
  }

  /// The real and imaginary part of a complex unknown, or none.
  [[nodiscard]] std::vector<std::string> psi() const {
    std::vector<std::string> names;
    std::ranges::transform(psi_, std::back_inserter(names), [this](std::size_t f) { return density_.fields[f]; });
    return names;
  }

private:
  void read_fields(const Value& value) { density_.fields = read_names(value, "fields", "a field", taken_).names; }

  void read_equations(const Value& value) {
    std::vector<const Value*> texts;
    if (value.array() != nullptr) {
      for (const Value& one : *value.array()) {
        texts.push_back(&one);
      }
    } else {
      texts.push_back(&value);
    }
    const Entry* const psi = section_.take("psi");
    if (const Entry* fields = section_.take("fields")) {
      read_fields(fields->value);
    } else {
      for (const std::string& name : fields_in(texts)) {
        if (psi == nullptr || name != complex_name) {
          taken_.declare(name, "a field", value.location);
          density_.fields.push_back(name);
        }
      }
    }
    if (psi != nullptr) {
      for (const std::string& name : read_names(psi->value, "psi", "a field", taken_).names) {
        psi_.push_back(density_.fields.size());
        density_.fields.push_back(name);
      }
      if (psi_.size() != 2) {
        throw ProblemError(psi->value.location, fmt::format("psi: expected two fields, got {}", psi_.size()));
      }
    }
    parameters_ = read_parameters(root_, taken_);
    FieldEquations equations{density_.graph, density_.fields, {}, density_.dimensions, {}};
    for (const Value* text : texts) {
      add_equation(*text, equations.equations);
    }
    equations.derivatives = density_.derivatives;
    density_ = density_of(equations);
  }

  static constexpr std::string_view complex_name = "psi", modulus_name = "abs2_psi_";

  void add_equation(const Value& value, std::vector<formula::Expression>& equations) {
    std::string text = read_string(value, "equation");
    const std::size_t sign = text.find('=');
    if (sign == std::string::npos || text.find('=', sign + 1) != std::string::npos) {
      throw ProblemError(value.location, fmt::format("\"{}\" is no equation: write left side = right side", text));
    }
    if (!psi_.empty()) {
      name_modulus(text);
    }
    const FormulaText left{text.substr(0, sign), value.location},
        right{text.substr(sign + 1), place_in_file(value.location, 1, sign + 2)};
    name_derivatives(text);
    const formula::Expression difference = build(left) - build(right);
    if (psi_.empty()) {
      equations.push_back(difference);
      return;
    }
    std::map<formula::NodeIndex, Complex> parts;
    formula::Graph& graph = *density_.graph;
    parts[graph.variable("i").index()] = {graph.constant(0.0), graph.constant(1.0)};
    parts[graph.variable(modulus_name).index()] = {pow(field(psi_[0]), 2.0) + pow(field(psi_[1]), 2.0), std::nullopt};
    for (const auto& [name, order] : complex_names_) {
      parts[graph.variable(name).index()] = {derivative(psi_[0], order), derivative(psi_[1], order)};
    }
    const Complex whole = ComplexParts(graph, std::move(parts))(difference);
    equations.push_back(whole.re);
    if (whole.im) {
      equations.push_back(*whole.im);
    }
  }
  /// Puts a name in the place of abs2(psi), with spaces to the same length, so that later errors keep their columns.
  static void name_modulus(std::string& text) {
    static const std::regex modulus(R"(\babs2\(\s*psi\s*\))");
    for (std::smatch found; std::regex_search(text, found, modulus);) {
      std::string name(modulus_name);
      name.resize(static_cast<std::size_t>(found.length()), ' ');
      text.replace(static_cast<std::size_t>(found.position()), name.size(), name);
    }
  }

  /// Makes variables of the derivatives that a text names, itself or through definitions.
  void name_derivatives(const std::string& text) {
    std::set<std::string> words = names_in(text);
    if (const Entry* definitions = find(root_.entries(), "definitions");
        definitions != nullptr && definitions->value.table() != nullptr) {
      for (const Entry& definition : *definitions->value.table()) {
        if (const std::string* formula = definition.value.string()) {
          words.merge(names_in(*formula));
        }
      }
    }
    for (const std::string& word : words) {
      if (parameters_.find(word) != nullptr) {
        continue;
      }
      if (const auto found = derivative_of(word, density_.fields)) {
        names_.insert(word);
        const formula::Expression variable = density_.graph->variable(word);
        if (std::ranges::find(density_.derivatives, variable, &FieldDensity::Derivative::variable) ==
            density_.derivatives.end()) {
          density_.derivatives.push_back({found->field, found->order, variable});
        }
      } else if (!psi_.empty() && word == complex_name) {
        complex_names_[word] = {};
      } else if (const auto complex = derivative_of(word, {std::string(complex_name)}); complex && !psi_.empty()) {
        complex_names_[word] = complex->order;
      }
    }
  }
  formula::Expression build(const FormulaText& text) {
    std::vector<std::string> names = density_.fields;
    names.insert(names.end(), names_.begin(), names_.end());
    for (const auto& [name, order] : complex_names_) {
      names.push_back(name);
    }
    if (!psi_.empty()) {
      names.emplace_back("i");
      names.emplace_back(modulus_name);
    }
    names.insert(names.end(), axes_.begin(), axes_.end());
    names.emplace_back("t");
    if (!std::exchange(has_definitions_, true)) {
      std::vector<formula::Expression> differentiated;
      add_definitions(
          root_, taken_,
          {.names = names, .differentiable = density_.fields, .axes = axes_, .differentiated = &differentiated},
          parameters_);
    }
    return build_formula(text, *density_.graph, {.names = names}, parameters_);
  }

  formula::Expression field(std::size_t f) { return density_.graph->variable(density_.fields[f]); }
  /// Its derivative, of that order.
  formula::Expression derivative(std::size_t f, const DerivativeOrder& order) {
    if (order == DerivativeOrder{}) {
      return field(f);
    }
    const std::string name = derivative_name(density_.fields[f], order);
    const auto found = std::ranges::find_if(density_.derivatives,
                                            [&](const auto& one) { return one.field == f && one.order == order; });
    if (found != density_.derivatives.end()) {
      return found->variable;
    }
    density_.derivatives.push_back({f, order, density_.graph->variable(name)});
    return density_.derivatives.back().variable;
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
      for (const Value& pair : read_array(entry->value, "pairs", "pairs of fields")) {
        pairs.push_back(read_pair(pair, "pairs"));
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
        L = L + factor * field(v) * derivative(u, by_t);
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
    const auto pair = read_pair(psi.value, "psi");
    psi_.assign(pair.begin(), pair.end());
    return {pair};
  }

  static constexpr DerivativeOrder by_t = {1, 0, 0, 0}, by_x = {0, 1, 0, 0};

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
        sum = sum + field(v) * derivative(potential_of(u), by_t);
      }
      return sum;
    }
    const std::size_t count = density_.fields.size();
    for (std::size_t u = 0; u < count; ++u) {
      sum = sum + 0.5 * field(u) * derivative(potential_of(u), by_t);
      if (with_inverse) {
        sum = sum + 0.5 * derivative(u, by_t) * derivative(u, by_x);
      }
    }
    return sum;
  }

  [[nodiscard]] Value table_of(const MultisymplecticForm& form, const Location& place) const {
    const auto text = [&](std::string_view word) { return Value{std::string(word), place}; };
    Value::Array fields;
    for (const std::string& name : form.fields) {
      fields.push_back(text(name));
    }
    const auto matrix = [&](std::size_t mu) {
      Value::Array entries;
      for (const auto& [row, column, value] : form.terms.at(mu)) {
        entries.push_back(
            {Value::Array{text(form.fields[row]), text(form.fields[column]), Value{value, place}}, place});
      }
      return Value{entries, place};
    };
    Value::Table K;
    for (std::size_t a = 0; a < axes_.size(); ++a) {
      K.push_back({axes_[a], place, matrix(1 + a)});
    }
    return {Value::Table{{"fields", place, {fields, place}},
                         {"M", place, matrix(0)},
                         {"K", place, {K, place}},
                         {"S", place, text(formula::to_string(form.S))}},
            place};
  }

  Section& root_;
  Section& section_;
  Names taken_;
  std::vector<std::string> axes_;
  std::vector<std::size_t> psi_;                          ///< the two fields of a complex unknown, or none
  std::set<std::string> names_;                           ///< of derivatives
  std::map<std::string, DerivativeOrder> complex_names_;  ///< psi and its derivatives
  bool has_definitions_ = false;
  FieldDensity density_;
  Parameters parameters_;
};

}  // namespace

namespace {

/// Adds the linear symmetries of the equation to those that the problem states, whose names are free: that of the phase
/// of psi as `charge`, others as `symmetry_1` and so on. \return them as a table
Value::Table find_symmetries(const std::vector<std::string>& psi, const Location& place, Problem& problem) {
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
    pde.symmetries.push_back({name, std::move(matrix)});
    table.push_back({name, place, {triples, place}});
    known.push_back(B);
  };
  if (!psi.empty()) {
    const auto B = all.phase(system.field(psi[0]), system.field(psi[1]));
    if (B && is_free("charge") && LinearSymmetries::is_beside(*B, known)) {
      add("charge", *B);
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

void read_field(Section& root, Section& section, Problem& problem) {
  FieldReader reader(root, section);
  const Entry derived = reader.derive();
  Section form(*derived.value.table(), section.location(), "[multisymplectic]");
  read_multisymplectic(root, form, problem);
  auto& pde = std::get<MultisymplecticProblem>(problem.system);
  Value::Table text = {derived};
  if (!pde.driven) {
    if (Value::Table found = find_symmetries(reader.psi(), section.location(), problem); !found.empty()) {
      text.push_back({"symmetries", section.location(), {std::move(found), section.location()}});
    }
  }
  pde.derived = write_document({std::move(text), section.location()});
}

}  // namespace rubato
