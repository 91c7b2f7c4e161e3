#include <algorithm>
#include <optional>

#include <fmt/format.h>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// The field with an equation of motion that a constraint makes the derivative of a potential, if there is one.
std::optional<int> damped_derivative(const MultisymplecticSystem& system, int potential) {
  if (!system.structure().potential[static_cast<std::size_t>(potential)]) {
    return std::nullopt;
  }
  for (int row = 0; row < system.field_count(); ++row) {
    for (int axis = 0; axis < system.directions(); ++axis) {
      if (system.K(axis)(row, potential) == 0.0 || !system.M().row(row).isZero(0.0)) {
        continue;
      }
      for (int other = 0; other < system.field_count(); ++other) {
        if (system.constant_hessian()(row, other) != 0.0 &&
            !system.structure().algebraic[static_cast<std::size_t>(other)]) {
          return other;
        }
      }
    }
  }
  return std::nullopt;
}

/// No layer stands beside a wall that does: what it gives would be damped at once.
bool is_driven(const GridAxis& axis, bool is_right) {
  return std::ranges::find(axis.drives, is_right, &StatedDrive::is_right) != axis.drives.end();
}

}  // namespace

std::optional<StatedSponge> read_sponge(Section& section, const GridAxis& axis, const Parameters& parameters) {
  auto table = section.take_section("sponge");
  if (!table) {
    return std::nullopt;
  }
  StatedSponge sponge{.location = table->location()};
  static_cast<void>(table->take("width"));
  static_cast<void>(table->take("strength"));
  table->finish();  // so that an unknown key is named before a missing one
  const Entry& width = table->require("width", "how far each layer reaches into the range");
  const Entry& strength = table->require("strength", "the largest rate of the damping");
  sponge.width = read_number(width.value, "width", parameters);
  sponge.strength = read_number(strength.value, "strength", parameters);
  if (is_driven(axis, false) && is_driven(axis, true)) {
    throw ProblemError(sponge.location,
                       "sponge: both walls drive fields, and no layer stands beside such a wall. Leave sponge out, or "
                       "let one wall be \"fixed\" or \"free\"");
  }
  const bool is_one = is_driven(axis, false) || is_driven(axis, true);
  const double most = (is_one ? 1.0 : 0.5) * (axis.to - axis.from);
  if (!(sponge.width > 0.0 && sponge.width < most)) {
    throw ProblemError(
        width.location,
        fmt::format("sponge: width = {:.6g} has to be more than 0 and less than {}the range, {:.6g}, so that a "
                    "window is left {} the layer{}",
                    sponge.width, is_one ? "" : "half of ", most, is_one ? "beside" : "between", is_one ? "" : "s"));
  }
  if (!(sponge.strength > 0.0)) {
    throw ProblemError(strength.location, fmt::format("sponge: strength = {:.6g} has to be more than 0, for less would "
                                                      "not damp; leave sponge out for a window without layers",
                                                      sponge.strength));
  }
  return sponge;
}

void check_sponge(const Problem& problem) {
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  const StatedSponge* const sponge = pde == nullptr ? nullptr : pde->sponge();
  if (sponge == nullptr) {
    return;
  }
  const auto refuse = [&](const std::string& reason) { throw ProblemError(sponge->location, "sponge: " + reason); };
  const MultisymplecticSystem system = make_laboratory_system(problem);
  for (int f = 0; f < system.field_count(); ++f) {
    if (const auto other = damped_derivative(system, f)) {
      refuse(
          fmt::format("{} is a derivative of {}, and damping both would contradict that. State an equation without "
                      "{}, or leave sponge out",
                      pde->fields[static_cast<std::size_t>(*other)], pde->fields[static_cast<std::size_t>(f)],
                      pde->fields[static_cast<std::size_t>(f)]));
    }
  }
  if (pde->has_jumps()) {
    refuse("a layer damps fields to 0, and [grid] has a jump. Leave one of them out");
  }
  if (problem.scheme.frame) {
    refuse("a layer rests, and [scheme] frame moves. Leave one of them out");
  }
  if (pde->driven) {
    refuse("S names t, which is a field that a layer would damp. Leave sponge or t out");
  }
  if (pde->next) {
    refuse("[initial.next] is a level that no damping led to. Leave one of them out");
  }
  if (!problem.levels.all()) {
    refuse("what the layers take is counted at every level. Write [levels] every = 1 where [output] has another every");
  }
}

std::shared_ptr<const Sponge> make_sponge(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  std::vector<Sponge::Layer> layers;
  for (std::size_t a = 0; a < pde.axes.size(); ++a) {
    if (const auto& sponge = pde.axes[a].sponge) {
      const GridAxis& axis = pde.axes[a];
      layers.push_back({.axis = static_cast<int>(a),
                        .from = axis.from,
                        .to = axis.to,
                        .width = sponge->width,
                        .strength = sponge->strength,
                        .at_left = !is_driven(axis, false),
                        .at_right = !is_driven(axis, true)});
    }
  }
  return layers.empty() ? nullptr : std::make_shared<const Sponge>(std::move(layers));
}

}  // namespace rubato
