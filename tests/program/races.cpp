// races RUBATO COUNT: two processes at one record, at the same moment. Two runs: one of them writes the record, the
// other is refused, whichever comes first. A resume while a run is ending: it is refused, or goes on from the end of
// the run. In the end the record is, bit by bit, that of a run never disturbed, and nothing is left beside it. Exits 0
// if all of this holds COUNT times, for an orbit and a lattice.

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>

#include "children.hpp"
#include "expect.hpp"
#include "record/sample.hpp"

namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

using children::expect;
using children::failures;

struct Contest {
  std::string program;
  fs::path folder;
  std::vector<std::string> problem;  ///< what `run` is given
  std::string until, later;
  std::mt19937 random{20};

  [[nodiscard]] pid_t run(const fs::path& file, const std::string& end) const {
    std::vector<std::string> arguments{"run"};
    arguments.insert(arguments.end(), problem.begin(), problem.end());
    arguments.insert(arguments.end(), {"--set", "scheme.until=" + end, "-o", file.string(), "--quiet"});
    return children::start(program, arguments);
  }
  [[nodiscard]] pid_t resume(const fs::path& file) const {
    return children::start(program, {"resume", file.string(), "--until", later, "--quiet"});
  }

  /// Nothing but the record is in its folder.
  void expect_alone(const fs::path& file) const {
    for (const auto& entry : fs::directory_iterator(file.parent_path())) {
      expect(entry.path() == file || entry.path().extension() == ".xdmf", "left behind: " + entry.path().string());
    }
  }

  void two_runs(const fs::path& whole) {
    const fs::path file = fresh("runs");
    const pid_t one = run(file, until);
    if (random() % 2 == 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(random() % 150));
    }
    const pid_t other = run(file, until);
    const int first = children::wait_for(one).status, second = children::wait_for(other).status;
    const auto refused = [](int status) { return status == 2 || status == 5; };
    expect((first == 0 && refused(second)) || (second == 0 && refused(first)),
           fmt::format("of two runs one is refused: {} and {}", first, second));
    const std::string difference = sample::difference(file, whole);
    expect(difference.empty(), "after two runs: " + difference);
    expect_alone(file);
  }

  void resume_at_the_end(const fs::path& whole, const fs::path& longer, std::chrono::milliseconds duration) {
    const fs::path file = fresh("resume");
    const pid_t one = run(file, until);
    // Mostly around the end of the run.
    std::this_thread::sleep_for(duration * static_cast<int>(60 + random() % 60) / 100);
    const int second = children::wait_for(resume(file)).status;
    const int first = children::wait_for(one).status;
    expect(first == 0, fmt::format("the run ends well: {}", first));
    expect(second == 0 || second == 5, fmt::format("the resume goes on or is refused: {}", second));
    const std::string difference = sample::difference(file, second == 0 ? longer : whole);
    expect(difference.empty(), fmt::format("after a resume with status {}: {}", second, difference));
    expect_alone(file);
    resumed += second == 0 ? 1 : 0;
    expect(children::wait_for(resume(file)).status == 0, "the last resume ends well");
    expect(sample::difference(file, longer).empty(), "the record is that of a run never disturbed");
  }

  int resumed = 0;

private:
  [[nodiscard]] fs::path fresh(const std::string& name) const {
    fs::remove_all(folder / name);
    fs::create_directory(folder / name);
    return folder / name / "race.h5";
  }
};

void hold(Contest contest, int count) {
  const fs::path whole = contest.folder / "whole.h5", longer = contest.folder / "longer.h5";
  const auto begin = std::chrono::steady_clock::now();
  expect(children::wait_for(contest.run(whole, contest.until)).status == 0, "a run alone ends well");
  const auto duration = std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::steady_clock::now() - begin);
  expect(children::wait_for(contest.run(longer, contest.later)).status == 0, "a longer run ends well");
  // The twin: what differs is distinguished.
  expect(!sample::difference(whole, longer).empty(), "a longer run differs");
  for (int i = 0; i < count; ++i) {
    contest.two_runs(whole);
    contest.resume_at_the_end(whole, longer, duration);
  }
  fmt::print("{}: {} races of two runs, {} of run and resume ({} resumed at once), {} failures so far\n",
             contest.problem.front(), count, count, contest.resumed, failures);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print("usage: races RUBATO COUNT\n");
    return 2;
  }
  try {
    const int count = std::atoi(argv[2]);
    for (const bool lattice : {false, true}) {
      const sample::Folder folder;
      hold({.program = argv[1],
            .folder = folder.path(),
            .problem = lattice ? std::vector<std::string>{"sine-gordon", "--set", "grid.x.cells=51"}
                               : std::vector<std::string>{"pendulum", "--set", "output.every=3"},
            .until = lattice ? "2" : "200",
            .later = lattice ? "2.5" : "230"},
           count);
    }
  } catch (const std::exception& error) {
    fmt::print("FAILED: {}\n", error.what());
    return 1;
  }
  return failures == 0 ? 0 : 1;
}
