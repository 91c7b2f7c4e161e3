#include <rubato/problem/stored.hpp>

#include <algorithm>

#include <fmt/format.h>

#include <rubato/record/run_shape.hpp>

namespace rubato {

std::optional<std::vector<std::size_t>> every_nth(std::size_t count, std::size_t every, std::size_t last) {
  const std::size_t regular = last / every + 1;
  if (count != regular && (count != regular + 1 || last % every == 0)) {
    return std::nullopt;
  }
  std::vector<std::size_t> numbers;
  for (std::size_t row = 0; row < count; ++row) {
    numbers.push_back(row < regular ? row * every : last);
  }
  return numbers;
}

StoredLevels::StoredLevels(const record::Reader& reader, const Problem& problem)
    : reported_step(reader.read("/levels/step")),
      t(reader.read("/levels/t")),
      clock(reader.has(std::string(figures::level_times)) ? reader.read(std::string(figures::level_times)) : t),
      h(reader.read("/levels/h")),
      off_law(reader.read(record::off_law_path(reader))),
      state_t(reader.read("/states/t")),
      reported_level(reader.read("/states/level")),
      last(figures::stored_last_level(reader).value_or(h.size())),
      every(static_cast<std::size_t>(problem.output.states_every())),
      rows_every(static_cast<std::size_t>(problem.levels.every)),
      sparse(every > 1),
      evolving_alone(problem.stores_evolving_alone()) {
  if (reader.has("/levels/step_potential")) {
    potential = reader.read("/levels/step_potential");
  }
  const bool needs_previous = sparse && !evolving_alone, has_previous = reader.has("/states/previous/t");
  if (needs_previous && has_previous) {
    previous_t = reader.read("/states/previous/t");
  }
  const auto unfit = [&] {
    return fmt::format("{} levels, {} steps and {} stored states do not fit together", t.size(), h.size(),
                       state_t.size());
  };
  const bool fits_potential = potential.empty() || potential.size() == h.size();
  const bool fits_previous = !needs_previous || !has_previous || previous_t.size() == state_t.size();
  if (t.size() != h.size() + 1 || clock.size() != t.size() || off_law.size() != h.size() ||
      reported_step.size() != h.size() || !fits_potential || !fits_previous ||
      reported_level.size() != state_t.size()) {
    throw record::Error(reader.file(), unfit());
  }
  const auto rows = every_nth(t.size(), rows_every, last);
  if (!rows) {
    throw figures::Mismatch(reader.file(), "/levels/step",
                            fmt::format("with a row of every {}-th of {} levels, {}", rows_every, last + 1, unfit()));
  }
  level = *rows;
  const auto states = every_nth(state_t.size(), every, last);
  if (!states || (needs_previous && !has_previous)) {
    throw figures::Mismatch(reader.file(), "/states/level", fmt::format("with every = {}, {}", every, unfit()));
  }
  state_level = *states;
}

std::optional<std::size_t> StoredLevels::row_of(std::size_t number) const {
  if (number == level.back()) {
    return level.size() - 1;
  }
  const std::size_t row = number / rows_every;
  return number % rows_every == 0 && row < level.size() ? std::optional(row) : std::nullopt;
}

std::optional<std::size_t> StoredLevels::step_to(std::size_t state_row) const {
  const auto row = row_of(state_level[state_row]);
  return row && *row > 0 ? std::optional(*row - 1) : std::nullopt;
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
    require("/grid/" + axis.name, static_cast<std::size_t>(axis.nodes()));
  }
  for (const std::string& field : pde.fields) {
    const bool at_midpoints = reader.has("/states/midpoints/" + field);
    if (problem.stores_evolving_alone() && !at_midpoints && !reader.has("/states/" + field)) {
      continue;
    }
    const record::DatasetInfo info = reader.info((at_midpoints ? "/states/midpoints/" : "/states/") + field);
    if (info.is_text || info.shape.size() != pde.axes.size() + 1) {
      throw record::Error(reader.file(),
                          fmt::format("dataset '{}' does not lie on the grid of the problem", info.path));
    }
  }
}

}  // namespace

Problem parse_stored(const std::string& text, const std::string& file, std::span<const std::string> settings) {
  Problem problem = parse_recorded(text, file, settings);
  if (auto* pde = std::get_if<MultisymplecticProblem>(&problem.system); pde != nullptr && pde->initial_record) {
    pde->initial_record->file = file;
    pde->initial_record->own_start = true;
  }
  return problem;
}

void keep_to_version_of(const record::Reader& reader, Problem& problem) {
  if (problem.scheme.usual_potential && !reader.has("/levels/step_potential")) {
    problem.scheme.potential = {};
  }
  if (!figures::stored_last_level(reader)) {
    problem.levels.every = 1;
  }
  if (problem.multisymplectic() != nullptr) {
    const std::vector<record::DatasetInfo> all = reader.datasets();
    problem.laws.fields =
        std::ranges::any_of(all, [](const auto& info) { return info.path.starts_with("/laws/fields/"); });
    problem.output.all_fields = reader.has("/states/previous/t");
  }
  if (problem.clock() && !reader.has(std::string(figures::level_times))) {
    problem.output.in_fictitious_time = true;
    auto& invariants = std::get<HamiltonianProblem>(problem.system).invariants;
    std::erase_if(invariants, [&](const NamedFormula& one) { return !reader.has("/laws/" + one.name); });
  }
}

Problem stored_problem(const record::Reader& reader) {
  record::require_run(reader);
  try {
    Problem problem = parse_stored(reader.header().problem, reader.file().string());
    keep_to_version_of(reader, problem);
    require_fit(problem, reader);
    return problem;
  } catch (const ProblemError& error) {
    throw record::Error(reader.file(), fmt::format("the problem in it cannot be read ({})", error.what()));
  }
}

}  // namespace rubato
