#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/pde/initial_level.hpp>
#include <rubato/problem/broken_term.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

[[noreturn]] void refuse_real_field(const StatedTwist& twist, const GridAxis& axis) {
  const bool changes_sign = std::abs(std::remainder(twist.angle - std::numbers::pi, 2.0 * std::numbers::pi)) < 1e-12;
  throw ProblemError(
      twist.location,
      changes_sign
          ? fmt::format("phase: {0} is a real field, and no angle leads from {0} to -{0}. Take twice the ring, from = "
                        "{1:.6g}, to = {2:.6g}, with twice the cells and data with {0}({3} + {4:.6g}) = -{0}({3}), "
                        "which stay so",
                        twist.name, axis.from, 2.0 * axis.to - axis.from, axis.name, axis.to - axis.from)
          : fmt::format(
                "phase: {0} is a real field, which cannot turn by {1:.6g}. Name a complex unknown of [field], or "
                "an entry of [symmetries] that turns {0} with another field",
                twist.name, twist.angle));
}

Eigen::MatrixXd generator_of(const StatedTwist& twist, const MultisymplecticProblem& pde) {
  return dense(std::ranges::find(pde.symmetries, twist.symmetry, &StatedSymmetry::name)->B);
}

bool commute(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
  const Eigen::MatrixXd AB = A.lazyProduct(B), BA = B.lazyProduct(A);
  return (AB - BA).cwiseAbs().maxCoeff() <= 1e-12 * AB.cwiseAbs().maxCoeff();
}

/// Finds the symmetry, and takes the angle between -π and π where a whole turn is none.
void resolve_twist(StatedTwist& twist, const GridAxis& axis, const MultisymplecticSystem& system,
                   const MultisymplecticProblem& pde) {
  const bool is_symmetry = std::ranges::find(pde.symmetries, twist.name, &StatedSymmetry::name) != pde.symmetries.end();
  if (!is_symmetry && std::ranges::find(pde.fields, twist.name) != pde.fields.end()) {
    refuse_real_field(twist, axis);
  }
  twist.symmetry = symmetry_of_phase({twist.name, twist.location, {}}, pde);
  const Eigen::MatrixXd B = generator_of(twist, pde);
  at_location(twist.location, [&] { check_symmetry(system, {twist.symmetry, B}); });
  for (int f = 0; f < system.field_count(); ++f) {
    if (mixed_fields({B}, f).size() > 1 && follows_from_others(system, f)) {
      throw ProblemError(twist.location, fmt::format("phase: {} turns {}, a potential that S does not name, whose mean "
                                                     "slope follows from the initial data. Leave phase out",
                                                     twist.name, pde.fields[static_cast<std::size_t>(f)]));
    }
  }
  const auto frequencies = at_location(twist.location, [&] { return Rotation(B).frequencies(); });
  const auto is_integer = [](double frequency) { return std::abs(frequency - std::round(frequency)) < 1e-9; };
  if (std::ranges::all_of(frequencies, is_integer)) {
    twist.angle = std::remainder(twist.angle, 2.0 * std::numbers::pi);
  }
}

/// z behind the seam of an axis, z before it turned: of fields, their derivatives and the corners of a cell.
class ImageBehindSeam {
public:
  ImageBehindSeam(const Problem& problem, std::size_t axis)
      : fields_(problem.multisymplectic()->fields), turn_(turn_at(problem, axis)) {}

  double operator()(const std::string& name, const ValueOfVariable& before) const {
    std::size_t depth = 0;  // of dx(dy(f))
    while (name.compare(3 * depth, 1, "d") == 0 && name.compare(3 * depth + 2, 1, "(") == 0) {
      ++depth;
    }
    const std::string inner = name.substr(3 * depth, name.size() - 4 * depth);
    for (std::size_t f = 0; f < fields_.size(); ++f) {
      const std::string rest = inner.starts_with(fields_[f]) ? inner.substr(fields_[f].size()) : "no";
      const bool is_corner = rest.starts_with("_") && rest.find_first_not_of("01", 1) == std::string::npos;
      if (!rest.empty() && !is_corner) {
        continue;
      }
      const std::string prefix = name.substr(0, 3 * depth), suffix = rest + std::string(depth, ')');
      double sum = 0.0;
      for (std::size_t g = 0; g < fields_.size(); ++g) {
        const double entry = turn_(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(g));
        sum += entry == 0.0 ? 0.0 : entry * before(prefix + fields_[g] + suffix);
      }
      return sum;
    }
    return before(name);
  }

private:
  static Eigen::MatrixXd turn_at(const Problem& problem, std::size_t axis) {
    std::vector<double> distances(problem.multisymplectic()->axes.size(), 0.0);
    const GridAxis& along = problem.multisymplectic()->axes[axis];
    distances[axis] = along.to - along.from;
    return make_twists(problem).turn(distances);
  }

  const std::vector<std::string>& fields_;
  Eigen::MatrixXd turn_;
};

void refuse_broken(const formula::ChangedTerm& broken, const GridAxis& axis, std::string_view what,
                   const Location& location) {
  throw ProblemError(
      location,
      fmt::format("{} has to be the same on both sides of the seam, and the turn by {} = {:.6g} "
                  "changes its term {} (from {:.6g} to {:.6g} at some z). Take one that does not "
                  "change, such as of abs2(psi), or leave phase out",
                  what, axis.twists.front().name, axis.twists.front().angle, broken.term, broken.before, broken.after));
}

}  // namespace

std::vector<StatedTwist> read_twists(Section& axis, const Parameters& parameters) {
  std::vector<StatedTwist> twists;
  const auto section = axis.take_section("phase");
  if (!section) {
    return twists;
  }
  for (const Entry& entry : section->entries()) {
    twists.push_back({entry.key, read_number(entry.value, entry.key, parameters), entry.location});
  }
  if (twists.empty()) {
    throw ProblemError(section->location(), "phase names nothing: write phase = { psi = \"pi/3\" }, or leave it out");
  }
  return twists;
}

void check_twists(Problem& problem) {
  auto& pde = std::get<MultisymplecticProblem>(problem.system);
  if (!pde.has_twists()) {
    return;
  }
  const MultisymplecticSystem system = make_laboratory_system(problem);
  std::vector<const StatedTwist*> all;
  for (GridAxis& axis : pde.axes) {
    for (StatedTwist& twist : axis.twists) {
      resolve_twist(twist, axis, system, pde);
      all.push_back(&twist);
    }
  }
  for (const StatedTwist* const twist : all) {
    const Eigen::MatrixXd B = generator_of(*twist, pde);
    const auto breaks = [&](const StatedSymmetry& symmetry) { return !commute(B, dense(symmetry.B)); };
    const bool is_pair = std::ranges::any_of(all, [&](const StatedTwist* other) {
      return breaks(*std::ranges::find(pde.symmetries, other->symmetry, &StatedSymmetry::name));
    });
    std::erase_if(pde.symmetries, [&](const StatedSymmetry& one) { return !is_pair && one.is_found && breaks(one); });
    if (const auto other = std::ranges::find_if(pde.symmetries, breaks); other != pde.symmetries.end()) {
      throw ProblemError(
          twist->location,
          fmt::format("phase: {} and {} do not commute, so that the second is no symmetry of a ring that "
                      "turns in the first. Leave one of them out",
                      twist->symmetry, other->name));
    }
  }
  static_cast<void>(at_location(all.front()->location, [&] { return make_jumps(problem); }));
  for (std::size_t a = 0; a < pde.axes.size(); ++a) {
    if (pde.axes[a].twists.empty() || !make_twists(problem).any()) {
      continue;
    }
    for (const NamedFormula& invariant : pde.invariants) {
      formula::Graph graph;
      const formula::Expression density = problem.build(invariant.formula, graph, quantity_names(pde), pde.fields);
      if (const auto broken = find_broken_term(density, ImageBehindSeam(problem, a))) {
        refuse_broken(*broken, pde.axes[a], "the density of an invariant", invariant.formula.location);
      }
    }
  }
}

void check_density_twists(const Problem& problem, const FormulaText& text, const CornerDensity& density) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  for (std::size_t a = 0; a < pde.axes.size(); ++a) {
    if (pde.axes[a].twists.empty() || !make_twists(problem).any()) {
      continue;
    }
    if (const auto broken = find_broken_term(density.L, ImageBehindSeam(problem, a))) {
      refuse_broken(*broken, pde.axes[a], "L", text.location);
    }
  }
}

Twists make_twists(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.has_twists()) {
    return {};
  }
  std::vector<grids::Axis> axes;
  std::vector<Eigen::MatrixXd> rates;
  const auto d = static_cast<Eigen::Index>(pde.fields.size());
  for (const GridAxis& axis : pde.axes) {
    axes.push_back({axis.name, axis.from, axis.to, static_cast<std::size_t>(axis.cells)});
    rates.emplace_back(Eigen::MatrixXd::Zero(d, d));
    for (const StatedTwist& twist : axis.twists) {
      rates.back() += twist.angle / axes.back().length() * generator_of(twist, pde);
    }
  }
  return {std::move(axes), std::move(rates)};
}

}  // namespace rubato
