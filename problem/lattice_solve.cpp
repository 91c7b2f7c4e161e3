#include <rubato/problem/solve_entries.hpp>

#include <fmt/format.h>

namespace rubato {

namespace {

/// \throws ProblemError for what is not solved for on lattices
void refuse_lattice(const Problem& problem, const StatedSolve& solve) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  const Scheme& scheme = problem.scheme;
  const bool one_stage = scheme.stages.value_or(1) == 1 && scheme.space_stages == 1;
  if ((scheme.method != "box" && scheme.method != "fourier" && scheme.method != "splitting") || !one_stage) {
    throw ProblemError(scheme.lagrangian_location,
                       "periodic orbits of lattices are for box and fourier with one stage, and for splitting; write "
                       "lagrangian = \"fourier\", without stages");
  }
  if (scheme.levels != Levels::fixed) {
    throw ProblemError(solve.location,
                       "periodic orbits of lattices have equal levels; write levels = \"fixed\" in [scheme]");
  }
  if (pde.axes.size() != 1) {
    throw ProblemError(solve.location, "periodic orbits of lattices are of one dimension; leave [solve] out");
  }
  if (pde.has_walls() || pde.sponge() != nullptr) {
    throw ProblemError(pde.axes.front().location,
                       "periodic orbits of lattices are on rings: leave left, right and sponge out of the grid");
  }
  if (pde.driven) {
    throw ProblemError(solve.location, "S names t, and periodic orbits are of an S without t; leave t out of S");
  }
  if (!pde.slopes.empty()) {
    throw ProblemError(pde.initial_location,
                       fmt::format("[initial] gives {} by its slope, and a solution is stored by fields; give {}",
                                   pde.slopes.front().field, pde.slopes.front().field));
  }
}

}  // namespace

StatedSolve read_lattice_solve(Section& section, const Problem& problem) {
  StatedSolve solve;
  solve.location = section.location();
  refuse_unknown_keys(section, "solve");
  refuse_lattice(problem, solve);
  const Entry& ends = section.require("ends", "\"periodic\"");
  solve.ends_location = ends.value.location;
  if (ends.value.string() == nullptr || *ends.value.string() != ends_words.front()) {
    throw ProblemError(solve.ends_location, "of a lattice periodic orbits alone are solved for: ends = \"periodic\"");
  }
  for (const std::string_view key : {"jump", "mirror", "from", "to", "guess", "starts", "continue"}) {
    if (const Entry* entry = section.take(key)) {
      throw ProblemError(entry->location, fmt::format("{} is for orbits of [hamiltonian]; leave it out", key));
    }
  }
  read_duration_and_energy(section, problem, solve);
  if (solve.energy_of_start) {
    throw ProblemError(solve.energy_location, "energy = \"initial\" is for orbits; give a number, or \"free\"");
  }
  read_solve_steps(section, problem, solve);
  const auto cells = static_cast<double>(problem.multisymplectic()->axes.front().cells);
  const auto fields = static_cast<double>(problem.multisymplectic()->fields.size());
  constexpr double most = 1.5e8;  // of fourier a gigabyte
  if (cells * fields * cells * fields * static_cast<double>(solve.steps) > most) {
    throw ProblemError(solve.location,
                       fmt::format("{} cells with {} fields and {} steps are too many to solve for at once: "
                                   "(cells * fields)^2 * steps may be {:.2g}; take fewer cells or steps",
                                   cells, fields, solve.steps, most));
  }
  read_newton(section, problem, solve);
  section.finish();
  return solve;
}

}  // namespace rubato
