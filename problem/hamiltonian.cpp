#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/statistics.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {
namespace {

/// Every coordinate and momentum, and the time, from a table such as [initial].
PhasePoint read_point(Section& section, const NameList& q, const NameList& p, double default_time,
                      const Parameters& parameters) {
  PhasePoint point;
  point.location = section.location();
  const Entry* time = section.take("t");
  point.t = time == nullptr ? default_time : read_number(time->value, "t", parameters);

  const Parameters at_time = with_time(parameters, point.t, point.location);
  std::vector<std::string> missing;
  take_numbers(section, q, at_time, point.q, missing);
  take_numbers(section, p, at_time, point.p, missing);
  section.finish();  // before what is missing, so that a misspelt name is called that
  if (!missing.empty()) {
    throw ProblemError(point.location, fmt::format("{} gives no value for {}; every coordinate and momentum needs one",
                                                   section.name(), fmt::join(missing, ", ")));
  }
  return point;
}

/// What an extended phase space adds: a coordinate, the time, and its momentum: -E with time_scale; for a driven system
/// minus the work done on it, so that H + minus_work is the energy of the start.
constexpr std::string_view clock = clock_name, clock_energy = "minus_energy", clock_work = work_name;

/// The invariant that H itself is with time_scale, where the energy of the levels is that of g (H - E).
constexpr std::string_view physical_energy = "energy";

/// At a point and its time; `names` are those of q and p, and then t.
double value_at(const PhasePoint& point, const FormulaText& formula, std::span<const std::string> names,
                const Parameters& parameters) {
  formula::Graph graph;
  const std::array outputs = {build_formula(formula, graph, {names}, parameters)};
  std::vector<formula::Expression> inputs;
  for (const std::string& name : names) {
    inputs.push_back(graph.variable(name));
  }
  formula::ScalarEvaluator evaluator{formula::Bytecode(outputs, inputs)};
  *std::ranges::copy(point.p, std::ranges::copy(point.q, evaluator.inputs().begin()).out).out = point.t;
  evaluator.run();
  return evaluator.output(0);
}

/// One more pair: the time, and its momentum with the value `w` at the start. In formulas, t stands for the time.
void add_clock(HamiltonianProblem& ode, std::string_view momentum, double w, Parameters& parameters) {
  ode.q.emplace_back(clock);
  ode.p.emplace_back(momentum);
  ode.initial.q.push_back(ode.initial.t);
  ode.initial.p.push_back(w);
  parameters.push_back({.name = "t", .location = ode.H.location, .definition = FormulaText{std::string(clock), {}}});
}

/// A driven system, H(q, p, t), in its extended phase space: H(q, p, time) + w, time' = 1, w' = -∂H/∂t. What it
/// conserves in a step is the balance (3.4) of the driven one.
void extend(HamiltonianProblem& ode, Parameters& parameters) {
  ode.H.text = fmt::format("({}) + {}", ode.H.text, clock_work);
  add_clock(ode, clock_work, 0.0, parameters);
}

/// The problem in fictitious time s, dt = g ds (theory, section 9): g(q, p)·(H(q, p) + w) of the coordinates q, time
/// and the momenta p, w, where w = -H(z_0) is -E, a constant.
void take_fictitious_time(HamiltonianProblem& ode, const FormulaText& g, Parameters& parameters) {
  std::vector<std::string> names = ode.names();
  names.emplace_back("t");
  const double scale = value_at(ode.initial, g, names, parameters);
  if (!(scale > 0.0) || !std::isfinite(scale)) {
    throw ProblemError(g.location, fmt::format("time_scale is {} at the start; it has to be positive along the whole "
                                               "orbit",
                                               scale));
  }
  const double energy = value_at(ode.initial, ode.H, names, parameters);
  if (!std::isfinite(energy)) {
    throw ProblemError(ode.initial.location, fmt::format("H is {} at the start", energy));
  }
  // As a sum: the tolerance of the energy law goes by the size of its terms, and the sum itself is 0.
  ode.H.text = fmt::format("({0})*({1}) + ({0})*{2}", g.text, ode.H.text, clock_energy);
  add_clock(ode, clock_energy, -energy, parameters);
  ode.initial.t = 0.0;
  ode.fictitious_time = true;
}

/// time_scale of [hamiltonian], or of [scheme], where it means the same.
const Entry* take_time_scale(const Section& root, Section& section) {
  const Entry* own = section.take("time_scale");
  const Entry* scheme = find(root.entries(), "scheme");
  const Value::Table* table = scheme != nullptr ? scheme->value.table() : nullptr;
  const Entry* other = table != nullptr ? find(*table, "time_scale") : nullptr;
  if (own != nullptr && other != nullptr) {
    throw ProblemError(other->location, "time_scale is given twice, here and in [hamiltonian]; write one of them");
  }
  return own != nullptr ? own : other;
}

}  // namespace

std::vector<std::string> HamiltonianProblem::names() const {
  std::vector<std::string> all = q;
  all.insert(all.end(), p.begin(), p.end());
  return all;
}

std::vector<std::string> HamiltonianProblem::lagrangian_names() const {
  std::vector<std::string> all = q;
  all.insert(all.end(), q_dot.begin(), q_dot.end());
  return all;
}

std::vector<std::string> HamiltonianProblem::formula_names() const {
  std::vector<std::string> all = lagrangian_names();
  all.insert(all.end(), p.begin(), p.end());
  return all;
}

void read_hamiltonian(Section& root, Section& section, Problem& problem) {
  Names taken;
  taken.know_sizes(root);
  taken.reserve("t", "it is the time");
  for (const std::string_view key : {"structure", "poisson"}) {
    if (const Entry* structure = find(section.entries(), key)) {
      throw ProblemError(
          structure->location,
          fmt::format("{}: an orbit is in canonical coordinates, q' = dH/dp and p' = -dH/dq. State a "
                      "system with another Poisson bracket in its Darboux coordinates: a rigid body with "
                      "angular momentum of length G by l and L, m = (sqrt(G^2 - L^2)*sin(l), "
                      "sqrt(G^2 - L^2)*cos(l), L)",
                      key));
    }
  }
  const Entry* time_scale = take_time_scale(root, section);
  if (time_scale != nullptr) {
    for (const std::string_view name : {clock, clock_energy}) {
      taken.reserve(name, "time_scale makes a coordinate time and a momentum minus_energy");
    }
  }
  const NameList q = read_names(section.require("q", "the names of the coordinates, such as q = [\"q\"]").value, "q",
                                "a coordinate", taken);
  const Value& momenta = section.require("p", "the names of the momenta, such as p = [\"p\"]").value;
  const NameList p = read_names(momenta, "p", "a momentum", taken);
  if (q.names.size() != p.names.size()) {
    throw ProblemError(momenta.location,
                       fmt::format("q has {} names ({}) and p has {} ({}): every coordinate needs its momentum",
                                   q.names.size(), fmt::join(q.names, ", "), p.names.size(), fmt::join(p.names, ", ")));
  }
  problem.parameters = read_parameters(root, taken);
  auto& parameters = problem.parameters;

  HamiltonianProblem ode;
  ode.q = q.names;
  ode.p = p.names;
  std::vector<std::string> names = ode.names();
  names.emplace_back("t");
  std::vector<std::string> definable = names;
  std::ranges::copy(custom_lagrangian_names(ode), std::back_inserter(definable));
  add_definitions(root, taken, {definable}, parameters);
  ode.H = read_formula(section.require("H", "the Hamiltonian, such as H = \"p^2/2 - cos(q)\"").value, "H");
  ode.driven = names_time(ode.H, {names}, parameters);
  std::optional<FormulaText> g;
  if (time_scale != nullptr) {
    g = read_formula(time_scale->value, "time_scale");
    check_formula(*g, {names}, parameters);
  }
  const FormulaText H = ode.H;
  section.finish();
  if (ode.driven && !g) {
    for (const std::string_view name : {clock, clock_work}) {
      taken.declare(name, "one of the pair that an H of t adds, time and minus_work", ode.H.location);
    }
  }

  auto initial = root.take_section("initial");
  if (!initial) {
    throw ProblemError(section.location(), "there is no [initial]: give a value for every coordinate and momentum");
  }
  const Entry* next = find(initial->entries(), "next");
  std::optional<Section> next_section;
  if (next != nullptr && next->value.table() != nullptr) {
    next_section = initial->take_section("next");
  }
  ode.initial = read_point(*initial, q, p, 0.0, parameters);
  if (next_section) {
    if (find(next_section->entries(), "t") == nullptr) {
      throw ProblemError(next_section->location(), "[initial.next] needs t: the time of the second level");
    }
    ode.next = read_point(*next_section, q, p, 0.0, parameters);
  }
  if (ode.driven && ode.next) {
    throw ProblemError(ode.next->location,
                       "H names t, and the work done until the second level is not known; leave "
                       "[initial.next] out");
  }
  if (g) {
    for (const auto& [entry, remedy] : {std::pair(find(root.entries(), "exact"), "it is a function of the time"),
                                        std::pair(next, "its step is one of the time")}) {
      if (entry != nullptr) {
        throw ProblemError(entry->location, fmt::format("with time_scale, t is the fictitious time, and {} means "
                                                        "nothing: {}; leave it out",
                                                        entry->key, remedy));
      }
    }
    take_fictitious_time(ode, *g, parameters);
  } else if (ode.driven) {
    extend(ode, parameters);
  }
  const auto all_names = ode.names();
  ode.invariants = read_invariants(root, {all_names}, parameters);
  const bool is_taken = std::ranges::find(ode.invariants, physical_energy, &NamedFormula::name) != ode.invariants.end();
  if (g && !is_taken) {
    ode.invariants.insert(ode.invariants.begin(), {std::string(physical_energy), H});
  }
  static const std::vector<std::string> time = {"t"};
  ode.exact = read_exact(root, std::array{q, p}, time, parameters);
  read_orbit_symmetries(root, ode, parameters);
  read_constraints(root, ode, parameters);
  if (const Entry* entry = root.take("grid")) {
    throw ProblemError(entry->location, "[grid] belongs to a [multisymplectic] problem");
  }
  problem.system = std::move(ode);
}

}  // namespace rubato
