#include <rubato/problem/stored.hpp>

#include <fmt/format.h>

#include <rubato/record/run_shape.hpp>

namespace rubato {

StoredLevels::StoredLevels(const record::Reader& reader, std::size_t stored_every)
    : t(reader.read("/levels/t")),
      h(reader.read("/levels/h")),
      bridged(reader.read("/levels/bridged")),
      state_t(reader.read("/states/t")),
      told_level(reader.read("/states/level")),
      every(stored_every),
      sparse(reader.has("/states/previous/t")) {
  // Every n-th level is stored; the last one, too, unless the run still goes on.
  const std::size_t regular = t.empty() ? 0 : h.size() / every + 1;
  const bool fits = state_t.size() == regular || (state_t.size() == regular + 1 && h.size() % every != 0);
  const auto unfit = [&] {
    return fmt::format("{} levels, {} steps and {} stored states do not fit together", t.size(), h.size(),
                       state_t.size());
  };
  if (reader.has("/levels/step_potential")) {
    potential = reader.read("/levels/step_potential");
  }
  const bool fits_potential = potential.empty() || potential.size() == h.size();
  if (t.size() != h.size() + 1 || bridged.size() != h.size() || !fits_potential ||
      told_level.size() != state_t.size()) {
    throw record::Error(reader.file(), unfit());
  }
  if (!fits || (every > 1 && !sparse)) {
    throw figures::Mismatch(reader.file(), "/states/level", fmt::format("with every = {}, {}", every, unfit()));
  }
  for (std::size_t row = 0; row < state_t.size(); ++row) {
    state_level.push_back(row < regular ? row * every : h.size());
  }
}

namespace {

/// What a problem claims is compared with what the record has before anything of that size is made.
void require_fit(const Problem& problem, const record::Reader& reader) {
  const auto require = [&](const std::string& path, std::size_t size) {
    if (!reader.has(path)) {
      throw record::Error(reader.file(), fmt::format("there is no dataset '{}', which its problem asks for", path));
    }
    if (const std::size_t rows = reader.rows(path); rows != size) {
      throw record::Error(
          reader.file(), fmt::format("dataset '{}' has {} values; by the problem it should have {}", path, rows, size));
    }
  };
  if (const HamiltonianProblem* orbit = problem.hamiltonian()) {
    require("/states/coordinate", orbit->q.size());
    require("/states/momentum", orbit->p.size());
    if (orbit->L) {
      require("/states/velocity", orbit->q_dot.size());
    }
    return;
  }
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  for (const GridAxis& axis : pde.axes) {
    require("/grid/" + axis.name, static_cast<std::size_t>(axis.cells));
  }
  for (const std::string& field : pde.fields) {
    const bool at_midpoints = reader.has("/states/midpoints/" + field);
    const record::DatasetInfo info = reader.info((at_midpoints ? "/states/midpoints/" : "/states/") + field);
    if (info.is_text || info.shape.size() != pde.axes.size() + 1) {
      throw record::Error(reader.file(),
                          fmt::format("dataset '{}' does not lie on the grid of the problem", info.path));
    }
  }
}

}  // namespace

Problem parse_stored(const std::string& text, const std::string& file, std::span<const std::string> settings) {
  Problem problem = parse_problem(text, file, settings);
  if (auto* pde = std::get_if<MultisymplecticProblem>(&problem.system); pde != nullptr && pde->initial_record) {
    pde->initial_record->file = file;
    pde->initial_record->own_start = true;
  }
  return problem;
}

Problem stored_problem(const record::Reader& reader) {
  record::require_run(reader);
  try {
    Problem problem = parse_stored(reader.header().problem, reader.file().string());
    if (problem.scheme.usual_potential && !reader.has("/levels/step_potential")) {
      problem.scheme.potential = {};  // from before there was a usual one
    }
    require_fit(problem, reader);
    return problem;
  } catch (const ProblemError& error) {
    throw record::Error(reader.file(), fmt::format("the problem in it cannot be read ({})", error.what()));
  }
}

}  // namespace rubato
