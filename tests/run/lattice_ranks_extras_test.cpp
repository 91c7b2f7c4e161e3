// What ranks share of a lattice beside its levels and laws: tangent solutions, potentials that differ from place to
// place and in time, events, output between levels, first steps that are chosen, records to begin from. Ranks are
// threads, as in lattice_ranks_test.cpp.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>

#include "run/mailboxes.hpp"
#include "run/problem_texts.hpp"
#include "run/records.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

/// A record that is falsified is found out by ranks as by one process.
void check_found_by_ranks(const std::string& file, const std::string& dataset, std::size_t index, double change) {
  INFO(dataset);
  falsify(file, dataset, index, change);
  const Outcome one = check(file);
  CHECK(one.status == ExitStatus::contradiction);
  for (const int size : {2, 3}) {
    const Outcome all = with_ranks(size, [&](auto& rank) { return check(file, {.ranks = &rank}); });
    CHECK(to_json(all) == to_json(one));
    CHECK(all.message == one.message);
  }
}

/// The largest difference of two datasets, by the largest value of the first.
double relative_difference(const std::string& a, const std::string& b, const std::string& path) {
  const std::vector<double> first = record::Reader(a).read(path), second = record::Reader(b).read(path);
  if (first.size() != second.size()) {
    return std::numeric_limits<double>::infinity();
  }
  double largest = 0.0, scale = 0.0;
  for (std::size_t i = 0; i < first.size(); ++i) {
    largest = std::max(largest, std::abs(first[i] - second[i]));
    scale = std::max(scale, std::abs(first[i]));
  }
  return largest / scale;
}

}  // namespace

namespace {

/// What ranks share to rounding.
const std::vector<Settings> schemes_with_transforms = {{"scheme.lagrangian=splitting", "scheme.space=differences"},
                                                       {"scheme.lagrangian=splitting"},
                                                       {"scheme.lagrangian=fourier", "scheme.stages=2"},
                                                       {"scheme.lagrangian=fourier"},
                                                       {"scheme.lagrangian=box"},
                                                       {"scheme.lagrangian=box", "scheme.stages=2"}};

}  // namespace

namespace {

void check_tangents_of_ranks(const std::string& every, Continued continue_by) {
  const Folder folder;
  SECTION("on a torus and in space") {
    const Settings scheme = GENERATE(Settings{}, Settings{"scheme.lagrangian=leapfrog"},
                                     Settings{"scheme.lagrangian=leapfrog", "scheme.levels=variable"});
    INFO(fmt::format("{}, every {}", fmt::join(scheme, " "), every));
    const Settings settings = joined(scheme, {"output.every=" + every});
    // 9 × 7: parts thinner than their ghosts.
    check_shared_run(
        folder, [&](const Settings& more) { return wave_on_torus(24, 23, joined(settings, more)); }, "0.11", {2, 3},
        true, continue_by);
    check_shared_run(
        folder, [&](const Settings& more) { return wave_on_torus(9, 7, joined(settings, more)); }, "0.11", {3, 7}, true,
        continue_by);
    check_shared_run(
        folder, [&](const Settings& more) { return wave_in_space(joined(settings, more)); }, "0.11", {3}, true,
        continue_by);
  }
  SECTION("on a line, by elimination") {
    const std::string levels = GENERATE("fixed", "variable");
    // KdV has a potential whose mean is held, sine-Gordon a field that is not solved for.
    for (const auto& [name, cells, until] : {std::tuple{"kdv", "257", "0.05"}, std::tuple{"sine-gordon", "301", "0.5"},
                                             std::tuple{"nls", "129", "0.02"}}) {
      INFO(name << ", " << levels << " levels, every " << every);
      check_shared_run(
          folder,
          [&, &name = name, &cells = cells, &until = until](const Settings& more) {
            return line(name, joined({fmt::format("grid.x.cells={}", cells), "scheme.levels=" + levels,
                                      "output.every=" + every, fmt::format("scheme.until={}", until)},
                                     more));
          },
          "0.006", {2, 3}, true, continue_by);
    }
  }
}

}  // namespace

// Where every level is stored they are checked, too.
TEST_CASE("ranks carry tangent solutions along a lattice with the bits of one", "[long]") {
  check_tangents_of_ranks("1", Continued::last);
}

TEST_CASE("ranks carry tangent solutions along a lattice of which few levels are stored, and continue them all",
          "[long]") {
  const std::string every = GENERATE("1", "7");
  check_tangents_of_ranks(every, Continued::all);
}

TEST_CASE("what is wrong with tangent solutions of ranks is seen in their law alone, and found by a check") {
  const Folder folder;
  const std::string scheme = GENERATE("euler-box", "leapfrog");
  const Problem problem = wave_on_torus(40, 37, {"scheme.lagrangian=" + scheme, "output.every=1"});
  const std::string file = folder / "one.h5";
  static_cast<void>(run(problem, {.output = file, .threads = 1, .tangents = true}));
  // On 2 ranks both neighbours are one, and two planes go to it at once: of u, then of each tangent solution.
  Mailboxes tampered(2);
  int found = 0;
  tampered.tamper_with([&found](int from, std::vector<double>& numbers) {
    if (from == 0 && numbers.size() == 2 * 40 && found++ % 3 == 1) {
      for (double& number : numbers) {
        number += 1e-3;
      }
    }
  });
  static_cast<void>(with_ranks(tampered, [&](auto& rank) {
    RunOptions options = on(rank, folder / "all.h5");
    options.tangents = true;
    return run(problem, options);
  }));
  CHECK(found >= 3 * 30);
  const Names different = different_on_ranks(file, folder / "all.h5");
  CAPTURE(different);
  CHECK(std::ranges::find(different, "/laws/multisymplectic_max") != different.end());
  CHECK(std::ranges::all_of(different, [](const std::string& path) {
    return path.starts_with("/laws/multisymplectic") || path.starts_with("/checkpoint");
  }));
  check_found_by_ranks(file, "/laws/multisymplectic_max", 7, 1e-10);
}

TEST_CASE("ranks carry tangent solutions of box schemes along, which keep their law to rounding") {
  const Folder folder;
  const std::string stages = GENERATE("1", "2");
  const std::string every = GENERATE("1", "7");
  const auto make = [&](const std::string& until) {
    return wave_on_torus(
        21, 19, {"scheme.lagrangian=box", "scheme.stages=" + stages, "scheme.until=" + until, "output.every=" + every});
  };
  const auto with_tangents = [](auto& rank, const std::string& file) {
    RunOptions options = on(rank, file);
    options.tangents = true;
    return options;
  };
  const auto law_of = [](const std::string& file) {
    return std::ranges::max(record::Reader(file).read("/laws/multisymplectic_max"));
  };
  const std::string one = folder / "one.h5", all = folder / "all.h5", part = folder / "part.h5";
  static_cast<void>(run(make("0.2"), {.output = one, .threads = 1, .tangents = true}));
  for (const int size : {2, 3}) {
    static_cast<void>(with_ranks(size, [&](auto& rank) { return run(make("0.2"), with_tangents(rank, all)); }));
    // What solves leave of it and rounding are of one size on any number of ranks.
    CHECK(law_of(all) <= 2.0 * law_of(one));
    CHECK(with_ranks(size, [&](auto& rank) { return check(all, {.ranks = &rank}); }).status == ExitStatus::done);
    static_cast<void>(with_ranks(size, [&](auto& rank) { return run(make("0.11"), with_tangents(rank, part)); }));
    static_cast<void>(with_ranks(size, [&](auto& rank) { return resume(part, 0.2, {.threads = 1, .ranks = &rank}); }));
    CHECK(different_on_ranks(all, part) == Names{});
  }
  // The twin: planes of all four fields on their way to a neighbour, each time otherwise: as linear systems see them,
  // which then may not converge, and as tangent solutions have them.
  Mailboxes tampered(3);
  tampered.tamper_with([sent = 0](int, std::vector<double>& numbers) mutable {
    if (numbers.size() == 4 * 21) {
      numbers.front() *= 1.0 + 1e-9 * (++sent % 7);
    }
  });
  const Outcome other = with_ranks(tampered, [&](auto& rank) { return run(make("0.2"), with_tangents(rank, all)); });
  const bool ended = std::ranges::any_of(
      other.warnings, [](const std::string& warning) { return warning.starts_with("the tangent solutions ended"); });
  CHECK((ended || law_of(all) > 10.0 * law_of(one)));
}

TEST_CASE("tangent solutions that a scheme has not are refused on ranks as on one") {
  const Folder folder;
  for (const Settings& settings :
       {Settings{"scheme.lagrangian=splitting"}, Settings{"scheme.lagrangian=fourier", "scheme.stages=2"}}) {
    Names said;
    for (const int size : {1, 3}) {
      try {
        static_cast<void>(with_ranks(size, [&](auto& rank) {
          RunOptions options = on(rank, folder / "never.h5");
          options.tangents = true;
          return run(wave_on_torus(9, 7, settings), options);
        }));
      } catch (const ProblemError& error) {
        said.emplace_back(error.what());
      }
    }
    REQUIRE(said.size() == 2);
    CHECK(said[0] == said[1]);
    CHECK_THAT(said[0], Contains("tangent solutions are for schemes that have a local law of two of them"));
  }
}

namespace {

/// A medium that differs from place to place, and forces that do in time and do not.
const Settings of_places = {
    "multisymplectic.S=(v^2 - a^2 - b^2)/2 + (1 + 0.3*sin(pi*x/3)*cos(2*pi*(y - 0.3)/6.7))*(1 - cos(u))"};
const Settings of_times = {"multisymplectic.S=(v^2 - a^2 - b^2)/2 + 1 - cos(u) + 0.2*u*sin(pi*x/3)*cos(3*t)"};

}  // namespace

namespace {

void check_shared_places(const std::vector<std::string>& rows_apart, Continued continue_by) {
  const Folder folder;
  SECTION("on a torus") {
    const Settings S = GENERATE(of_places, of_times);
    const Settings scheme = GENERATE(Settings{}, Settings{"scheme.lagrangian=leapfrog"},
                                     Settings{"scheme.lagrangian=leapfrog", "scheme.levels=variable"});
    if (S == of_times && !scheme.empty()) {
      return;  // leapfrog is for wave equations, and time is none
    }
    INFO(fmt::format("{} {}", fmt::join(scheme, " "), S.front()));
    for (const std::string& every : rows_apart) {
      const Settings settings = joined(joined(scheme, S), {"output.every=" + every});
      check_shared_run(
          folder, [&](const Settings& more) { return wave_on_torus(40, 37, joined(settings, more)); }, "0.11", {2, 3},
          false, continue_by);
    }
    check_shared_run(
        folder, [&](const Settings& more) { return wave_on_torus(9, 7, joined(joined(scheme, S), more)); }, "0.11", {7},
        true, continue_by);
    check_found_by_ranks(folder / "one.h5", "/states/u", 9 * 7 + 40, 1e-3);
  }
  SECTION("on a line") {
    const std::string S = GENERATE("v^2/2 - w^2/2 + (1 + 0.3*sin(2*pi*x/40))*(1 - cos(u))",
                                   "v^2/2 - w^2/2 + 1 - cos(u) + 0.1*u*cos(2*pi*x/40)*sin(t)");
    const std::string scheme = GENERATE("box", "euler-box");
    const std::string levels = GENERATE("fixed", "variable");
    if (scheme == "euler-box" && levels == "variable") {
      return;
    }
    INFO(scheme << ", " << levels << " levels, " << S);
    const auto make = [&](const Settings& more) {
      const std::string text = fmt::format(R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "{}"
[grid]
x = {{ from = -20, to = 20, cells = 201 }}
[initial]
u = "sin(2*pi*x/40)"
v = 0
[scheme]
lagrangian = "{}"
levels = "{}"
step = 0.02
until = 0.4
)toml",
                                           S, scheme, levels);
      return parse_problem(text, "line.toml", more);
    };
    // With the time and the work there are five fields, of which tangent solutions are solved for in other chunks.
    const bool other_chunks = scheme == "box" && S.find("sin(t)") != std::string::npos;
    check_shared_run(folder, make, "0.1", {2, 3}, !other_chunks, continue_by);
    check_found_by_ranks(folder / "one.h5", "/states/u", 201 * 3 + 150, 1e-4);
    if (other_chunks) {
      CHECK_THROWS_WITH(with_ranks(2,
                                   [&](auto& rank) {
                                     RunOptions options = on(rank, folder / "never.h5");
                                     options.tangents = true;
                                     return run(make({}), options);
                                   }),
                        Contains("line.toml:13:15") && Contains("in shorter chunks of cells"));
      // Rank 0 checks such a record alone.
      static_cast<void>(
          run(make({}), {.output = folder / "one.h5", .overwrite = true, .threads = 1, .tangents = true}));
      const Outcome checked = with_ranks(2, [&](auto& rank) { return check(folder / "one.h5", {.ranks = &rank}); });
      CHECK(checked.status == ExitStatus::done);
    }
  }
}

}  // namespace

TEST_CASE("ranks share lattices whose S names coordinates, or t, with the bits of one") {
  check_shared_places({"1"}, Continued::last);
}

TEST_CASE("ranks share lattices whose S names coordinates, or t, of which few levels are stored, and continue them all",
          "[long]") {
  check_shared_places({"1", "7"}, Continued::all);
}

TEST_CASE("schemes with transforms share what S says of coordinates and t to rounding", "[long]") {
  const Folder folder;
  const Settings S = GENERATE(of_places, of_times);
  const Settings scheme = GENERATE(from_range(schemes_with_transforms));
  INFO(fmt::format("{} {}", fmt::join(scheme, " "), S.front()));
  // As lattice_ranks_test.cpp has it: thirty steps of some ten transforms and kicks, each rounded by some ε.
  constexpr double allowed = 30 * 10 * 8 * std::numeric_limits<double>::epsilon();
  const Problem problem = wave_on_torus(41, 37, joined(scheme, S));
  static_cast<void>(run(problem, {.output = folder / "one.h5", .threads = 1}));
  for (const int size : {2, 3}) {
    const Outcome all = with_ranks(size, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
    CHECK(all.status == ExitStatus::done);
    CHECK(relative_difference(folder / "one.h5", folder / "all.h5", "/states/u") <= allowed);
    CHECK(with_ranks(size, [&](auto& rank) { return check(folder / "all.h5", {.ranks = &rank}); }).status ==
          ExitStatus::done);
  }
  // The twin: a medium and a force that are moved by 10⁻⁹.
  std::string moved = S.front();
  moved.replace(moved.find("sin(pi*x/3)"), 11, "sin(pi*x/3 + 1e-9)");
  static_cast<void>(run(wave_on_torus(41, 37, joined(scheme, {moved})), {.output = folder / "moved.h5", .threads = 1}));
  CHECK(relative_difference(folder / "one.h5", folder / "moved.h5", "/states/u") > allowed);
}

TEST_CASE("what is said of a medium does not depend on the number of ranks") {
  const Folder folder;
  // A medium that does not repeat; one that is undefined in the planes of one rank; an equation that is ill-posed at
  // some places.
  for (const std::string S : {"(v^2 - a^2 - b^2)/2 + y*(1 - cos(u))", "(v^2 - a^2 - b^2)/2 + u^2*log(y - 6)",
                              "(v^2 - a^2 - b^2)/2 + a^2*cos(2*pi*(y - 0.3)/6.7)"}) {
    INFO(S);
    const Problem problem = wave_on_torus(40, 37, {"multisymplectic.S=" + S, "scheme.until=0.02"});
    const auto said_on = [&](int size) -> Names {
      try {
        const Outcome outcome = with_ranks(size, [&](auto& rank) { return run(problem, on(rank, folder / "a.h5")); });
        return joined({outcome.message.substr(0, outcome.message.find("a.h5"))}, outcome.warnings);
      } catch (const ProblemError& error) {
        return {error.what()};
      }
    };
    const Names one = said_on(1);
    CHECK(one != Names{""});
    CHECK(said_on(3) == one);
  }
}

namespace {

/// A zero of an integral, with quantities; a condition at a point between nodes, whose formula differentiates across
/// planes.
const Settings some_events = {
    R"x(events.slow={crossing="integral(v*sin(pi*x/3)) + 2", quantities=["integral(u^2)", "t"]})x",
    R"x(events.steep={crossing="dy(u) + dx(v) < -0.0985", at={x=0.7, y=5.1}, quantities=["u", "dy(b)"]})x"};
/// Times between levels, a field, a number of integrals, and one at a point.
const Settings some_output = {"output.interval=0.037", "output.quantities.power=v*b",
                              "output.quantities.mean=integral(u*dy(b))/integral(1)",
                              R"x(output.quantities.here={formula="dy(u)*v", at={x=0.7, y=5.1}})x"};
const Settings levels_output = {"output.quantities.power=v*b", "output.quantities.mean=integral(u)"};

}  // namespace

namespace {

void check_shared_events(const std::vector<std::string>& rows_apart, Continued continue_by) {
  const Folder folder;
  const Settings scheme = GENERATE(Settings{}, Settings{"scheme.lagrangian=leapfrog", "scheme.levels=variable"});
  SECTION("events") {
    for (const std::string& every : rows_apart) {
      INFO(fmt::format("{}, every {}", fmt::join(scheme, " "), every));
      const Settings settings = joined(joined(scheme, some_events), {"output.every=" + every});
      check_shared_run(
          folder, [&](const Settings& more) { return wave_on_torus(24, 23, joined(settings, more)); }, "0.11", {2, 3},
          false, continue_by);
    }
    const record::Reader reader(folder / "one.h5");
    CHECK(reader.rows("/events/slow/t") > 0);
    CHECK(reader.rows("/events/steep/t") > 0);
    // An event that ends the run, at all ranks.
    check_shared_run(
        folder,
        [&](const Settings& more) {
          Settings all = joined({R"x(events.end={crossing="integral(v^2) > 51", stop=true})x"}, scheme);
          return wave_on_torus(9, 7, joined(all, more));
        },
        "0.02", {3, 7}, false, continue_by);
    CHECK(record::Reader(folder / "one.h5").rows("/events/end/t") == 1);
  }
  SECTION("output") {
    for (const Settings& output : {some_output, levels_output}) {
      for (const std::string& every : rows_apart) {
        INFO(fmt::format("{}, every {}", fmt::join(scheme, " "), every));
        const Settings settings = joined(joined(scheme, output), {"output.every=" + every});
        check_shared_run(
            folder, [&](const Settings& more) { return wave_on_torus(24, 23, joined(settings, more)); }, "0.11", {2, 3},
            false, continue_by);
      }
    }
    check_shared_run(
        folder, [&](const Settings& more) { return wave_on_torus(9, 7, joined(joined(scheme, some_output), more)); },
        "0.11", {7}, false, continue_by);
  }
}

}  // namespace

TEST_CASE("ranks find the events of a lattice, and tell it between levels, with the bits of one", "[long]") {
  check_shared_events({"1"}, Continued::last);
}

TEST_CASE(
    "ranks find the events of a lattice of which few levels are stored, tell it between levels, and continue them all",
    "[long]") {
  check_shared_events({"1", "7"}, Continued::all);
}

TEST_CASE("as many quantities as a part has nodes are no field") {
  const Folder folder;
  // On 3 ranks 9 nodes each, with copies of three of either neighbour.
  const Settings settings = {"scheme.lagrangian=euler-box",
                             "scheme.levels=fixed",
                             "scheme.step=0.02",
                             "scheme.until=0.2",
                             "grid.x.cells=9",
                             R"(verdict.accept=["spectrum"])",
                             R"x(events.early={crossing="t - 0.05", at={x=1}, )x"
                             R"x(quantities=["1", "2", "3", "4", "5", "6", "7", "u", "integral(v)"]})x"};
  check_shared_run(folder, [&](const Settings& more) { return read_problem("sine-gordon", joined(settings, more)); },
                   "0.1", {3});
  const Problem problem = read_problem("sine-gordon", settings);
  const grids::Ghosts ghosts = make_method(problem)->ghosts(make_system(problem));
  CHECK(9 / 3 + ghosts.before + ghosts.after == problem.events.front().quantities.size());
}

TEST_CASE("ranks find events of a line, and tell it between levels, with the bits of one") {
  const Folder folder;
  const std::string levels = GENERATE("fixed", "variable");
  const Settings settings = {"grid.x.cells=257",
                             "scheme.levels=" + levels,
                             "scheme.until=0.05",
                             "output.every=1",
                             "output.interval=0.0071",
                             "output.quantities.power=u*dx(u)",
                             R"x(output.quantities.here={formula="dx(u)", at={x=1.2345}})x",
                             R"x(events.peak={crossing="dx(u)", at={x=3.3}, quantities=["u", "integral(u^3)"]})x",
                             R"x(events.late="t - 0.031")x"};
  check_shared_run(folder, [&](const Settings& more) { return line("kdv", joined(settings, more)); }, "0.02",
                   {2, 3, 7});
  CHECK(record::Reader(folder / "one.h5").rows("/events/late/t") == 1);
}

TEST_CASE("what ranks tell of events and between levels is checked by ranks") {
  const Folder folder;
  const std::string file = folder / "told.h5";
  const Problem problem = wave_on_torus(13, 11, joined(joined(some_events, some_output), {"output.every=1"}));
  constexpr std::size_t nodes = 13 * 11;
  for (const auto& [dataset, index, change] : {std::tuple{"/output/u", 3 * nodes + 140, 1e-6},
                                               {"/output/quantities/power", 2 * nodes + 5, 1e-6},
                                               {"/output/quantities/mean", std::size_t{4}, 1e-8},
                                               {"/output/quantities/here", std::size_t{4}, 1e-6},
                                               {"/output/t", std::size_t{2}, 1e-9},
                                               {"/events/slow/t", std::size_t{0}, 1e-6},
                                               {"/events/slow/quantities", std::size_t{1}, 1e-6},
                                               {"/events/steep/missed", std::size_t{7}, 1.0}}) {
    static_cast<void>(run(problem, {.output = file, .overwrite = true, .threads = 1}));
    check_found_by_ranks(file, dataset, index, change);
  }
  // The twin: what goes on from rank to rank to a value at a point, which does not touch the levels.
  static_cast<void>(run(problem, {.output = folder / "one.h5", .threads = 1}));
  Mailboxes at_points(3);
  at_points.tamper_with([](int from, std::vector<double>& numbers) {
    if (from == 1 && numbers.size() == 1) {  // one number that is no order goes to rank 2 in turn, and to none else
      numbers.front() *= 1.0 + 1e-9;
    }
  });
  static_cast<void>(with_ranks(at_points, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); }));
  const Names different = different_on_ranks(folder / "one.h5", folder / "all.h5");
  CHECK(std::ranges::find(different, "/output/quantities/here") != different.end());
  CHECK(std::ranges::find(different, "/states/u") == different.end());
}

TEST_CASE("schemes with transforms share events and output to rounding", "[long]") {
  const Folder folder;
  const Settings scheme = GENERATE(from_range(schemes_with_transforms));
  INFO(fmt::format("{}", fmt::join(scheme, " ")));
  // Thirty steps of some ten transforms and kicks, each rounded by some ε; and derivatives, twice of wave number 20 at
  // most.
  const Settings reported = joined(some_events, some_output);
  constexpr double allowed = 400 * 30 * 10 * 8 * std::numeric_limits<double>::epsilon();
  const Problem problem =
      wave_on_torus(25, 23, joined(joined(scheme, {"output.every=1", "scheme.until=0.15"}), reported));
  const std::string one = folder / "one.h5", all = folder / "all.h5";
  static_cast<void>(run(problem, {.output = one, .threads = 1}));
  const auto apart = [&](const std::string& file) {
    Names paths;
    for (const std::string path : {"/output/u", "/output/quantities/power", "/output/quantities/mean",
                                   "/output/quantities/here", "/events/slow/t", "/events/steep/quantities"}) {
      if (!(relative_difference(one, file, path) <= allowed)) {
        paths.push_back(path);
      }
    }
    return paths;
  };
  for (const int size : {2, 3}) {
    CHECK(with_ranks(size, [&](auto& rank) { return run(problem, on(rank, all)); }).status == ExitStatus::done);
    CHECK(apart(all) == Names{});
    CHECK(with_ranks(size, [&](auto& rank) { return check(all, {.ranks = &rank}); }).status == ExitStatus::done);
  }
  // The twin: a point a little beside.
  std::string beside = some_output.back();
  beside.replace(beside.find("0.7"), 3, "0.70001");
  static_cast<void>(run(wave_on_torus(25, 23, joined(joined(scheme, reported), {"scheme.until=0.15", beside})),
                        {.output = folder / "beside.h5", .threads = 1}));
  CHECK(apart(folder / "beside.h5") == Names{"/output/quantities/here"});
}

TEST_CASE("ranks choose a first step together, the one that one process would") {
  const Folder folder;
  const Settings scheme = GENERATE(Settings{}, Settings{"scheme.lagrangian=leapfrog", "scheme.levels=variable"});
  INFO(fmt::format("{}", fmt::join(scheme, " ")));
  const Settings settings =
      joined(scheme, {"scheme.step=auto", "scheme.energy_tolerance=2e-2", "output.interval=0.05"});
  check_shared_run(folder, [&](const Settings& more) { return wave_on_torus(24, 23, joined(settings, more)); }, "0.11",
                   {2, 3});
}

TEST_CASE("ranks choose the first step of a line together") {
  const Folder folder;
  const std::string levels = GENERATE("fixed", "variable");
  const Settings settings = {"grid.x.cells=129", "scheme.step=auto", "scheme.energy_tolerance=1e-4",
                             "scheme.levels=" + levels, "scheme.until=0.05"};
  check_shared_run(folder, [&](const Settings& more) { return line("kdv", joined(settings, more)); }, "0.02", {2, 3});
}

TEST_CASE("ranks begin from a record that rank 0 reads") {
  const Folder folder;
  const std::string old = folder / "old.h5", small = folder / "small.h5";
  static_cast<void>(run(wave_on_torus(24, 23, {"scheme.until=0.1"}), {.output = old, .threads = 1}));
  static_cast<void>(run(wave_on_torus(15, 14, {"scheme.until=0.1"}), {.output = small, .threads = 1}));
  const auto from = [&](const std::string& file, Settings more) {
    std::string text = wave_on_torus(24, 23).text;
    const std::size_t begin = text.find("[initial]") + 10, end = text.find("\n[", begin);
    text.replace(begin, end - begin, fmt::format("from = \"{}\"\nt = 0\n", file));
    return parse_problem(text, "torus.toml", more);
  };
  const Settings scheme = GENERATE(Settings{}, Settings{"scheme.lagrangian=leapfrog", "scheme.levels=variable"});
  // Of as many cells, and of fewer, by waves; and a field that is given anew.
  for (const std::string& file : {old, small}) {
    check_shared_run(folder, [&](const Settings& more) { return from(file, joined(scheme, more)); }, "0.11", {2, 3});
  }
  check_shared_run(folder,
                   [&](const Settings& more) { return from(small, joined(joined(scheme, {"initial.v=dy(u)"}), more)); },
                   "0.11", {3});
  // The twin: of what rank 0 hands out.
  Mailboxes tampered(2);
  tampered.tamper_with([sent = 0](int from_rank, std::vector<double>& numbers) mutable {
    if (from_rank == 0 && numbers.size() == 24 * 11 && ++sent == 1) {
      numbers.back() += 1e-12;
    }
  });
  static_cast<void>(
      with_ranks(tampered, [&](auto& rank) { return run(from(old, scheme), on(rank, folder / "all.h5")); }));
  static_cast<void>(run(from(old, scheme), {.output = folder / "one.h5", .overwrite = true, .threads = 1}));
  CHECK_FALSE(different_on_ranks(folder / "one.h5", folder / "all.h5").empty());
  // What cannot be read is said once.
  CHECK_THROWS_WITH(with_ranks(2,
                               [&](auto& rank) {
                                 const Problem problem = from(old, {"grid.x.to=6"});
                                 return run(problem, on(rank, folder / "never.h5"));
                               }),
                    Contains("only the number of cells may differ"));
  CHECK_FALSE(std::filesystem::exists(folder / "never.h5"));
}
