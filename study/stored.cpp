#include <rubato/study/stored.hpp>

#include <fmt/format.h>

namespace rubato::study {

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
  if (t.size() != h.size() + 1 || bridged.size() != h.size() || told_level.size() != state_t.size()) {
    throw record::Error(reader.file(), unfit());
  }
  if (!fits || (every > 1 && !sparse)) {
    throw figures::Mismatch(reader.file(), "/states/level", fmt::format("with every = {}, {}", every, unfit()));
  }
  for (std::size_t row = 0; row < state_t.size(); ++row) {
    state_level.push_back(row < regular ? row * every : h.size());
  }
}

Problem stored_problem(const record::Reader& reader) {
  try {
    return parse_problem(reader.header().problem, reader.file().string());
  } catch (const ProblemError& error) {
    throw record::Error(reader.file(), fmt::format("the problem in it cannot be read ({})", error.what()));
  }
}

}  // namespace rubato::study
