#include <algorithm>
#include <array>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// A number, or nothing for "fit".
std::optional<double> read_rate(const Value& value, std::string_view what, const Parameters& parameters) {
  if (value.string() != nullptr && *value.string() == fit_words[0]) {
    return std::nullopt;
  }
  return read_number(value, what, parameters);
}

void refuse_places(const Problem& problem, const Location& location) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (pde.driven) {
    throw ProblemError(location, "a frame moves through a medium that S names t of: leave frame out, or t out of S");
  }
  formula::Graph graph;
  const std::vector<std::string> names = quantity_names(pde);
  for (const std::size_t variable : formula::variables_of(problem.build(pde.S, graph, names))) {
    const std::string& name = graph.variable_name(variable);
    if (std::ranges::find(axis_letters, name) != axis_letters.end()) {
      throw ProblemError(location, fmt::format("S names {0}: in a moving frame the medium would move. Leave frame out, "
                                               "or {0} out of S",
                                               name));
    }
  }
  if (pde.has_twists()) {
    throw ProblemError(location, "a frame moves, and [grid] has a phase, whose seam stays: leave one of them out");
  }
  if (pde.has_walls()) {
    throw ProblemError(location, "a frame moves, and the walls of [grid] stay: leave one of them out");
  }
  if (pde.next) {
    throw ProblemError(pde.next->location,
                       "[initial.next] is a level of the laboratory, and the frame moves: leave one of them out");
  }
}

/// A frame does not turn fields that jump: S is not the same at z + J and in the turned frame.
void refuse_turning_jumps(const MultisymplecticProblem& pde, const std::string& symmetry, const Location& location) {
  const Eigen::MatrixXd B = dense(std::ranges::find(pde.symmetries, symmetry, &StatedSymmetry::name)->B);
  for (const GridAxis& axis : pde.axes) {
    for (const StatedJump& jump : axis.jumps) {
      const auto f = std::ranges::find(pde.fields, jump.field) - pde.fields.begin();
      if (!B.row(f).isZero(0.0) || !B.col(f).isZero()) {
        throw ProblemError(location, fmt::format("{} turns the field {}, which jumps: leave phase or the jump out",
                                                 symmetry, jump.field));
      }
    }
  }
}

}  // namespace

std::string symmetry_of_phase(const Entry& entry, const MultisymplecticProblem& pde) {
  std::string name = entry.key;
  if (!pde.derived.empty() && name.starts_with("psi")) {  // the symmetry of its phase that [field] finds
    name = name == "psi" ? "charge" : "charge_" + name.substr(3);
  }
  std::vector<std::string> names;
  std::ranges::transform(pde.symmetries, std::back_inserter(names), &StatedSymmetry::name);
  if (std::ranges::find(names, name) == names.end()) {
    const auto nearest = formula::nearest_name(name, names);
    throw ProblemError(
        entry.location,
        fmt::format("{} is no entry of [symmetries]; {}", name,
                    nearest         ? fmt::format("did you mean {}?", *nearest)
                    : names.empty() ? "state it there, such as charge = [[\"p\", \"q\", 1], [\"q\", \"p\", -1]]"
                                    : fmt::format("those are {}", fmt::join(names, ", "))));
  }
  return name;
}

std::optional<StatedFrame> read_frame(Section& scheme, const Problem& problem) {
  std::optional<Section> section = scheme.take_section("frame");
  if (!section) {
    return std::nullopt;
  }
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  if (pde == nullptr) {
    throw ProblemError(section->location(), "frame is for lattices; leave it out");
  }
  refuse_places(problem, section->location());
  const std::size_t directions = pde->axes.size();
  StatedFrame frame{.velocity = std::vector<double>(directions, 0.0), .location = section->location()};
  if (const Entry* entry = section->take("velocity")) {
    if (entry->value.array() != nullptr) {
      const Value::Array& components = *entry->value.array();
      if (components.size() != directions) {
        throw ProblemError(entry->value.location,
                           fmt::format("velocity has {} components, and the grid {} direction{}", components.size(),
                                       directions, directions == 1 ? "" : "s"));
      }
      std::ranges::transform(components, frame.velocity->begin(),
                             [&](const Value& value) { return read_number(value, "velocity", problem.parameters); });
    } else if (const auto speed = read_rate(entry->value, "velocity", problem.parameters)) {
      if (directions > 1) {
        throw ProblemError(entry->value.location, fmt::format("velocity needs {} components here, such as [{}, 0{}]",
                                                              directions, *speed, directions == 3 ? ", 0" : ""));
      }
      frame.velocity->front() = *speed;
    } else {
      frame.velocity.reset();
    }
  }
  if (auto phase = section->take_section("phase")) {
    const Value::Table& rates = phase->entries();
    if (rates.size() != 1) {
      throw ProblemError(phase->location(), fmt::format("phase names {} symmetries, and a frame turns in one, such as "
                                                        "phase = {{ charge = 0.5 }}",
                                                        rates.size()));
    }
    const Entry& rate = rates.front();
    frame.symmetry = symmetry_of_phase(rate, *pde);
    refuse_turning_jumps(*pde, frame.symmetry, rate.location);
    frame.rate = read_rate(rate.value, "phase", problem.parameters);
  }
  section->finish();
  return frame;
}

std::vector<std::string> fitted_frame(const Problem& problem) {
  const StatedFrame& frame = *problem.scheme.frame;
  Problem laboratory = problem;
  laboratory.scheme.frame.reset();
  laboratory.scheme.method = "fourier";
  laboratory.scheme.stages.reset();
  laboratory.scheme.space_stages = 1;
  laboratory.scheme.space = "fourier";
  laboratory.scheme.levels = Levels::fixed;
  laboratory.scheme.potential = {};
  laboratory.scheme.density = nullptr;
  // So short a step that its own error is small beside that of taking one velocity for all waves.
  constexpr double part = 1.0 / 64.0;
  const double step = laboratory.scheme.step.value_or(1e-3 * (problem.scheme.until - problem.start()));
  laboratory.scheme.step = part * step;
  laboratory.scheme.energy_tolerance.reset();
  LatticeIntegrator lattice = make_lattice(laboratory);
  const LatticeLevel before = lattice.level();
  const StepReport report = lattice.step();
  if (report.status != Status::success) {
    throw ProblemError(frame.location,
                       fmt::format("nothing can be fitted, for a first step fails: {}. Give velocity as "
                                   "a number",
                                   lattice.explain(report)));
  }
  MovingFrame fitted = *make_frame(problem);
  fit_frame(lattice.system(), lattice.grid(), before, lattice.level(), report.h, !frame.velocity,
            !frame.symmetry.empty() && !frame.rate, fitted);
  std::vector<std::string> settings;
  if (!frame.velocity) {
    settings.push_back(fmt::format("scheme.frame.velocity=[{:.17g}]", fmt::join(fitted.velocity, ", ")));
  }
  if (!frame.symmetry.empty() && !frame.rate) {
    settings.push_back(fmt::format("scheme.frame.phase={{ {} = {:.17g} }}", frame.symmetry, fitted.rate));
  }
  return settings;
}

}  // namespace rubato
