#include <rubato/problem/solve_entries.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <rubato/problem/keys.hpp>

namespace rubato {

void refuse_unknown_keys(Section section, std::string_view table) {
  for (const std::string_view key : keys_of(table)) {
    static_cast<void>(section.take(key));
  }
  section.finish();
}

void read_duration_and_energy(Section& section, const Problem& problem, StatedSolve& solve) {
  const Entry *period = section.take("period"), *time = section.take("time"), *energy = section.take("energy");
  const bool closes = solve.closes();
  if (const Entry* wrong = closes ? time : period) {
    throw ProblemError(wrong->location, closes ? "time is of an orbit between two ends; of one that closes write period"
                                               : "period is of an orbit that closes; between two ends write time");
  }
  const auto is_word = [](const Entry* entry, std::string_view word) {
    return entry->value.string() != nullptr && *entry->value.string() == word;
  };
  solve.energy_location = energy != nullptr ? energy->value.location : solve.location;
  if (energy != nullptr && is_word(energy, solve_energy_words[1])) {
    solve.energy_of_start = true;
  } else if (energy != nullptr && !is_word(energy, solve_energy_words[0])) {
    solve.energy = read_number(energy->value, "energy", problem.parameters);
  }
  const Entry* entry = closes ? period : time;
  const double usual = problem.scheme.until - problem.start();
  solve.duration_location = entry != nullptr ? entry->value.location : solve.location;
  if (entry == nullptr) {
    solve.duration = solve.has_energy() ? std::nullopt : std::optional(usual);
  } else if (!is_word(entry, free_words[0])) {
    solve.duration = read_number(entry->value, entry->key, problem.parameters);
    if (!(*solve.duration * usual > 0.0)) {
      throw ProblemError(entry->value.location, fmt::format("{} = {} has to have the sign of until - t, which is {}",
                                                            entry->key, *solve.duration, usual));
    }
  }
}

void read_solve_steps(Section& section, const Problem& problem, StatedSolve& solve) {
  if (const Entry* entry = section.take("steps")) {
    solve.steps = static_cast<std::size_t>(read_integer(entry->value, "steps", problem.parameters, 1));
  } else if (!problem.scheme.step) {
    throw ProblemError(problem.scheme.step_location,
                       "step = \"auto\" is for runs; give a step here, or steps in [solve]");
  } else {
    const double steps = std::round((problem.scheme.until - problem.start()) / *problem.scheme.step);
    solve.steps = static_cast<std::size_t>(std::max(steps, 1.0));
  }
}

void read_newton(Section& section, const Problem& problem, StatedSolve& solve) {
  if (const Entry* entry = section.take("tolerance")) {
    solve.tolerance = read_number(entry->value, "tolerance", problem.parameters);
    if (!(solve.tolerance > 0.0 && solve.tolerance < 1.0)) {
      throw ProblemError(entry->value.location, "tolerance has to lie between 0 and 1");
    }
  }
  if (const Entry* entry = section.take("max_iterations")) {
    solve.most_iterations =
        static_cast<std::size_t>(read_integer(entry->value, "max_iterations", problem.parameters, 1));
  }
}

}  // namespace rubato
