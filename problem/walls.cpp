#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <memory>
#include <random>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/batch.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/mirrors.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/problem/scheme_options.hpp>

namespace rubato {

namespace {

constexpr std::array<std::string_view, 2> wall_words = {"fixed", "free"};

/// One end; periodic where it is not given.
grids::End read_end(Section& section, const char* key, std::span<const std::string> fields,
                    std::vector<StatedDrive>& drives) {
  const Entry* const entry = section.take(key);
  if (entry == nullptr) {
    return grids::End::periodic;
  }
  if (entry->value.table() != nullptr) {
    for (const Entry& value : *entry->value.table()) {
      if (std::ranges::find(fields, value.key) == fields.end()) {
        throw ProblemError(value.location, fmt::format("{}: {} is not a field; the fields are {}", key, value.key,
                                                       fmt::join(fields, ", ")));
      }
      drives.push_back({std::string_view(key) == "right", value.key, read_formula(value.value, value.key)});
    }
    if (entry->value.table()->empty()) {
      throw ProblemError(entry->location,
                         fmt::format("{0} names no field: write {0} = {{ {1} = \"sin(t)\" }}, \"fixed\" or \"free\"",
                                     key, fields.front()));
    }
    return grids::End::fixed;
  }
  return read_word(entry->value, key, wall_words) == 0 ? grids::End::fixed : grids::End::free;
}

std::vector<std::string> drive_arguments(const MultisymplecticProblem& pde) {
  std::vector<std::string> names = {"t"};
  std::ranges::copy(pde.axis_names(), std::back_inserter(names));
  return names;
}

/// The largest change of L in a mirror normal to an axis at random corners, relative to L.
double change_in_mirror(const CornerDensity& density, int axis, const MirrorSigns& signs, grids::End wall) {
  std::vector<formula::Expression> variables = density.corners;
  std::ranges::copy(density.spacings, std::back_inserter(variables));
  std::ranges::copy(density.places, std::back_inserter(variables));
  formula::ScalarEvaluator evaluate(formula::Bytecode(std::array{density.L}, variables));
  std::mt19937_64 random(60);
  std::uniform_real_distribution<double> value(0.1, 1.2);
  constexpr int samples = 8;
  double largest = 0.0;
  for (int sample = 0; sample < samples; ++sample) {
    std::vector<double> here(variables.size());
    std::ranges::generate(here, [&] { return value(random); });
    std::vector<double> mirrored = here;
    const int corners = density.corner_count();
    for (int f = 0; f < density.fields; ++f) {
      for (int corner = 0; corner < corners; ++corner) {
        mirrored[static_cast<std::size_t>(f * corners + corner)] =
            signs.at(f, wall) * here[static_cast<std::size_t>(f * corners + (corner ^ (1 << axis)))];
      }
    }
    double before = 0.0, after = 0.0;
    evaluate(here, std::span(&before, 1));
    evaluate(mirrored, std::span(&after, 1));
    largest = std::max(largest, std::abs(after - before) / (1.0 + std::abs(before)));
  }
  return largest;
}

}  // namespace

std::shared_ptr<const WallDrives> make_wall_drives(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.has_drives()) {
    return nullptr;
  }
  const std::vector<std::string> names = drive_arguments(pde);
  WallDrives drives{.walls = {}, .start = pde.start};
  for (std::size_t a = 0; a < pde.axes.size(); ++a) {
    for (const StatedDrive& drive : pde.axes[a].drives) {
      formula::Graph graph;
      std::vector<formula::Expression> variables;
      for (const std::string& name : names) {
        variables.push_back(graph.variable(name));
      }
      const formula::Expression value = problem.build(drive.value, graph, names);
      const std::array outputs{value, formula::derivative(value, variables.front())};
      const auto field = std::ranges::find(pde.fields, drive.field);
      drives.walls.push_back({.axis = static_cast<int>(a),
                              .is_right = drive.is_right,
                              .field = static_cast<int>(field - pde.fields.begin()),
                              .code = formula::Bytecode(outputs, variables)});
    }
  }
  return std::make_shared<const WallDrives>(std::move(drives));
}

void check_density_walls(const Problem& problem, const FormulaText& text, const CornerDensity& density) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.has_walls()) {
    return;
  }
  const MultisymplecticSystem system = make_laboratory_system(problem);
  for (int f = 0; f < density.fields; ++f) {
    if (density.names(f) && system.structure().algebraic[static_cast<std::size_t>(f)]) {
      throw ProblemError(text.location,
                         fmt::format("between walls L may name fields with an equation of motion, and {0} has none: "
                                     "write differences in its place",
                                     pde.fields[static_cast<std::size_t>(f)]));
    }
  }
  constexpr double same = 1e-11;  // some hundred roundings
  for (int a = 0; a < density.dimensions; ++a) {
    const GridAxis& axis = pde.axes[static_cast<std::size_t>(a)];
    if (!axis.has_walls()) {
      continue;
    }
    if (density.names_place(a)) {
      throw ProblemError(text.location,
                         fmt::format("L names {0}, and [grid] has walls along {0}: leave one of them out", axis.name));
    }
    const MirrorSigns signs(system, a, axis.name);
    for (const grids::End wall : {axis.left, axis.right}) {
      if (!(change_in_mirror(density, a, signs, wall) <= same)) {
        throw ProblemError(
            text.location,
            fmt::format("walls along {0} need an L that is the same in a mirror, which exchanges the "
                        "corners of a cell along {0}{1}: this one changes. Write it the same in both "
                        "nodes, or leave left and right out",
                        axis.name,
                        wall == grids::End::fixed ? " and turns the sign of the fields that a wall holds" : ""));
      }
    }
  }
}

void read_walls(Section& section, std::span<const std::string> fields, GridAxis& axis) {
  axis.left = read_end(section, "left", fields, axis.drives);
  axis.right = read_end(section, "right", fields, axis.drives);
  if ((axis.left == grids::End::periodic) != (axis.right == grids::End::periodic)) {
    const bool is_left = axis.right == grids::End::periodic;
    throw ProblemError(section.location(),
                       fmt::format("grid.{0} has a wall on the {1} and none on the {2}, where a period would begin: "
                                   "give {2} = \"fixed\" or \"free\", too",
                                   axis.name, is_left ? "left" : "right", is_left ? "right" : "left"));
  }
}

void check_walls(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.has_walls()) {
    return;
  }
  if (pde.has_jumps()) {
    throw ProblemError(pde.axes.front().location,
                       "[grid] has walls and a jump, which is across the seam of a period: leave one of them out");
  }
  if (pde.has_twists()) {
    throw ProblemError(pde.axes.front().location,
                       "[grid] has walls and a phase, by which fields turn over a period: leave one of them out");
  }
  if (pde.next) {
    throw ProblemError(pde.next->location, "[initial.next] is for grids without walls: leave one of them out");
  }
  for (const GridAxis& axis : pde.axes) {
    for (const StatedDrive& drive : axis.drives) {
      check_formula(drive.value, {.names = drive_arguments(pde)}, problem.parameters);
    }
  }
  const MultisymplecticSystem system = make_laboratory_system(problem);
  for (std::size_t a = 0; a < pde.axes.size(); ++a) {
    if (pde.axes[a].has_walls()) {
      at_location(pde.axes[a].location, [&] { return MirrorSigns(system, static_cast<int>(a), pde.axes[a].name); });
    }
  }
}

}  // namespace rubato
