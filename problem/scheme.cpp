#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/ode/generating_action.hpp>
#include <rubato/ode/orbit_methods.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/variation/action_quadrature.hpp>
#include <rubato/variation/composition.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {
namespace {

const OrbitMethod& registered(LagrangianName lagrangian) {
  return orbit_methods()[static_cast<std::size_t>(lagrangian)];
}

/// Reads [scheme], one entry after the other.
class SchemeReader {
public:
  SchemeReader(Section section, const Problem& problem)
      : section_(std::move(section)), problem_(problem), parameters_(problem.parameters) {}

  Scheme read() {
    scheme_.location = section_.location();
    read_lagrangian();
    read_order();
    read_gauss();
    read_composition();
    read_space_stages();
    read_space();
    read_levels();
    read_potential();
    read_generating();
    read_custom();
    if (const Entry* entry = take_only_for("allow_unstable", LagrangianName::forward)) {
      scheme_.allow_unstable = read_boolean(entry->value, "allow_unstable");
    }
    if (const Entry* entry = section_.take("time_scale"); entry != nullptr && problem_.hamiltonian() == nullptr) {
      throw ProblemError(entry->location, "time_scale is for orbits ([hamiltonian]); leave it out");
    }
    scheme_.frame = read_frame(section_, problem_);
    scheme_.tangents = read_tangents(section_, problem_);
    read_limits();
    read_times();
    section_.finish();
    if (const auto* pde = problem_.multisymplectic()) {
      check_lattice(*pde);
    }
    return scheme_;
  }

private:
  [[nodiscard]] bool in_fictitious_time() const {
    return problem_.hamiltonian() != nullptr && problem_.hamiltonian()->fictitious_time;
  }
  [[nodiscard]] bool is_driven() const { return problem_.hamiltonian() != nullptr && problem_.hamiltonian()->driven; }

  [[nodiscard]] bool is_by_L() const { return problem_.hamiltonian() != nullptr && problem_.hamiltonian()->L; }

  /// What a word of another kind of problem is for; empty if it is of none.
  [[nodiscard]] static std::string_view owner_of(std::string_view word) {
    const auto has = [word](std::span<const std::string_view> words) {
      return std::ranges::find(words, word) != words.end();
    };
    return has(hamiltonian_lagrangians()) ? "ODEs ([hamiltonian])"
           : has(quadratures())           ? "problems stated by L ([lagrangian])"
           : has(lattice_lagrangians())   ? "lattices ([multisymplectic])"
                                          : "";
  }

  void read_lagrangian() {
    const bool ode = problem_.hamiltonian() != nullptr;
    const std::span<const std::string_view> own = is_by_L() ? quadratures()
                                                  : ode     ? hamiltonian_lagrangians()
                                                            : lattice_lagrangians();
    scheme_.lagrangian_location = scheme_.location;
    std::size_t which = 0;
    if (const Entry* entry = section_.take("lagrangian")) {
      scheme_.lagrangian_location = entry->value.location;
      if (const auto* word = entry->value.string();
          word && std::ranges::find(own, *word) == own.end() && !owner_of(*word).empty()) {
        throw ProblemError(entry->value.location, fmt::format("lagrangian = \"{}\" is for {}; here it may be \"{}\"",
                                                              *word, owner_of(*word), fmt::join(own, "\", \"")));
      }
      which = read_word(entry->value, "lagrangian", own);
    }
    if (ode) {
      const auto methods = orbit_methods();
      scheme_.lagrangian =
          static_cast<LagrangianName>(std::ranges::find(methods, own[which], &OrbitMethod::name) - methods.begin());
    } else {
      scheme_.lagrangian = LagrangianName::of_lattice;
      scheme_.method = own[which];
    }
  }

  void read_levels() {
    scheme_.levels_location = scheme_.location;
    if (const Entry* entry = section_.take("levels")) {
      scheme_.levels = static_cast<Levels>(read_word(entry->value, "levels", levels_words));
      scheme_.levels_location = entry->value.location;
    }
    if (const Entry* entry = section_.take_outdated("bridge")) {
      scheme_.outdated = entry->location;
    }
    if (const Entry* entry = section_.take("on_singular")) {
      const auto* const word = entry->value.string();
      if (word != nullptr && (*word == "bridge" || *word == "fixed")) {
        scheme_.outdated = entry->location;
      } else {
        scheme_.on_singular = static_cast<OnSingular>(read_word(entry->value, "on_singular", on_singular_words));
      }
    }
  }

  /// Whether a step potential is chosen where the problem says nothing of it.
  [[nodiscard]] bool has_usual_potential() const {
    return scheme_.levels == Levels::variable && takes_potential() && (!says("on_singular") || scheme_.outdated);
  }
  [[nodiscard]] bool says(std::string_view key) const { return find(section_.entries(), key) != nullptr; }
  [[nodiscard]] bool takes_potential() const { return lattice_entry() != nullptr || orbit_method().takes_potential; }

  void read_potential() {
    using Kind = StepPotentialChoice::Kind;
    const Entry* entry = find(section_.entries(), "step_potential");
    scheme_.potential_location = entry != nullptr ? entry->value.location : scheme_.location;
    if (entry != nullptr && entry->value.table() != nullptr) {
      std::optional<Section> numbers = section_.take_section("step_potential");
      scheme_.potential.kind = Kind::given;
      const Entry* kappa = numbers->take("kappa");
      const Entry* p = numbers->take("p");
      numbers->finish();
      if (kappa == nullptr || p == nullptr) {
        throw ProblemError(numbers->location(), "step_potential needs kappa and p, such as { kappa = 2.5, p = 8 }");
      }
      scheme_.potential.kappa = read_positive(kappa->value, "kappa");
      scheme_.potential.exponent = read_positive(p->value, "p");
    } else if (section_.take("step_potential") != nullptr) {
      scheme_.potential.kind = static_cast<Kind>(read_word(entry->value, "step_potential", potential_words));
    } else if (has_usual_potential()) {
      scheme_.usual_potential = true;
      scheme_.potential.kind = Kind::automatic;
    }
    if (scheme_.potential.kind != Kind::none && entry != nullptr) {
      if (scheme_.levels == Levels::fixed || scheme_.lagrangian == LagrangianName::custom) {
        throw ProblemError(
            entry->location,
            scheme_.levels == Levels::fixed
                ? "step_potential applies to levels = \"variable\"; leave it out"
                : "step_potential is not for lagrangian = \"custom\": write it into L, as -f(t_1 - t_0)");
      }
      if (scheme_.lagrangian == LagrangianName::forward && scheme_.potential.kind == Kind::automatic) {
        throw ProblemError(entry->location,
                           "step_potential = \"auto\" is not for lagrangian = \"forward\", which is unstable over the "
                           "steps that choose one; give kappa and p, or leave it out");
      }
    }
    if (const Entry* largest = section_.take("largest_step")) {
      if (scheme_.potential.kind != Kind::automatic) {
        throw ProblemError(largest->location, "largest_step applies to step_potential = \"auto\"");
      }
      scheme_.potential.largest_step = read_positive(largest->value, "largest_step");
    }
  }

  /// An entry that means something for one kind of 𝕃 only.
  const Entry* take_only_for(std::string_view key, LagrangianName lagrangian) {
    return take_only_for(key, scheme_.lagrangian == lagrangian, to_string(lagrangian));
  }
  const Entry* take_only_for(std::string_view key, bool applies, std::string_view owners) {
    const Entry* entry = section_.take(key);
    if (entry != nullptr && !applies) {
      throw ProblemError(entry->location, fmt::format("{} applies to lagrangian = \"{}\", and this problem has \"{}\"; "
                                                      "leave it out",
                                                      key, owners, scheme_.word()));
    }
    return entry;
  }

  [[nodiscard]] const LatticeMethodEntry* lattice_entry() const {
    return scheme_.method.empty() ? nullptr : &lattice_method_entry(scheme_.method);
  }
  [[nodiscard]] bool is_custom_lattice() const { return lattice_entry() == &custom_lattice_method(); }
  [[nodiscard]] const OrbitMethod& orbit_method() const { return registered(scheme_.lagrangian); }
  /// The lagrangians that have stages.
  [[nodiscard]] std::string stages_owners() const {
    std::vector<std::string_view> owners;
    for (const LatticeMethodEntry& entry : lattice_methods()) {
      if (entry.has_stages) {
        owners.push_back(entry.name);
      }
    }
    return lattice_entry() != nullptr ? fmt::format("{}", fmt::join(owners, "\" and \""))
           : is_by_L()                ? "gauss\" and \"lobatto"
                                      : "gauss";
  }
  [[nodiscard]] bool has_stages() const {
    return lattice_entry() != nullptr ? lattice_entry()->has_stages : orbit_method().has_stages;
  }
  [[nodiscard]] bool is_lobatto() const { return scheme_.lagrangian == LagrangianName::lobatto; }
  [[nodiscard]] bool has_compositions() const {
    return lattice_entry() != nullptr ? lattice_entry()->has_compositions : orbit_method().has_compositions;
  }
  [[nodiscard]] std::string family_name() const {
    return has_compositions()                             ? fmt::format("composition = \"{}\"", scheme_.composition)
           : scheme_.space_stages > 1                     ? fmt::format("space_stages = {}", scheme_.space_stages)
           : lattice_entry() != nullptr && scheme_.stages ? fmt::format("stages = {}", *scheme_.stages)
                                                          : fmt::format("lagrangian = \"{}\"", scheme_.word());
  }

  void read_generating() {
    const Entry* darboux = take_only_for("darboux", LagrangianName::generating);
    scheme_.darboux_location = scheme_.location;
    if (darboux != nullptr) {
      scheme_.darboux_location = darboux->value.location;
      if (darboux->value.array() != nullptr) {
        scheme_.darboux = DarbouxKind::matrix;
        scheme_.darboux_matrix = read_darboux_matrix(darboux->value);
      } else if (darboux->value.string() != nullptr) {
        scheme_.darboux = static_cast<DarbouxKind>(read_word(darboux->value, "darboux", darboux_words));
      } else {
        wrong_type(darboux->value, "darboux", "\"midpoint\", \"euler-a\", \"euler-b\" or a symmetric 2n×2n array");
      }
    }
  }

  void read_order() {
    const Entry* order = section_.take("order");
    if (order == nullptr) {
      if (scheme_.lagrangian == LagrangianName::generating) {
        throw ProblemError(scheme_.location, "lagrangian = \"generating\" needs an order, such as order = 4");
      }
      return;
    }
    scheme_.order_location = order->value.location;
    if (scheme_.lagrangian != LagrangianName::generating && !has_compositions()) {
      throw ProblemError(
          order->location,
          fmt::format("order applies to lagrangian = \"generating\" and \"splitting\", and this problem has "
                      "\"{}\"; {}",
                      scheme_.word(),
                      is_lobatto()   ? "write stages, half the order and one"
                      : has_stages() ? "write stages, half the order"
                                     : "leave it out"));
    }
    const std::int64_t number = read_integer(order->value, "order", parameters_, 1);
    if (scheme_.lagrangian == LagrangianName::generating && number > most_generating_order) {
      throw ProblemError(order->value.location, fmt::format("order = {}: generating functions go up to order {}",
                                                            number, most_generating_order));
    }
    scheme_.order = static_cast<int>(std::min<std::int64_t>(number, most_generating_order));
    if (has_compositions()) {
      check_composition_order(number);
    }
  }

  void check_composition_order(std::int64_t number) {
    std::vector<std::string> offered;
    bool is_offered = false;
    for (const Composition& one : compositions()) {
      offered.push_back(fmt::format("{} ({})", one.order, one.name));
      is_offered = is_offered || one.order == number;
    }
    if (!is_offered) {
      throw ProblemError(scheme_.order_location,
                         fmt::format("order = {}: there are splittings of order {}; for other orders use lagrangian = "
                                     "\"gauss\" or \"generating\"",
                                     number, fmt::join(offered, ", ")));
    }
  }

  void read_gauss() {
    const Entry* stages = take_only_for("stages", has_stages(), stages_owners());
    if (stages == nullptr) {
      if (scheme_.lagrangian == LagrangianName::gauss) {
        throw ProblemError(scheme_.location, "lagrangian = \"gauss\" needs stages, from 1 to 8, such as stages = 3");
      }
      if (is_lobatto()) {
        throw ProblemError(scheme_.location,
                           "lagrangian = \"lobatto\" needs stages, its points, from 2 to 9, such as stages = 3 for "
                           "order 4");
      }
      return;
    }
    const std::int64_t number = read_integer(stages->value, "stages", parameters_, 1);
    if (is_lobatto() && (number < 2 || number > ActionQuadrature::most_degree + 1)) {
      throw ProblemError(stages->value.location,
                         fmt::format("stages = {}: Lobatto's rule is made for 2 to {} points, of order 2*stages - 2",
                                     number, ActionQuadrature::most_degree + 1));
    }
    if (!is_lobatto() && number > GaussTableau::most_stages) {
      throw ProblemError(
          stages->value.location,
          fmt::format("stages = {}: Gauss collocation is made for 1 to {} stages", number, GaussTableau::most_stages));
    }
    scheme_.stages = static_cast<int>(number);
  }

  void read_space_stages() {
    const bool applies = lattice_entry() != nullptr && lattice_entry()->has_space_stages;
    if (const Entry* entry = take_only_for("space_stages", applies, "box"); entry != nullptr) {
      const std::int64_t number = read_integer(entry->value, "space_stages", parameters_, 1);
      scheme_.space_stages = static_cast<int>(std::min<std::int64_t>(number, std::numeric_limits<int>::max()));
      scheme_.space_stages_location = entry->value.location;
      try {
        static_cast<void>(make_lattice_method(method_choice(scheme_)));
      } catch (const std::invalid_argument& error) {
        throw ProblemError(entry->value.location, error.what());
      }
    }
  }

  void read_space() {
    const bool applies = lattice_entry() != nullptr && lattice_entry()->has_space;
    if (const Entry* entry = section_.take("space"); entry != nullptr) {
      if (!applies) {
        throw ProblemError(
            entry->location,
            fmt::format("space applies to lattices with lagrangian = \"splitting\"{}; leave it out",
                        lattice_entry() == nullptr ? ", and this problem is an orbit"
                                                   : fmt::format(", and this problem has \"{}\"", scheme_.word())));
      }
      scheme_.space = space_words[read_word(entry->value, "space", space_words)];
    }
  }

  void read_composition() {
    const Entry* name = take_only_for("composition", has_compositions(), "splitting");
    if (!has_compositions()) {
      return;
    }
    if (problem_.hamiltonian() != nullptr) {
      check_separable(*problem_.hamiltonian(), parameters_);
    }
    if (problem_.hamiltonian() != nullptr && !problem_.hamiltonian()->constraints.empty()) {
      read_constrained_composition(name);
      return;
    }
    if (name == nullptr) {
      scheme_.composition = scheme_.order ? composition_of_order(*scheme_.order).name : scheme_.composition;
      return;
    }
    scheme_.composition = composition_words()[read_word(name->value, "composition", composition_words())];
    if (problem_.hamiltonian() != nullptr) {
      check_kinetic_energy(*problem_.hamiltonian(), parameters_, composition(scheme_.composition),
                           name->value.location);
    }
    check_order_of_composition();
  }

  /// One of Verlet steps; of those the first of the order that is asked for.
  void read_constrained_composition(const Entry* name) {
    const std::vector<std::string_view> words = compositions_of_verlet_steps();
    if (name != nullptr) {
      scheme_.composition = composition_words()[read_word(name->value, "composition", composition_words())];
      if (std::ranges::find(words, scheme_.composition) == words.end()) {
        throw ProblemError(
            name->value.location,
            fmt::format("composition = \"{}\" needs exact flows of T(p), which [constraints] do not leave; "
                        "use one of Verlet steps, {}",
                        scheme_.composition, fmt::join(words, ", ")));
      }
      check_order_of_composition();
      return;
    }
    const int order = scheme_.order.value_or(2);
    const auto found = std::ranges::find(words, order, [](std::string_view word) { return composition(word).order; });
    if (found == words.end()) {
      throw ProblemError(scheme_.order_location,
                         fmt::format("order = {}: with [constraints] there are compositions of Verlet steps, {}", order,
                                     fmt::join(words, ", ")));
    }
    scheme_.composition = *found;
  }

  void check_order_of_composition() {
    if (const int order = composition(scheme_.composition).order; scheme_.order && *scheme_.order != order) {
      throw ProblemError(scheme_.order_location,
                         fmt::format("order = {}, and composition = \"{}\" is of order {}; leave one of them out",
                                     *scheme_.order, scheme_.composition, order));
    }
  }

  Matrix read_darboux_matrix(const Value& value) {
    const std::size_t size = 2 * problem_.hamiltonian()->q.size();
    const auto& rows = *value.array();
    Matrix matrix{size, {}, value.location};
    for (const Value& row : rows) {
      const auto& items = read_array(row, "darboux", "numbers");
      if (rows.size() != size || items.size() != size) {
        throw ProblemError(row.location, fmt::format("darboux: a row has {} numbers and there are {} rows; with {} "
                                                     "coordinates the matrix is {}×{}",
                                                     items.size(), rows.size(), size / 2, size, size));
      }
      for (const Value& item : items) {
        matrix.entries.push_back(read_number(item, "darboux", parameters_));
      }
    }
    if (rows.empty()) {
      throw ProblemError(value.location, fmt::format("darboux: the matrix is empty; it has to be {}×{}", size, size));
    }
    for (std::size_t i = 0; i < size; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (matrix(i, j) != matrix(j, i)) {
          throw ProblemError(value.location,
                             fmt::format("darboux is not symmetric: entry ({}, {}) is {} and ({}, {}) is {}", j + 1,
                                         i + 1, matrix(j, i), i + 1, j + 1, matrix(i, j)));
        }
      }
    }
    return matrix;
  }

  void read_custom() {
    if (scheme_.lagrangian == LagrangianName::custom && in_fictitious_time()) {
      throw ProblemError(scheme_.lagrangian_location,
                         "time_scale is not for lagrangian = \"custom\": state L in the time that it is meant in, and "
                         "leave time_scale out");
    }
    if (scheme_.lagrangian == LagrangianName::custom && is_driven()) {
      throw ProblemError(scheme_.lagrangian_location,
                         "lagrangian = \"custom\" states its own dependence on t, in t_0 and t_1, and needs H for the "
                         "first step and the reports: one that does not name t");
    }
    if (problem_.multisymplectic() != nullptr) {
      read_density();
      return;
    }
    if (const Entry* entry = take_only_for("L", LagrangianName::custom)) {
      scheme_.L = read_formula(entry->value, "L");
      check_formula(*scheme_.L, {custom_names(entry->location)}, parameters_);
    } else if (scheme_.lagrangian == LagrangianName::custom) {
      throw ProblemError(scheme_.location,
                         "lagrangian = \"custom\" needs L: a formula in t_0, t_1 and each name with "
                         "suffix _0 and _1");
    }
  }

  /// L of a lattice, a density of the corners of a cell.
  void read_density() {
    const MultisymplecticProblem& pde = *problem_.multisymplectic();
    const Entry* entry = take_only_for("L", is_custom_lattice(), custom_lattice_method().name);
    if (!is_custom_lattice()) {
      return;
    }
    const int dimensions = static_cast<int>(pde.axes.size());
    std::vector<std::string> names = corner_names(pde.fields, dimensions);
    if (entry == nullptr) {
      throw ProblemError(
          scheme_.location,
          fmt::format("lagrangian = \"custom\" needs L: a density of the values at the corners of a cell, "
                      "{}, …, {} (level, {}), and of h, dx",
                      names.front(), names[(2U << dimensions) - 1],
                      dimensions == 1   ? "node"
                      : dimensions == 2 ? "y, x"
                                        : "z, y, x"));
    }
    for (const std::string& name : names) {
      if (parameters_.find(name) != nullptr) {
        throw ProblemError(
            entry->location,
            fmt::format("the name {0} means a parameter and a value of the cell in L; rename the parameter", name));
      }
    }
    const FormulaText text = read_formula(entry->value, "L");
    scheme_.L = text;
    scheme_.lagrangian_location = text.location;
    scheme_.density = read_corner_density(text, problem_);
  }

  /// The names in a custom 𝕃, which no parameter may hide.
  std::vector<std::string> custom_names(const Location& location) const {
    std::vector<std::string> names = custom_lagrangian_names(*problem_.hamiltonian());
    for (const std::string& name : names) {
      if (parameters_.find(name) != nullptr) {
        throw ProblemError(location,
                           fmt::format("the name {0} means a parameter and a value of the step in L; rename the "
                                       "parameter",
                                       name));
      }
    }
    return names;
  }

  void read_limits() {
    if (const Entry* entry = section_.take("max_steps")) {
      scheme_.max_steps = read_integer(entry->value, "max_steps", parameters_, 1);
    }
    if (const Entry* entry = section_.take("tolerance")) {
      scheme_.tolerance = read_positive(entry->value, "tolerance");
      if (scheme_.tolerance >= 1) {
        throw ProblemError(entry->value.location,
                           fmt::format("tolerance = {} is relative, and has to be less than 1", scheme_.tolerance));
      }
    }
    if (const Entry* entry = section_.take("energy_tolerance")) {
      scheme_.energy_tolerance = read_positive(entry->value, "energy_tolerance");
      if (*scheme_.energy_tolerance >= 1) {
        throw ProblemError(entry->value.location,
                           fmt::format("energy_tolerance = {} is relative to the energy, and has to be less than 1",
                                       *scheme_.energy_tolerance));
      }
      energy_tolerance_ = entry;
    }
  }

  double read_positive(const Value& value, std::string_view what) const {
    const double number = read_number(value, what, parameters_);
    if (!(number > 0)) {
      throw ProblemError(value.location, fmt::format("{} = {} has to be positive", what, number));
    }
    return number;
  }

  void read_times() {
    const Entry& until = section_.require("until", "the time at which the run ends");
    scheme_.until = read_number(until.value, "until", parameters_);
    scheme_.until_location = until.value.location;
    const double length = scheme_.until - problem_.start();
    if (length == 0 || !std::isfinite(length)) {
      throw ProblemError(until.value.location, fmt::format("until = {} leaves nothing to run: the start is t = {}",
                                                           scheme_.until, problem_.start()));
    }
    read_step(length);
    if (energy_tolerance_ != nullptr && scheme_.step) {
      throw ProblemError(energy_tolerance_->location, "energy_tolerance applies to step = \"auto\"");
    }
    if (scheme_.step && *scheme_.step * length < 0) {
      throw ProblemError(scheme_.step_location,
                         fmt::format("step = {} does not lead from t = {} to until = {}; change its sign",
                                     *scheme_.step, problem_.start(), scheme_.until));
    }
  }

  /// When, and where in the file, [initial.next] is.
  struct SecondPoint {
    double t = 0.0;
    Location location;
  };
  [[nodiscard]] std::optional<SecondPoint> second_point() const {
    const auto of = [](const auto& next) {
      return next ? std::optional(SecondPoint{next->t, next->location}) : std::nullopt;
    };
    return problem_.hamiltonian() != nullptr ? of(problem_.hamiltonian()->next) : of(problem_.multisymplectic()->next);
  }

  void read_step(double length) {
    const std::optional<SecondPoint> next = second_point();
    if (next && (problem_.hamiltonian() != nullptr ? orbit_method().is_map() : !is_custom_lattice())) {
      throw ProblemError(
          next->location,
          fmt::format("[initial.next] begins a two-step form, and lagrangian = \"{}\" is a one-step map; "
                      "leave the table out",
                      scheme_.word()));
    }
    const Entry* entry =
        next ? section_.take("step") : &section_.require("step", "the first step, t_1 - t_0, such as step = 0.1");
    scheme_.step_location = entry == nullptr ? next->location : entry->value.location;
    if (entry != nullptr && entry->value.string() != nullptr && *entry->value.string() == "auto") {
      if (in_fictitious_time()) {
        throw ProblemError(entry->value.location,
                           "step = \"auto\" goes by the energy, which is 0 with time_scale; give the first step as a "
                           "number, such as a fiftieth of an oscillation in units of the time scale");
      }
      if (next) {
        throw ProblemError(entry->value.location,
                           "step = \"auto\" and [initial.next] both fix the first step; give one");
      }
      if (!scheme_.energy_tolerance) {
        throw ProblemError(entry->value.location,
                           "step = \"auto\" needs energy_tolerance, such as "
                           "energy_tolerance = 1e-6");
      }
      return;
    }
    if (entry != nullptr) {
      scheme_.step = read_number(entry->value, "step", parameters_);
    }
    if (next) {
      check_against_next(*next);
    }
    if (*scheme_.step == 0) {
      throw ProblemError(scheme_.step_location,
                         fmt::format("step = 0 leads nowhere; it has to be {}", length > 0 ? "positive" : "negative"));
    }
    // Where an integrator takes a level for the end of the run.
    constexpr double slack = 1e-9;
    if (std::abs(length) <= slack * std::abs(*scheme_.step)) {
      throw ProblemError(scheme_.step_location,
                         fmt::format("step = {} is so long beside the run, from t = {} to until = {}, that its start "
                                     "counts as its end; take a smaller step",
                                     *scheme_.step, problem_.start(), scheme_.until));
    }
    const double start = problem_.start();
    if (start + *scheme_.step == start) {
      throw ProblemError(scheme_.step_location,
                         fmt::format("step = {} is lost in rounding beside the start t = {}", *scheme_.step, start));
    }
  }

  /// The starting pair sets the first step; a step that says otherwise contradicts it.
  void check_against_next(const SecondPoint& next) {
    const double between = next.t - problem_.start();
    constexpr double rounding = 1e-9;
    if (scheme_.step && std::abs(*scheme_.step - between) > rounding * std::abs(between)) {
      throw ProblemError(scheme_.step_location, fmt::format("step = {}, but [initial.next] is at t = {}, {} after the "
                                                            "start; leave step out",
                                                            *scheme_.step, next.t, between));
    }
    scheme_.step = between;
    scheme_.step_location = next.location;
  }

  void check_lattice(const MultisymplecticProblem& pde) const {
    auto method = make_lattice_method(method_choice(scheme_));
    if (pde.has_walls()) {
      at_location(scheme_.lagrangian_location,
                  [&] { method = make_lattice_method(method_choice(scheme_), make_grid(problem_)); });
    }
    if (const std::string_view reason = method->fixed_levels_only();
        !reason.empty() && scheme_.levels == Levels::variable) {
      throw ProblemError(
          scheme_.levels_location,
          fmt::format("lagrangian = \"{}\" runs with levels = \"fixed\" only: {}", scheme_.method, reason));
    }
    if (const std::string_view reason = method->other_dimensions(static_cast<int>(pde.axes.size())); !reason.empty()) {
      throw ProblemError(scheme_.space_stages_location,
                         fmt::format("space_stages = {}: {}", scheme_.space_stages, reason));
    }
    if (pde.has_drives() && scheme_.levels == Levels::variable) {
      throw ProblemError(scheme_.levels_location,
                         "walls of [grid] drive fields, and the work that they do reads both steps at a level: write "
                         "levels = \"fixed\"");
    }
    for (const GridAxis& axis : pde.axes) {
      if (const auto other =
              method->other_count(static_cast<std::size_t>(axis.cells), static_cast<int>(pde.axes.size()))) {
        throw ProblemError(
            axis.location,
            fmt::format(
                "grid.{}: {} cells; lagrangian = \"{}\" needs {}, because {}. Write cells = {}, or lagrangian = "
                "\"fourier\", which takes any number",
                axis.name, axis.cells, scheme_.method,
                scheme_.space_stages > 1 ? fmt::format("an odd multiple of space_stages = {}", scheme_.space_stages)
                                         : "an odd number in every direction",
                other->reason, other->cells));
      }
    }
  }

  Section section_;
  const Problem& problem_;
  const Parameters& parameters_;
  const Entry* energy_tolerance_ = nullptr;
  Scheme scheme_;
};

}  // namespace

std::string_view to_string(LagrangianName lagrangian) {
  return registered(lagrangian).name;
}
std::string_view Scheme::word() const {
  return method.empty() ? to_string(lagrangian) : method;
}
LatticeMethodChoice method_choice(const Scheme& scheme) {
  return {.name = scheme.method,
          .stages = scheme.stages.value_or(1),
          .composition = scheme.composition,
          .space = scheme.space,
          .space_stages = scheme.space_stages,
          .density = scheme.density};
}
std::string_view to_string(Levels levels) {
  return levels_words[static_cast<std::size_t>(levels)];
}
std::string_view to_string(OnSingular on_singular) {
  return on_singular_words[static_cast<std::size_t>(on_singular)];
}

Scheme read_scheme(Section& root, const Problem& problem) {
  auto section = root.take_section("scheme");
  if (!section) {
    throw ProblemError(root.location(), "there is no [scheme]: give at least step and until");
  }
  return SchemeReader(std::move(*section), problem).read();
}

}  // namespace rubato
