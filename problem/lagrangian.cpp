#include <algorithm>
#include <array>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/ode/lagrangian.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {
namespace {

constexpr std::string_view dot = "_dot", momentum = "p_";

/// The velocities of coordinates, vectors as vectors: r[2] has r_dot[2], which is r1_dot and r2_dot.
NameList velocities_of(const NameList& q) {
  NameList list = q;
  for (NameList::Group& group : list.groups) {
    group.base += dot;
  }
  for (std::string& name : list.names) {
    name += dot;
  }
  return list;
}

NameList momenta_of(const NameList& q) {
  NameList list = q;
  for (NameList::Group& group : list.groups) {
    group.base = fmt::format("{}{}", momentum, group.base);
  }
  for (std::string& name : list.names) {
    name = fmt::format("{}{}", momentum, name);
  }
  return list;
}

void declare(const NameList& list, std::string_view role, const Location& location, Names& taken) {
  for (const NameList::Group& group : list.groups) {
    if (group.is_vector) {
      taken.declare(group.base, "a vector", location);
    }
  }
  for (const std::string& name : list.names) {
    taken.declare(name, role, location);
  }
}

/// What people write who think of [hamiltonian].
void refuse_strangers(const Section& root, const Section& section) {
  for (const auto& [key, reason] :
       {std::pair("p", "momenta follow from L, p_q = dL/dq_dot; leave p out"),
        std::pair("q_dot", "velocities are called as the coordinates with _dot; leave q_dot out"),
        std::pair("H", "the problem is stated by L; leave H out, or state it in [hamiltonian]"),
        std::pair("time_scale", "time_scale is for problems stated by H ([hamiltonian]); leave it out")}) {
    if (const Entry* entry = find(section.entries(), key)) {
      throw ProblemError(entry->location, reason);
    }
  }
  const Entry* scheme = find(root.entries(), "scheme");
  if (const auto* table = scheme != nullptr ? scheme->value.table() : nullptr) {
    if (const Entry* entry = find(*table, "time_scale")) {
      throw ProblemError(entry->location, "time_scale is for problems stated by H ([hamiltonian]); leave it out");
    }
  }
}

PhasePoint read_start(Section& section, const NameList& q, const NameList& q_dot, const NameList& p,
                      const Parameters& parameters) {
  PhasePoint point;
  point.location = section.location();
  if (const Entry* next = find(section.entries(), "next")) {
    throw ProblemError(next->location,
                       "[initial.next] begins a two-step form, and a problem stated by L is solved by one-step maps; "
                       "leave the table out");
  }
  const Entry* time = section.take("t");
  point.t = time == nullptr ? 0.0 : read_number(time->value, "t", parameters);
  const Parameters at_time = with_time(parameters, point.t, point.location);
  std::vector<std::string> missing;
  take_numbers(section, q, at_time, point.q, missing);
  take_numbers(section, q_dot, at_time, point.q_dot, missing);
  for (const Entry& entry : section.entries()) {
    const bool names_momentum =
        entry.key == "p" || std::ranges::find(p.names, entry.key) != p.names.end() ||
        std::ranges::any_of(p.groups, [&](const NameList::Group& group) { return group.base == entry.key; });
    if (names_momentum) {
      throw ProblemError(entry.location,
                         fmt::format("{}: a problem stated by L starts from coordinates and velocities, and momenta "
                                     "follow; give {}",
                                     entry.key, fmt::join(q_dot.names, ", ")));
    }
  }
  section.finish();  // before what is missing, so that a misspelt name is called that
  if (!missing.empty()) {
    throw ProblemError(point.location, fmt::format("{} gives no value for {}; every coordinate and velocity needs one",
                                                   section.name(), fmt::join(missing, ", ")));
  }
  return point;
}

}  // namespace

void read_lagrangian(Section& root, Section& section, Problem& problem) {
  refuse_strangers(root, section);
  Names taken;
  taken.know_sizes(root);
  taken.reserve("t", "it is the time");
  const Value& coordinates =
      section.require("q", "the names of the coordinates, such as q = [\"q\"]; velocities are q_dot").value;
  const NameList q = read_names(coordinates, "q", "a coordinate", taken);
  const NameList q_dot = velocities_of(q), p = momenta_of(q);
  declare(q_dot, "a velocity", coordinates.location, taken);
  declare(p, "a momentum", coordinates.location, taken);
  problem.parameters = read_parameters(root, taken);
  auto& parameters = problem.parameters;

  HamiltonianProblem orbit;
  orbit.q = q.names;
  orbit.q_dot = q_dot.names;
  orbit.p = p.names;
  const std::vector<std::string> names = orbit.formula_names();
  std::vector<std::string> definable = names;
  definable.emplace_back("t");
  add_definitions(root, taken, {definable}, parameters);
  orbit.L = read_formula(section.require("L", "the Lagrangian, such as L = \"q_dot^2/2 + cos(q)\"").value, "L");
  check_formula(*orbit.L, {orbit.lagrangian_names()}, parameters);
  section.finish();

  auto initial = root.take_section("initial");
  if (!initial) {
    throw ProblemError(section.location(), "there is no [initial]: give a value for every coordinate and velocity");
  }
  orbit.initial = read_start(*initial, q, q_dot, p, parameters);
  orbit.invariants = read_invariants(root, {names}, parameters);
  static const std::vector<std::string> time = {"t"};
  orbit.exact = read_exact(root, std::array{q, q_dot, p}, time, parameters);
  read_orbit_symmetries(root, orbit, parameters);
  read_constraints(root, orbit, parameters);
  if (const Entry* entry = root.take("grid")) {
    throw ProblemError(entry->location, "[grid] belongs to a [multisymplectic] problem");
  }
  problem.system = std::move(orbit);
  auto& read = std::get<HamiltonianProblem>(problem.system);
  try {
    read.initial.p = momenta(make_lagrangian(problem), read.initial.q, read.initial.q_dot);
  } catch (const SingularLagrangianError& error) {
    throw ProblemError(read.L->location, error.what());
  } catch (const std::invalid_argument& error) {
    throw ProblemError(read.initial.location, error.what());
  }
}

}  // namespace rubato
