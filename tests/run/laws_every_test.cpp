// [laws] every: which levels' laws are taken, and that everybody says so.

#include <catch2/catch.hpp>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using rubato::record::Reader;

namespace {

constexpr std::size_t every = 7;
const std::vector<std::string> small = {"grid.x.cells=51", "scheme.until=5"};

std::vector<std::string> with(std::vector<std::string> settings, const std::string& more) {
  settings.push_back(more);
  return settings;
}

/// Those of the run with all laws at every n-th level, or step, and no number elsewhere.
void check_thinned(const std::string& all, const std::string& some, const std::string& path, std::size_t first) {
  INFO(path);
  const std::vector<double> whole = Reader(all).read(path), thinned = Reader(some).read(path);
  REQUIRE(whole.size() == thinned.size());
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const bool taken = (i + first) % every == 0;
    CHECK((taken ? thinned[i] == whole[i] : std::isnan(thinned[i])));
  }
}

}  // namespace

TEST_CASE("laws taken at every n-th level are those of a run that takes all", "[run][lattice]") {
  const Folder folder;
  const std::string all = folder / "all.h5", some = folder / "some.h5";
  const Outcome whole = run_problem("sine-gordon", all, small, true);
  const Outcome thinned = run_problem("sine-gordon", some, with(small, "laws.every=7"), true);
  for (const char* law : {"energy", "momentum", "variational_energy", "multisymplectic"}) {
    check_thinned(all, some, std::string("/laws/") + law + "_max", 1);
    check_thinned(all, some, std::string("/laws/") + law + "_rms", 1);
  }
  for (const char* path : {"/laws/totals/momentum", "/laws/topological_charge"}) {
    check_thinned(all, some, path, 0);
  }
  // What the run shows says of how many steps it is, and the energy law is that of all.
  CHECK(thinned.statistics.law_steps_taken() == whole.statistics.steps / every);
  CHECK(thinned.statistics.energy_deviation() == whole.statistics.energy_deviation());
  CHECK(thinned.statistics.residuals.front().value.count() ==
        51.0 * static_cast<double>(thinned.statistics.law_steps_taken()));
  CHECK_THAT(to_table(thinned), Catch::Contains("of 8 of 56 steps"));
  CHECK_THAT(to_json(thinned), Catch::Contains(R"("laws": {"every": 7, "steps": 8})"));
  CHECK_THAT(to_json(whole), !Catch::Contains(R"("laws")"));
  // Its record says the same.
  const Outcome checked = check(some, {.replay = true});
  CHECK(checked.status == ExitStatus::done);
  CHECK(differences(thinned, checked) == Names{});
}

TEST_CASE("a run that takes laws now and then is resumed bit by bit", "[run][lattice]") {
  for (const char* setting : {"laws.every=7", "laws.every=2", "laws.every=false"}) {
    // Stopped at several distances from a level whose laws are taken.
    for (const double middle : {1.0, 1.15, 1.3, 1.45}) {
      const Folder folder;
      const std::string stopped = folder / "stopped.h5", straight = folder / "whole.h5";
      const std::vector<std::string> settings = {"grid.x.cells=51", setting};
      run_problem("sine-gordon", stopped, with(settings, "scheme.until=" + std::to_string(middle)));
      CHECK(resume(stopped, 3.0, {.threads = 1}).status == ExitStatus::done);
      run_problem("sine-gordon", straight, with(settings, "scheme.until=3"));
      CHECK(different_datasets(stopped, straight) == Names{});
      CHECK(check(stopped).status == ExitStatus::done);
    }
  }
}

TEST_CASE("a record that says of laws what was not taken is found out", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "some.h5";
  const auto finds = [&](const std::string& dataset, std::size_t index, double change) {
    run_problem("sine-gordon", folder / "new.h5", with({"grid.x.cells=51", "scheme.until=1"}, "laws.every=3"));
    std::filesystem::rename(folder / "new.h5", file);
    CHECK(check(file).status == ExitStatus::done);
    falsify(file, dataset, index, change);
    return check(file).status == ExitStatus::contradiction;
  };
  CHECK(finds("/levels/laws", 1, 1.0));
  CHECK(finds("/levels/laws", 3, -1.0));
  CHECK(finds("/laws/energy_max", 2, 1.0));
  CHECK(finds("/laws/totals/momentum", 3, 1.0));
}

TEST_CASE("without laws nothing of them is stored, and tangents are refused", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "none.h5";
  const Outcome outcome = run_problem("sine-gordon", file, with(small, "laws.every=false"));
  CHECK_FALSE(outcome.statistics.has_laws());
  for (const auto& info : Reader(file).datasets()) {
    CHECK_FALSE(info.path.starts_with("/laws/"));
  }
  CHECK(check(file).status == ExitStatus::done);
  CHECK_THROWS_WITH(run_problem("sine-gordon", folder / "t.h5", with(small, "laws.every=false"), true),
                    Catch::Contains("leave out one"));
  CHECK_FALSE(std::filesystem::exists(folder / "t.h5"));
}

TEST_CASE("invariants of an orbit are taken at every n-th level", "[run]") {
  const Folder folder;
  const std::string all = folder / "all.h5", some = folder / "some.h5";
  run_problem("kepler", all, {"scheme.until=2"});
  run_problem("kepler", some, {"scheme.until=2", "laws.every=7"});
  check_thinned(all, some, "/laws/angular_momentum", 0);
  CHECK(Reader(all).read("/levels/energy") == Reader(some).read("/levels/energy"));
  CHECK(check(some).status == ExitStatus::done);
}

TEST_CASE("[laws] every is refused where it says nothing", "[run]") {
  const auto complaint = [](const std::string& value) {
    try {
      static_cast<void>(read_problem("sine-gordon", std::vector{"laws.every=" + value}));
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK_THAT(complaint("0"), Catch::Contains("write every = false"));
  CHECK_THAT(complaint("true"), Catch::Contains("write every = 1"));
  CHECK_THAT(complaint("-1"), Catch::Contains("at least 1"));
  CHECK_THAT(complaint("2.5"), Catch::Contains("expected an integer"));
  CHECK_THAT(complaint("[1]"), Catch::Contains("every"));
  CHECK(complaint("3").empty());
}
