#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/problem/broken_term.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

std::string in_words(const StatedJump& jump) {
  return fmt::format("{0} -> {0} {1} {2:.6g}", jump.field, jump.value < 0.0 ? "-" : "+", std::abs(jump.value));
}

/// Why a field cannot jump; empty where it can.
std::string reason_against(const MultisymplecticSystem& system, int field) {
  const std::string& name = system.fields()[static_cast<std::size_t>(field)];
  if (follows_from_others(system, field)) {
    return fmt::format(
        "S does not name {0}: its mean slope follows from the initial data without a jump. Leave the "
        "jump of {0} out",
        name);
  }
  if (system.structure().algebraic[static_cast<std::size_t>(field)]) {
    return fmt::format("{} has no equation of motion and follows from other fields: state the jump of those", name);
  }
  return "";
}

}  // namespace

std::vector<StatedJump> read_jumps(Section& axis, std::span<const std::string> fields, const Parameters& parameters) {
  std::vector<StatedJump> jumps;
  const auto section = axis.take_section("jump");
  if (!section) {
    return jumps;
  }
  for (const Entry& entry : section->entries()) {
    if (std::ranges::find(fields, entry.key) == fields.end()) {
      const auto nearest = formula::nearest_name(entry.key, {fields.begin(), fields.end()});
      throw ProblemError(entry.location,
                         fmt::format("jump: {} is not a field; {}", entry.key,
                                     nearest ? fmt::format("did you mean {}?", *nearest)
                                             : fmt::format("the fields are {}", fmt::join(fields, ", "))));
    }
    jumps.push_back({entry.key, read_number(entry.value, entry.key, parameters), entry.location});
  }
  if (jumps.empty()) {
    throw ProblemError(section->location(), "jump names no field: write jump = { u = \"2*pi\" }, or leave it out");
  }
  return jumps;
}

void check_jumps(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.has_jumps()) {
    return;
  }
  const MultisymplecticSystem system = make_laboratory_system(problem);
  for (const GridAxis& axis : pde.axes) {
    for (const StatedJump& jump : axis.jumps) {
      if (const std::string reason = reason_against(system, system.field(jump.field)); !reason.empty()) {
        throw ProblemError(jump.location, fmt::format("{} cannot jump: {}", jump.field, reason));
      }
    }
    const auto refuse = [&](const formula::ChangedTerm& broken, const Location& location, std::string_view what) {
      std::vector<std::string> moves;
      std::ranges::transform(axis.jumps, std::back_inserter(moves), in_words);
      throw ProblemError(location,
                         fmt::format("{} has to be the same on both sides of the seam, and {} changes its term {} "
                                     "(from {:.6g} to {:.6g} at some z). Give a jump that leaves it as it is, or leave "
                                     "jump out and take a grid on which the fields repeat",
                                     what, fmt::join(moves, ", "), broken.term, broken.before, broken.after));
    };
    std::vector<std::string> fields;
    std::vector<double> by;
    for (const StatedJump& jump : axis.jumps) {
      fields.push_back(jump.field);
      by.push_back(jump.value);
    }
    if (axis.jumps.empty()) {
      continue;
    }
    const ImageOfVariable image = [&](const std::string& name, const ValueOfVariable& value) {
      const auto at = std::ranges::find(fields, name);
      return value(name) + (at == fields.end() ? 0.0 : by[static_cast<std::size_t>(at - fields.begin())]);
    };
    if (const auto broken = find_broken_term(system.expression(), image)) {
      refuse(*broken, axis.jumps.front().location, "S");
    }
    for (const NamedFormula& invariant : pde.invariants) {
      formula::Graph graph;
      const formula::Expression density = problem.build(invariant.formula, graph, quantity_names(pde), pde.fields);
      if (const auto broken = find_broken_term(density, image)) {
        refuse(*broken, invariant.formula.location, "the density of an invariant");
      }
    }
  }
}

void check_density_jumps(const MultisymplecticProblem& pde, const FormulaText& text, const CornerDensity& density) {
  for (const GridAxis& axis : pde.axes) {
    if (axis.jumps.empty()) {
      continue;
    }
    std::map<std::string, double> by;
    for (const StatedJump& jump : axis.jumps) {
      for (int corner = 0; corner < density.corner_count(); ++corner) {
        by[jump.field + "_" + corner_suffix(corner, density.dimensions)] = jump.value;
      }
    }
    const ImageOfVariable image = [&](const std::string& name, const ValueOfVariable& value) {
      return value(name) + (by.contains(name) ? by.at(name) : 0.0);
    };
    if (const auto broken = find_broken_term(density.L, image)) {
      throw ProblemError(text.location,
                         fmt::format("L has to be the same on both sides of the seam, and {} changes its term {} (from "
                                     "{:.6g} to {:.6g} at some values). Write it with differences of {}, or leave jump "
                                     "out",
                                     in_words(axis.jumps.front()), broken->term, broken->before, broken->after,
                                     axis.jumps.front().field));
    }
  }
}

std::vector<Eigen::VectorXd> jumps_of(const MultisymplecticProblem& pde) {
  std::vector<Eigen::VectorXd> jumps;
  for (const GridAxis& axis : pde.axes) {
    if (!pde.has_jumps()) {
      break;
    }
    jumps.emplace_back(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(pde.fields.size())));
    for (const StatedJump& jump : axis.jumps) {
      jumps.back()(std::ranges::find(pde.fields, jump.field) - pde.fields.begin()) = jump.value;
    }
  }
  return jumps;
}

Jumps make_jumps(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.has_jumps() && !pde.has_twists()) {
    return {};
  }
  std::vector<grids::Axis> axes;
  for (const GridAxis& axis : pde.axes) {
    axes.push_back({axis.name, axis.from, axis.to, static_cast<std::size_t>(axis.cells)});
  }
  return {make_system_of_fields(problem), axes, jumps_of(pde), make_twists(problem)};
}

}  // namespace rubato
