// Runs that are asked to end: in a look-ahead, and between levels.

#include <catch2/catch.hpp>

#include <atomic>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include <rubato/base/interrupt.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/run/checkpoint_check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;

TEST_CASE("what is asked of one thread and in one scope ends nothing else", "[run]") {
  std::atomic<bool> flag = true;
  CHECK_FALSE(Interruptible::asked());
  {
    const Interruptible outer(&flag);
    CHECK(Interruptible::asked());
    {
      const Interruptible inner(nullptr);
      CHECK_FALSE(Interruptible::asked());
    }
    CHECK(Interruptible::asked());
    std::thread([] { CHECK_FALSE(Interruptible::asked()); }).join();
    flag = false;
    CHECK_FALSE(Interruptible::asked());
  }
}

TEST_CASE("a run that is interrupted in its look-ahead has no step, and goes on as if it had never stopped", "[run]") {
  const Folder folder;
  const std::string file = folder / "stopped.h5", whole = folder / "whole.h5";
  const std::vector<std::string> settings = {"scheme.until=3"};
  const Problem problem = read_problem("henon-heiles", settings);
  std::atomic<bool> asked = false, storing = false;
  RunOptions options{.output = file, .interrupt = &asked, .storing = &storing};
  options.caution = [&](const std::string&) { CHECK(storing); };
  asked = true;
  const Outcome stopped = run(problem, options);
  CHECK(stopped.status == ExitStatus::interrupted);
  CHECK(stopped.statistics.steps == 0);
  CHECK_FALSE(storing);
  asked = false;
  REQUIRE(resume(file, std::nullopt, options).status == ExitStatus::done);
  REQUIRE(run(problem, {.output = whole}).status == ExitStatus::done);
  CHECK(different_datasets(file, whole) == Names{});
}

TEST_CASE("a replay ends where it is asked to", "[run]") {
  const Folder folder;
  const std::string file = folder / "pendulum.h5";
  REQUIRE(run(read_problem("pendulum", std::vector<std::string>{"scheme.until=5"}), {.output = file}).status ==
          ExitStatus::done);
  const record::Reader reader(file);
  const Problem problem = stored_problem(reader);
  const StoredLevels levels(reader, problem);
  Disagreements findings;
  std::atomic<bool> asked = false;
  const Interruptible here(&asked);
  CHECK_NOTHROW(replay(reader, levels, problem, findings));
  asked = true;
  CHECK_THROWS_AS(replay(reader, levels, problem, findings), Interrupted);
  CHECK_THROWS_AS(reproduced_states(reader, levels, problem, 3), Interrupted);
  CHECK(findings.disagreements() == 0);
}
