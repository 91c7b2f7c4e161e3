// [levels] every: a row of every n-th level, and figures of all levels.

#include <catch2/catch.hpp>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/figures/stored.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using rubato::record::Reader;

namespace {

using Settings = std::vector<std::string>;

Settings with(Settings settings, const Settings& more) {
  settings.insert(settings.end(), more.begin(), more.end());
  return settings;
}

const Settings orbit = {"scheme.until=4", "events.far=x", "output.quantities.r=x^2+y^2"};
const Settings lattice = {"grid.x.cells=51", "scheme.until=4.9"};

constexpr std::size_t every = 7;

/// Numbers of the levels with a row, or of the steps that end there.
std::vector<std::size_t> rows_of(std::size_t last, bool of_steps) {
  std::vector<std::size_t> numbers;
  for (std::size_t level = of_steps ? every : 0; level <= last; level += every) {
    numbers.push_back(level);
  }
  if (last % every != 0) {
    numbers.push_back(last);
  }
  return numbers;
}

void check_rows(const std::string& all, const std::string& some, std::size_t last) {
  const Reader whole(all), thinned(some);
  for (const record::DatasetInfo& info : thinned.datasets()) {
    const bool of_rows =
        info.path.starts_with("/levels/") || (info.path.starts_with("/laws/") && info.shape.size() == 1);
    if (!of_rows || !info.grows || info.path.starts_with("/laws/fields/")) {  // those are of the stored states
      continue;
    }
    INFO(info.path);
    const bool of_steps = info.dimensions.front() == "step";
    const std::vector<double> values = whole.read(info.path), rows = thinned.read(info.path);
    const std::vector<std::size_t> numbers = rows_of(last, of_steps);
    REQUIRE(rows.size() == numbers.size());
    for (std::size_t row = 0; row < rows.size(); ++row) {
      const double expected = values[numbers[row] - (of_steps ? 1 : 0)];
      CHECK((rows[row] == expected || (rows[row] != rows[row] && expected != expected)));
    }
  }
}

figures::Names names_of(const figures::Statistics& statistics) {
  figures::Names names;
  const auto add = [](const auto& list, std::vector<std::string>& to) {
    for (const auto& [name, value] : list) {
      to.push_back(name);
    }
  };
  add(statistics.invariants, names.invariants);
  add(statistics.totals, names.totals);
  add(statistics.residuals, names.residuals);
  add(statistics.events, names.events);
  return names;
}

}  // namespace

TEST_CASE("a thinned record has rows of a complete one, and the figures of all levels", "[run]") {
  const Folder folder;
  const std::string all = folder / "all.h5", some = folder / "some.h5";
  for (const auto& [name, settings] : {std::pair("kepler", orbit), {"sine-gordon", lattice}}) {
    INFO(name);
    const Outcome whole = run_problem(name, all, with(settings, {"levels.every=1"}));
    const Outcome thinned = run_problem(name, some, with(settings, {"levels.every=7"}));
    REQUIRE(whole.statistics.steps % every != 0);
    check_rows(all, some, whole.statistics.steps);
    CHECK(differences(whole, thinned) == Names{});
    // check, report and compare have the figures of the run.
    const Outcome checked = check(some);
    CHECK(checked.status == ExitStatus::done);
    CHECK(differences(whole, checked) == Names{});
    CHECK(check(some, {.replay = true}).status == ExitStatus::done);
    const Reader reader(some);
    const figures::Names names = names_of(whole.statistics);
    const figures::Statistics stored = figures::stored_statistics(reader, names);
    CHECK(stored.h.min == whole.statistics.h.min);
    CHECK(stored.node_energy.max() == whole.statistics.node_energy.max());
    CHECK(stored.all_iterations == whole.statistics.all_iterations);
    // The twin: the rows alone do not have them.
    const figures::Statistics of_rows = figures::statistics_of_rows(reader, names);
    CHECK(of_rows.node_energy.max() < whole.statistics.node_energy.max());
    CHECK(of_rows.steps < whole.statistics.steps);
  }
}

TEST_CASE("as many levels have rows as have states, unless [levels] says otherwise", "[run]") {
  const Folder folder;
  const std::string file = folder / "r.h5";
  const auto rows = [&](const Settings& settings) {
    run_problem("kepler", file, with({"scheme.until=4"}, settings));
    return std::pair(Reader(file).rows("/levels/t"), Reader(file).rows("/states/t"));
  };
  const auto [levels, states] = rows({"output.every=7"});
  CHECK(levels == states);
  const std::size_t all = rows({"output.every=7", "levels.every=1"}).first;
  CHECK(rows({}) == std::pair(all, all));
  CHECK(rows({"output.every=7", "levels.every=1"}) == std::pair(all, states));
  CHECK(rows({"levels.every=7"}) == std::pair(levels, all));
}

TEST_CASE("a run with thinned levels that passes t = 0 is checked, on orbits and lattices", "[run]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  for (const char* name : {"pendulum", "sine-gordon"}) {
    for (const char* levels : {"fixed", "variable"}) {
      INFO(name << ", " << levels);
      run_problem(name, file,
                  {std::string("scheme.levels=") + levels, "scheme.step=0.1", "initial.t=-3", "output.every=3",
                   "scheme.until=3"});
      CHECK(check(file).status == ExitStatus::done);
      // Levels near 0 differ from those of the steps by roundings of t_0, not of themselves.
      falsify(file, "/states/previous/t", 9, 1e-14);
      CHECK(check(file).status == ExitStatus::contradiction);
    }
  }
}

TEST_CASE("a run with thinned levels is resumed bit by bit", "[run]") {
  for (const auto& [name, settings] : {std::pair("kepler", orbit), {"sine-gordon", lattice}}) {
    for (const Settings& thinning : {Settings{"levels.every=7"}, Settings{"output.every=7"},
                                     Settings{"output.every=7", "levels.every=3"}, Settings{"levels.every=1000000"}}) {
      for (const double middle : {2.0, 2.03, 2.1, 2.2}) {
        INFO(name << ", " << thinning.back() << ", stopped at " << middle);
        const Folder folder;
        const std::string stopped = folder / "stopped.h5", straight = folder / "whole.h5";
        const Settings all = with(settings, thinning);
        run_problem(name, stopped, with(all, {"scheme.until=" + std::to_string(middle)}));
        CHECK(resume(stopped, {}, {.threads = 1}).status == ExitStatus::done);  // adds nothing, and loses nothing
        CHECK(check(stopped).status == ExitStatus::done);
        CHECK(resume(stopped, 3.0, {.threads = 1}).status == ExitStatus::done);
        run_problem(name, straight, with(all, {"scheme.until=3"}));
        CHECK(different_datasets(stopped, straight) == Names{});
        CHECK(check(stopped).status == ExitStatus::done);
      }
    }
  }
}

TEST_CASE("check of a thinned record recomputes what is stored", "[run]") {
  const Folder folder;
  const std::string file = folder / "some.h5";
  for (const Settings& settings :
       {Settings{"levels.every=7"}, Settings{"output.every=7"}, Settings{"output.every=6", "levels.every=4"},
        Settings{"output.interval=0.1", "output.every=5"}, Settings{"output.times=[0.1,1,3.9]", "levels.every=3"},
        Settings{"output.states=false", "levels.every=10"}, Settings{"scheme.levels=fixed", "output.every=9"},
        Settings{"laws.every=3", "levels.every=4"}}) {
    INFO(settings.front());
    run_problem("kepler", file, with(orbit, settings));
    CHECK(check(file).status == ExitStatus::done);
    CHECK(check(file, {.replay = true}).status == ExitStatus::done);
  }
  const auto reason = [&](const std::string& dataset, std::size_t row, double change) {
    run_problem("kepler", folder / "new.h5", with(orbit, {"output.every=7"}));
    std::filesystem::rename(folder / "new.h5", file);
    falsify(file, dataset, row, change);
    const Outcome outcome = check(file);
    std::string text;
    for (const Disagreement& found : outcome.disagreements) {
      text += to_string(found) + "\n";
    }
    return text;
  };
  CHECK_THAT(reason("/levels/node_energy", 2, 1e-10), Catch::Contains("from the state at that level"));
  CHECK_THAT(reason("/levels/energy", 2, 1e-9), Catch::Contains("from the states around the step"));
  CHECK_THAT(reason("/levels/step", 2, 1.0), Catch::Contains("every n-th level"));
  CHECK_THAT(reason("/states/q", 4, 1e-9), Catch::Contains("/states/q"));
  CHECK_THAT(reason("/levels/iterations", 2, 1000.0), Catch::Contains("beyond the statistics of all levels"));
}

TEST_CASE("a run ends where a step without a row has no number", "[run]") {
  const Folder folder;
  const std::string thinned = folder / "some.h5", complete = folder / "all.h5";
  // H = sqrt(1 - q) with q' = 1/2: the formula ends at q = 1, t = 2.
  const std::string text =
      "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"p/2 + sqrt(1 - q)\"\n[initial]\nq = 0\np = 1\n"
      "[scheme]\nlevels = \"fixed\"\nstep = 0.01\nuntil = 5\n";
  const auto ends = [&](const std::string& file, const Settings& settings) {
    return run(parse_problem(text, "test.toml", settings), {.output = file, .overwrite = true, .threads = 1});
  };
  const Outcome few = ends(thinned, {"levels.every=1000", "output.every=1000"}), all = ends(complete, {});
  CHECK(few.status == all.status);
  CHECK(few.status == ExitStatus::failed);
  CHECK(few.statistics.steps == all.statistics.steps);
  CHECK(Reader(thinned).read("/states/t").back() == Reader(complete).read("/states/t").back());
  CHECK(check(thinned).status == ExitStatus::done);
}

TEST_CASE("[levels] every is refused where it says nothing", "[run]") {
  for (const char* value : {"0", "-1", "2.5", "true", "\"off\""}) {
    CHECK_THROWS_AS(read_problem("kepler", Settings{std::string("levels.every=") + value}), ProblemError);
  }
  CHECK(read_problem("kepler", Settings{"output.every=5"}).levels.every == 5);
  CHECK(read_problem("kepler", Settings{"output.every=5", "levels.every=2"}).levels.every == 2);
}

TEST_CASE("a record is the same whether steps are taken one by one or in blocks", "[run]") {
  const Folder folder;
  const std::string single = folder / "single.h5", blocks = folder / "blocks.h5";
  const auto take = [](const std::string& problem, const Settings& settings, const std::string& file, int pause) {
    const Outcome outcome =
        run(read_problem(problem, settings),
            {.output = file, .overwrite = true, .threads = 1, .progress_interval = std::chrono::milliseconds(pause)});
    REQUIRE(outcome.status == ExitStatus::done);
    return outcome;
  };
  const Settings splitting = {"scheme.lagrangian=splitting", "scheme.order=4", "scheme.levels=fixed"};
  for (const Settings& settings :
       {Settings{"levels.every=1"}, Settings{"output.every=7"}, Settings{"output.every=300", "levels.every=11"},
        Settings{"output.interval=0.1", "laws.every=3"}, Settings{"events.far.crossing=x", "events.far.stop=3"}}) {
    INFO(settings.front());
    for (const Settings& scheme : {splitting, Settings{}}) {
      const Settings all = with(with(scheme, {"scheme.until=30", "exact.x=cos(t)"}), settings);
      const Outcome one_by_one = take("kepler", all, single, 0), at_once = take("kepler", all, blocks, 1000);
      CHECK(different_datasets(single, blocks) == Names{});
      CHECK(differences(one_by_one, at_once) == Names{});
    }
  }
  // The twin: the comparison sees one step more.
  static_cast<void>(take("kepler", with(splitting, {"scheme.until=30"}), single, 0));
  static_cast<void>(take("kepler", with(splitting, {"scheme.until=30.01"}), blocks, 1000));
  CHECK(different_datasets(single, blocks) != Names{});
}
