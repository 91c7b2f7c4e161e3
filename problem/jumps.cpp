#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// A term of a formula that is not the same at z and z + J, with the values that it has there.
struct BrokenTerm {
  std::string term;
  double before = 0.0, after = 0.0;
};

/// Looks for one at random points; nothing where the formula is the same. `shifted` are the variables that are moved,
/// each by its number in `by`.
std::optional<BrokenTerm> find_broken_term(const formula::Graph& graph, formula::Expression formula,
                                           const std::vector<std::string>& shifted, const std::vector<double>& by) {
  std::vector<formula::Expression> terms = formula::terms_of(formula, formula::Products::expanded);
  terms.push_back(formula);
  const std::vector<std::size_t> numbers = formula::variables_of(formula);
  std::vector<formula::Expression> variables;
  std::vector<double> shift;
  for (const std::size_t number : numbers) {
    const std::string& name = graph.variable_name(number);
    variables.push_back(formula.graph()->variable(name));
    const auto at = std::ranges::find(shifted, name);
    shift.push_back(at == shifted.end() ? 0.0 : by[static_cast<std::size_t>(at - shifted.begin())]);
  }
  formula::ScalarEvaluator evaluate(formula::Bytecode(terms, variables));
  std::mt19937_64 random(20);
  std::uniform_real_distribution<double> value(0.1, 1.4);
  std::vector<double> point(variables.size()), moved(point), before(terms.size()), after(terms.size());
  constexpr int points = 10;
  // A difference of rounding: that of the argument, J, times the slope.
  constexpr double same = 1e-11;
  for (int attempt = 0; attempt < points; ++attempt) {
    for (std::size_t i = 0; i < point.size(); ++i) {
      point[i] = value(random);
      moved[i] = point[i] + shift[i];
    }
    evaluate(point, before);
    evaluate(moved, after);
    double size = 0.0, most = 0.0;
    std::size_t worst = 0;
    for (std::size_t t = 0; t + 1 < terms.size(); ++t) {
      size = std::max({size, std::abs(before[t]), std::abs(after[t])});
      if (const double change = std::abs(after[t] - before[t]); change > most) {
        most = change;
        worst = t;
      }
    }
    if (std::abs(after.back() - before.back()) > same * (1.0 + size)) {
      return BrokenTerm{formula::to_string(terms[worst]), before[worst], after[worst]};
    }
  }
  return std::nullopt;
}

std::string in_words(const StatedJump& jump) {
  return fmt::format("{0} -> {0} {1} {2:.6g}", jump.field, jump.value < 0.0 ? "-" : "+", std::abs(jump.value));
}

/// Why a field cannot jump; empty where it can.
std::string reason_against(const MultisymplecticSystem& system, int field) {
  const std::string& name = system.fields()[static_cast<std::size_t>(field)];
  const FieldStructure& structure = system.structure();
  if (structure.potential[static_cast<std::size_t>(field)]) {
    return fmt::format(
        "S does not name {0}: its mean slope follows from the initial data without a jump. Leave the "
        "jump of {0} out",
        name);
  }
  if (structure.algebraic[static_cast<std::size_t>(field)]) {
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
    const auto refuse = [&](const BrokenTerm& broken, const Location& location, std::string_view what) {
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
    if (const auto broken = find_broken_term(*system.graph(), system.expression(), fields, by)) {
      refuse(*broken, axis.jumps.front().location, "S");
    }
    for (const NamedFormula& invariant : pde.invariants) {
      formula::Graph graph;
      const formula::Expression density = problem.build(invariant.formula, graph, quantity_names(pde), pde.fields);
      if (const auto broken = find_broken_term(graph, density, fields, by)) {
        refuse(*broken, invariant.formula.location, "the density of an invariant");
      }
    }
  }
}

void check_density_jumps(const MultisymplecticProblem& pde, const FormulaText& text, const CornerDensity& density) {
  for (const GridAxis& axis : pde.axes) {
    std::vector<std::string> names;
    std::vector<double> by;
    for (const StatedJump& jump : axis.jumps) {
      for (int corner = 0; corner < density.corner_count(); ++corner) {
        names.push_back(jump.field + "_" + corner_suffix(corner, density.dimensions));
        by.push_back(jump.value);
      }
    }
    if (names.empty()) {
      continue;
    }
    if (const auto broken = find_broken_term(*density.graph, density.L, names, by)) {
      throw ProblemError(text.location,
                         fmt::format("L has to be the same on both sides of the seam, and {} changes its term {} (from "
                                     "{:.6g} to {:.6g} at some values). Write it with differences of {}, or leave jump "
                                     "out",
                                     in_words(axis.jumps.front()), broken->term, broken->before, broken->after,
                                     axis.jumps.front().field));
    }
  }
}

Jumps make_jumps(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.has_jumps()) {
    return {};
  }
  std::vector<grids::Axis> axes;
  std::vector<Eigen::VectorXd> jumps;
  for (const GridAxis& axis : pde.axes) {
    axes.push_back({axis.name, axis.from, axis.to, static_cast<std::size_t>(axis.cells)});
    jumps.emplace_back(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(pde.fields.size())));
    for (const StatedJump& jump : axis.jumps) {
      jumps.back()(std::ranges::find(pde.fields, jump.field) - pde.fields.begin()) = jump.value;
    }
  }
  return {make_laboratory_system(problem), axes, jumps};
}

}  // namespace rubato
