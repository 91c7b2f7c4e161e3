#pragma once

// What tests of things reported along a run share: of output times, and of events.

#include <filesystem>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/problem/problem.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

namespace rubato::run_tests {

using Settings = std::vector<std::string>;

inline Settings with(Settings settings, const Settings& more) {
  settings.insert(settings.end(), more.begin(), more.end());
  return settings;
}

inline bool sound(const std::string& file, bool replay = false) {
  const rubato::Outcome outcome = rubato::check(file, {.replay = replay});
  INFO(outcome.message);
  CHECK(outcome.status == rubato::ExitStatus::done);
  return outcome.status == rubato::ExitStatus::done;
}

inline void check_resumes(const std::string& name, const Settings& settings, const std::vector<double>& moments,
                          double end) {
  INFO(name);
  const Folder folder;
  run_problem(name, folder / "whole.h5", with(settings, {"scheme.until=" + std::to_string(end)}));
  CHECK(sound(folder / "whole.h5", true));
  for (const double moment : moments) {
    const std::string file = folder / ("stopped" + std::to_string(moment) + ".h5");
    run_problem(name, file, with(settings, {"scheme.until=" + std::to_string(moment)}));
    CHECK(rubato::resume(file, end, {.threads = 1}).status == rubato::ExitStatus::done);
    CHECK(different_datasets(file, folder / "whole.h5") == Names{});
  }
}

/// What is said of a problem that is refused: nothing is then written.
inline std::string refusal(const std::string& name, const Settings& settings) {
  const Folder folder;
  const std::string file = folder / "refused.h5";
  try {
    static_cast<void>(rubato::run(rubato::read_problem(name, settings), {.output = file, .threads = 1}));
  } catch (const rubato::ProblemError& error) {
    CHECK_FALSE(std::filesystem::exists(file));
    return error.what();
  }
  return {};
}

}  // namespace rubato::run_tests
