// What a record of a lattice has of its cells: residuals where [laws] fields asks for them, and with states = false the
// fields that evolve, at the first and the last level.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/record_notes.hpp>
#include <rubato/run/run.hpp>

#include "mailboxes.hpp"
#include "records.hpp"
#include "shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using rubato::record::Reader;

namespace {

const Settings small = {"grid.x.cells=51", "scheme.until=2"};

Settings with(Settings settings, const Settings& more) {
  settings.insert(settings.end(), more.begin(), more.end());
  return settings;
}

/// The datasets in a group, but for the axis.
Names names_in(const std::string& file, const std::string& group) {
  Names names;
  for (const auto& info : Reader(file).datasets()) {
    if (info.path.starts_with(group) && info.dimensions.size() > 1) {
      names.push_back(info.path.substr(group.size()));
    }
  }
  return names;
}

/// As earlier versions stored it.
Outcome run_of_before(const std::string& name, const std::string& file, const Settings& settings) {
  Problem problem = read_problem(name, settings);
  problem.laws.fields = true;
  problem.output.all_fields = true;
  return run(problem, {.output = file, .overwrite = true, .threads = 1});
}

/// Whether `check` finds one number that was changed, and not by its checksum: at its place, or in the step there.
bool finds(const std::string& file, const std::string& dataset, std::size_t index, double change,
           const std::string& found_in = {}) {
  const std::string copy = file + ".altered";
  std::filesystem::copy_file(file, copy, std::filesystem::copy_options::overwrite_existing);
  falsify(copy, dataset, index, change);
  const Outcome outcome = check(copy);
  return outcome.status == ExitStatus::contradiction &&
         std::ranges::any_of(outcome.disagreements, [&](const Disagreement& disagreement) {
           return disagreement.dataset == (found_in.empty() ? dataset : found_in) && disagreement.row.has_value();
         });
}

}  // namespace

TEST_CASE("the residuals of local laws are stored where they are asked for", "[run][lattice]") {
  const auto [name, cells] = GENERATE(
      table<std::string, std::string>({{"sine-gordon", "51"}, {"kdv", "51"}, {"sine-gordon-2d", "9"}, {"nls", "33"}}));
  INFO(name);
  const Folder folder;
  const std::string few = folder / "few.h5", all = folder / "all.h5";
  Settings settings = {"scheme.until=0.1", "grid.x.cells=" + cells};
  if (name == "sine-gordon-2d") {
    settings.push_back("grid.y.cells=" + cells);
  }
  const Outcome without = run_problem(name, few, settings);
  const Outcome with_fields = run_problem(name, all, with(settings, {"laws.fields=true"}));
  CHECK(names_in(few, "/laws/fields/").empty());
  const Names laws = names_in(all, "/laws/fields/");
  REQUIRE(laws.size() >= 2);
  // The figures are the same, and those of the cells.
  CHECK(differences(without, with_fields) == Names{});
  const Reader one(few), other(all);
  for (const std::string& law : laws) {
    const std::vector<double> max = other.read("/laws/" + law + "_max");
    CHECK(one.read("/laws/" + law + "_max") == max);
    double largest = 0.0;
    for (const double residual : other.read("/laws/fields/" + law, 1, 1)) {
      largest = std::max(largest, std::abs(residual));
    }
    CHECK(largest == max.front());
  }
  CHECK(check(few).status == ExitStatus::done);
  CHECK(check(all).status == ExitStatus::done);
  CHECK(check(all, {.replay = true}).status == ExitStatus::done);
  CHECK(finds(all, "/laws/fields/" + laws.front(), other.info("/laws/fields/" + laws.front()).row_size() + 3, 1e-3));
  CHECK(finds(few, "/laws/" + laws.front() + "_max", 0, 1e-3));
  // Continued, either has what it began with.
  for (const std::string& file : {few, all}) {
    CHECK(resume(file, 0.2, {.threads = 1}).complete);
    CHECK(names_in(file, "/laws/fields/") == (file == few ? Names{} : laws));
    CHECK(check(file).status == ExitStatus::done);
  }
}

TEST_CASE("without states a record has the fields that evolve, at the first and the last level", "[run][lattice]") {
  struct Case {
    std::string name;
    Settings settings;
    Names stored;
  };
  // w of sine-Gordon is u_x, v of KdV too; w of that exists in the middle of steps.
  const Case c = GENERATE(Case{"sine-gordon", {"output.every=3"}, {"u", "v"}},
                          Case{"sine-gordon", {"exact.w=x", "laws.every=2"}, {"u", "v", "w"}},
                          Case{"sine-gordon", {"scheme.lagrangian=splitting", "levels.every=5"}, {"u", "v"}},
                          Case{"kdv", {"laws.every=false"}, {"phi", "u"}});
  INFO(c.name << ", " << c.settings.front());
  const Folder folder;
  const std::string file = folder / "ends.h5";
  const auto problem = [&](const std::string& until) {
    return read_problem(c.name, with(c.settings, {"grid.x.cells=51", "output.states=false", "scheme.until=" + until}));
  };
  const Outcome outcome = run(problem("0.3"), {.output = file, .threads = 1});
  CHECK(outcome.status == ExitStatus::done);
  CHECK(names_in(file, "/states/") == c.stored);
  CHECK(Reader(file).rows("/states/u") == 2);
  CHECK(Reader(file).read("/states/level").back() == static_cast<double>(outcome.statistics.steps));
  const Outcome sound = check(file), replayed = check(file, {.replay = true});
  CHECK(sound.status == ExitStatus::done);
  CHECK(replayed.status == ExitStatus::done);
  CHECK(differences(outcome, sound) == Names{});
  REQUIRE(sound.warnings.size() >= 1);
  CHECK_THAT(sound.warnings.back(), Catch::Contains("the last state of the fields that evolve") &&
                                        Catch::Contains("0 of " + std::to_string(outcome.statistics.steps)));
  // Both states and what is reported on their levels.
  CHECK(finds(file, "/states/u", 7, 1e-6));
  CHECK(finds(file, "/states/u", 51 + 7, 1e-6));
  CHECK(finds(file, "/levels/node_energy", 0, 1e-6));
  // Those who draw it get the size of rounding errors of what it has.
  const RecordNotes notes = notes_on(Reader(file));
  CHECK(notes.rounding.at("/levels/energy") > 0.0);
  CHECK(notes.rounding.at("/levels/energy") < 1e-10);
  // Continued it is the one that never stopped.
  const std::string straight = folder / "straight.h5";
  static_cast<void>(run(problem("0.5"), {.output = straight, .threads = 1}));
  CHECK(resume(file, 0.5, {.threads = 1}).status == ExitStatus::done);
  CHECK(different_datasets(file, straight) == Names{});
  CHECK(check(file).status == ExitStatus::done);
}

TEST_CASE("records of before have more, and are checked and continued as they are", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "before.h5", straight = folder / "straight.h5";
  for (const Settings& more : {Settings{}, Settings{"output.states=false"}, Settings{"output.every=4"}}) {
    const Settings settings = with(small, more);
    const Outcome outcome = run_of_before("sine-gordon", file, settings);
    CHECK(names_in(file, "/laws/fields/") == Names{"energy", "momentum"});
    CHECK(names_in(file, "/states/").size() == (more.empty() ? 3 : 6));
    const Outcome sound = check(file);
    CHECK(sound.status == ExitStatus::done);
    CHECK(differences(outcome, sound) == Names{});
    const std::size_t last = Reader(file).rows("/states/t") - 1;
    CHECK(finds(file, "/laws/fields/energy", 51 * last + 7, 1e-3));
    CHECK(finds(file, "/states/w", 51 * last + 7, 1e-6));
    if (!more.empty()) {
      CHECK(finds(file, "/states/previous/v", 51 * last + 7, 1e-6, "/states"));
    }
    static_cast<void>(run_of_before("sine-gordon", straight, with(settings, {"scheme.until=3"})));
    CHECK(resume(file, 3.0, {.threads = 1}).status == ExitStatus::done);
    CHECK(different_datasets(file, straight) == Names{});
    CHECK(check(file, {.replay = true}).status == ExitStatus::done);
  }
}

TEST_CASE("ranks store and check the fields that are asked for", "[run][lattice]") {
  const Folder folder;
  for (const Settings& more : {Settings{"laws.fields=true"}, Settings{"output.states=false"}}) {
    INFO(more.front());
    const Problem wave = wave_on_torus(13, 11, with({"scheme.until=0.11"}, more));
    const Outcome one = run(wave, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
    const Outcome two = with_ranks(2, [&](auto& rank) { return run(wave, on(rank, folder / "two.h5")); });
    CHECK(two.status == ExitStatus::done);
    CHECK(different_on_ranks(folder / "one.h5", folder / "two.h5") == Names{});
    CHECK(differences_on_ranks(one, two) == Names{});
    const auto by_two = [&](const std::string& file) {
      return with_ranks(2, [&](auto& rank) { return check(file, {.ranks = &rank}); });
    };
    CHECK(to_json(by_two(folder / "one.h5")) == to_json(check(folder / "one.h5")));
    falsify(folder / "one.h5", "/states/u", 13 * 11 + 5, 1e-3);
    CHECK(by_two(folder / "one.h5").status == ExitStatus::contradiction);
  }
  // As earlier versions stored it, which the other ranks hear of.
  Problem before = wave_on_torus(13, 11, {"scheme.until=0.11", "output.states=false"});
  before.laws.fields = before.output.all_fields = true;
  static_cast<void>(run(before, {.output = folder / "before.h5", .threads = 1}));
  const Outcome sound = check(folder / "before.h5");
  CHECK(sound.status == ExitStatus::done);
  CHECK(to_json(with_ranks(2, [&](auto& rank) { return check(folder / "before.h5", {.ranks = &rank}); })) ==
        to_json(sound));
}

TEST_CASE("[laws] fields is refused where there is nothing to store", "[run]") {
  const auto complaint = [](const std::string& name, const Settings& settings) {
    try {
      static_cast<void>(read_problem(name, settings));
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK_THAT(complaint("kepler", {"laws.fields=true"}), Catch::Contains("an orbit has no cells"));
  CHECK_THAT(complaint("sine-gordon", {"laws.fields=true", "laws.every=false"}),
             Catch::Contains("every = false takes none"));
  CHECK_THAT(complaint("sine-gordon", {"laws.fields=1"}), Catch::Contains("true or false"));
  CHECK(complaint("kepler", {"laws.fields=false"}).empty());
  CHECK(complaint("sine-gordon", {"laws.fields=true", "laws.every=3"}).empty());
}
