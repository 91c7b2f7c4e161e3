#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <rubato/problem/problem.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "run/mailboxes.hpp"
#include "run/records.hpp"

namespace rubato::run_tests {

using Settings = std::vector<std::string>;

/// A wave on a torus, neither direction like the other; [exact] is not what it does, but its differences are figures.
inline Problem wave_on_torus(std::size_t x, std::size_t y, Settings more = {}, bool differences = false) {
  if (differences) {
    more.emplace_back("scheme.space=differences");
  }
  const std::string text = fmt::format(R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2 + 1 - cos(u)"
[grid]
x = {{ from = -1, to = 5, cells = {} }}
y = {{ from = 0.3, to = 7, cells = {} }}
[initial]
u = "sin(pi*x/3)*exp(cos(2*pi*(y - 0.3)/6.7))"
v = "dx(u)"
[exact]
u = "x*t"
[invariants]
mass = "u^2 + b"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.01
until = 0.3
[output]
every = 7
)toml",
                                       x, y);
  return parse_problem(text, "torus.toml", more);
}

inline Problem wave_in_space(const Settings& settings) {
  return parse_problem(R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b", "c"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
K.z = [["u", "c", 1]]
S = "(v^2 - a^2 - b^2 - c^2)/2 + u^4/4"
[grid]
x = { from = 0, to = 1, cells = 13 }
y = { from = 0, to = 1, cells = 9 }
z = { from = 0, to = 1, cells = 11 }
[initial]
u = "sin(2*pi*(x + 2*y))*cos(2*pi*z)"
v = 0
[invariants]
mass = "u^2 + c"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.01
until = 0.2
)toml",
                       "space.toml", settings);
}

inline RunOptions on(ranks::Communicator& ranks, const std::string& file) {
  return {.output = file, .overwrite = true, .threads = 1, .ranks = &ranks};
}

/// The same without versions of the record along the way, whose number depends on the speed of the machine.
inline RunOptions uncommitted_on(ranks::Communicator& ranks, const std::string& file) {
  RunOptions options = on(ranks, file);
  options.commit_interval = std::chrono::hours(24);
  return options;
}

/// A problem of the catalogue on a line, with the box scheme and fixed levels.
inline Problem line(const std::string& name, Settings more) {
  more.insert(more.begin(), {"scheme.lagrangian=box", "scheme.levels=fixed", "output.every=3"});
  return read_problem(name, more);
}

/// The warnings of a run, or why it is refused.
inline std::vector<std::string> said_of(const Problem& problem, const RunOptions& options) {
  try {
    return run(problem, options).warnings;
  } catch (const ProblemError& error) {
    return {error.what()};
  }
}

enum class Continued { all, last };

/// Compares runs of a problem on ranks with that of one process: record, tables, checks, and what is continued on
/// another number of ranks: of all, or of the last of `sizes` alone. `make(more)` states the problem, with more
/// settings.
template <typename Make>
void check_shared_run(const Folder& folder, const Make& make, const std::string& sooner, const std::vector<int>& sizes,
                      bool tangents = false, Continued continue_by = Continued::all) {
  const Problem whole = make({}), part = make({"scheme.until=" + sooner});
  const std::string alone = folder / "one.h5", shared = folder / "all.h5", continued = folder / "part.h5";
  const Outcome one = run(whole, {.output = alone, .overwrite = true, .threads = 1, .tangents = tangents});
  REQUIRE(one.status == ExitStatus::done);
  const Outcome sound = check(alone);
  REQUIRE(sound.status == ExitStatus::done);
  const auto shared_by = [&](auto& rank, const std::string& file) {
    RunOptions options = on(rank, file);
    options.tangents = tangents;
    return options;
  };
  std::string ended = alone;
  if (!whole.scheme.step) {  // which is another one for a run that ends sooner
    ended = folder / "ended.h5";
    static_cast<void>(run(part, {.output = ended, .overwrite = true, .threads = 1}));
    static_cast<void>(resume(ended, whole.scheme.until, {.threads = 1}));
  }
  for (const int size : sizes) {
    INFO(size << " ranks");
    const Outcome all = with_ranks(size, [&](auto& rank) { return run(whole, shared_by(rank, shared)); });
    CHECK(all.status == ExitStatus::done);
    CHECK(different_on_ranks(alone, shared) == Names{});
    CHECK(differences_on_ranks(one, all) == Names{});
    CHECK(all.warnings == one.warnings);
    const Outcome checked = with_ranks(size, [&](auto& rank) { return check(alone, {.ranks = &rank}); });
    CHECK(to_json(checked) == to_json(sound));
    if (continue_by == Continued::last && size != sizes.back()) {
      continue;
    }
    static_cast<void>(with_ranks(size, [&](auto& rank) { return run(part, shared_by(rank, continued)); }));
    const Outcome resumed = with_ranks(size == 2 ? 1 : 2, [&](auto& rank) {
      return resume(continued, whole.scheme.until, {.threads = 1, .ranks = &rank});
    });
    CHECK(resumed.status == ExitStatus::done);
    CHECK(different_on_ranks(ended, continued) == Names{});
  }
}

}  // namespace rubato::run_tests
