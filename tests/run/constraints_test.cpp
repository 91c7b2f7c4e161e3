// [constraints] of orbits: what a run reports and records of them, its check, resume, and what is refused.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>
#include <rubato/run/solve.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;
using rubato::record::Reader;

namespace {

/// A mass on a rod; `more` are tables, `scheme` entries of [scheme].
std::string rod(const std::string& constraint, const std::string& scheme = "lagrangian = \"splitting\"",
                const std::string& more = "") {
  return "[hamiltonian]\nq = [\"x\", \"y\"]\np = [\"a\", \"b\"]\nH = \"(a^2 + b^2)/2 + y\"\n[constraints]\n" +
         constraint + "\n[initial]\nx = 0.6\ny = -0.8\na = 0.8\nb = 0.6\n[scheme]\n" + scheme +
         "\nstep = 0.1\nuntil = 2\n" + more;
}
const std::string length = "length = \"x^2 + y^2 - 1\"";

std::string refusal(const std::string& text, const std::vector<std::string>& settings = {}) {
  try {
    const Problem problem = parse_problem(text, "text.toml", settings);
    const Folder folder;
    static_cast<void>(run(problem, {.output = folder / "a.h5", .threads = 1}));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

const std::vector<std::pair<std::string, std::vector<std::string>>>& runs() {
  static const std::vector<std::pair<std::string, std::vector<std::string>>> all = {
      {"spherical-pendulum", {"scheme.until=20"}},
      {"spherical-pendulum", {"scheme.until=20", "scheme.composition=kahan-li-6", "scheme.step=0.2"}},
      {"spherical-pendulum", {"scheme.until=20", "scheme.lagrangian=midpoint"}},
      {"double-pendulum-cartesian", {"scheme.until=10"}},
      {"double-pendulum-cartesian", {"scheme.until=10", "scheme.lagrangian=midpoint", "-scheme.stages"}},
      {"double-pendulum-cartesian", {"scheme.until=10", "scheme.lagrangian=lobatto", "output.every=7"}},
      {"rigid-body", {"scheme.until=10"}},
      {"rod-chain", {"scheme.until=2", "laws.every=4"}}};
  return all;
}

}  // namespace

TEST_CASE("constraints are reported, recorded and checked", "[run][constraints]") {
  const Folder folder;
  for (const auto& [name, settings] : runs()) {
    CAPTURE(name, settings);
    const std::string file = folder / "run.h5";
    const Outcome outcome = run_problem(name, file, settings);
    REQUIRE(outcome.status == ExitStatus::done);
    std::size_t constraints = 0;
    for (const auto& [law, size] : outcome.statistics.residuals) {
      constraints += law.starts_with("constraints/") ? 1 : 0;
      CHECK(size.largest() < 1e-14);
    }
    CHECK(constraints == 2 * read_problem(name).hamiltonian()->constraints.size());
    CHECK_THAT(to_json(outcome), Contains("\"constraints\": {\""));
    CHECK_THAT(to_json(outcome), Contains("_dot\": {\"max\""));
    CHECK(check(file).status == ExitStatus::done);
    CHECK(check(file, {.replay = true}).status == ExitStatus::done);

    // The twins: a number that is not that of the states, and a state beside the constraint.
    const std::string& first = outcome.statistics.residuals.front().name;
    falsify(file, "/laws/" + first + "_max", 3, 1e-9);
    falsify(file, "/states/q", 2 * read_problem(name).hamiltonian()->q.size(), 1e-9);
    const Outcome found = check(file);
    CHECK(found.status == ExitStatus::contradiction);
    CHECK(std::ranges::any_of(found.disagreements,
                              [&](const Disagreement& one) { return one.dataset == "/laws/" + first + "_max"; }));
    CHECK(std::ranges::any_of(found.disagreements,
                              [](const Disagreement& one) { return one.dataset.starts_with("/states/"); }));
  }
}

TEST_CASE("a resumed run with constraints has the bits of one that never stopped", "[run][constraints]") {
  const Folder folder;
  for (auto [name, settings] : runs()) {
    CAPTURE(name, settings);
    const std::string whole = folder / "whole.h5", parts = folder / "parts.h5";
    settings.emplace_back("output.interval=0.3");
    if (read_problem(name).scheme.levels == Levels::variable) {  // one that does not depend on the length of the run
      settings.emplace_back("scheme.step_potential={kappa=1.2,p=8}");
    }
    run_problem(name, whole, settings);
    const double until = read_problem(name, settings).scheme.until;
    settings.push_back("scheme.until=" + std::to_string(until / 2));
    run_problem(name, parts, settings);
    REQUIRE(resume(parts, until, {.threads = 1}).status == ExitStatus::done);
    const Names different = different_datasets(whole, parts);
    CHECK(std::ranges::count_if(different, [](const std::string& path) { return path.starts_with("/states"); }) == 0);
  }
}

TEST_CASE("the double pendulum in Cartesian coordinates is that in angles", "[run][constraints]") {
  // Gauss with 3 and with 6 stages to t = 5, before chaos: what is left is of order h⁶ of both.
  const Folder folder;
  const auto end_of = [&](const std::string& name, std::vector<std::string> settings) {
    for (const char* more : {"scheme.levels=fixed", "scheme.until=5", "scheme.stages=6", "scheme.step=0.05"}) {
      settings.emplace_back(more);
    }
    const std::string file = folder / "end.h5";
    run_problem(name, file, settings);
    return last_row(Reader(file), "/states/q");
  };
  const std::vector<double> angles = end_of("double-pendulum", {}), places = end_of("double-pendulum-cartesian", {});
  const double x = std::sin(angles[0]), y = -std::cos(angles[0]);
  const std::vector<double> expected = {x, y, x + std::sin(angles[1]), y - std::cos(angles[1])};
  CHECK(largest_distance(places, expected) < 1e-11);
  // The twin: another rod.
  CHECK(largest_distance(end_of("double-pendulum-cartesian",
                                {"constraints.second=\"(x2 - x1)^2 + (y2 - y1)^2 - 1 + 1e-6*(x2 - x1)*(y2 - y1)\""}),
                         expected) > 1e-8);
}

TEST_CASE("events, ensembles and a catalogue's system have constraints", "[run][constraints]") {
  const Folder folder;
  const Outcome events = run_problem(
      "spherical-pendulum", folder / "a.h5",
      {"scheme.until=20", "events={low=\"z + 0.8\"}", "output.quantities={l=\"x^2+y^2+z^2\"}", "output.interval=0.37"});
  CHECK(events.statistics.events.front().value.count > 3);
  for (const double l : Reader(folder / "a.h5").read("/output/quantities/l")) {
    CHECK(std::abs(l - 1.0) < 1e-14);  // dense output is a step of the scheme
  }
  CHECK(check(folder / "a.h5").status == ExitStatus::done);

  const std::string text = rod(length, "lagrangian = \"splitting\"\nlevels = \"fixed\"",
                               "[ensemble]\ngrid = { parameters.g = [1, 2, 3, 4, 5, 6] }\n[parameters]\ng = 1\n");
  const Problem ensemble = parse_problem(text, "text.toml", {{"hamiltonian.H=(a^2 + b^2)/2 + g*y"}});
  const EnsembleOutcome outcome = run_ensemble(ensemble, {.output = folder / "e.h5", .threads = 1});
  CHECK(outcome.status == ExitStatus::done);
  CHECK_THAT(to_json(outcome), Contains("length"));
  // So many members on fixed levels would go side by side, which constraints do not: each keeps its length.
  const auto found =
      std::ranges::find_if(outcome.summary, [](const auto& figure) { return figure.name == "constraints/length/max"; });
  REQUIRE(found != outcome.summary.end());
  const auto place = static_cast<std::size_t>(found - outcome.summary.begin());
  for (const std::vector<double>& figures : outcome.figures) {
    CHECK(figures[place] < 1e-14);
  }

  const Problem from = parse_problem(
      "[hamiltonian]\nsystem = \"spherical-pendulum\"\n[initial]\nx = 1\ny = 0\nz = 0\nu = 0\nv = 0\nw = 0\n"
      "[scheme]\nlagrangian = \"splitting\"\nstep = 0.1\nuntil = 1\n",
      "text.toml");
  CHECK(from.hamiltonian()->constraints.size() == 1);
}

TEST_CASE("derivatives by a parameter go along the constraints", "[run][constraints]") {
  const Folder folder;
  const std::string file = folder / "by.h5";
  const auto run_with = [&](const std::string& g, const std::string& scheme) {
    const std::string text = rod(length, scheme + "\nlevels = \"fixed\"", "[parameters]\ng = 1\n");
    const std::vector<std::string> settings = {"hamiltonian.H=(a^2 + b^2)/2 + g*y", "parameters.g=" + g};
    static_cast<void>(
        run(parse_problem(text, "text.toml", settings), {.output = file, .overwrite = true, .threads = 1}));
    std::vector<double> end = last_row(Reader(file), "/states/q");
    const std::vector<double> p = last_row(Reader(file), "/states/p");
    end.insert(end.end(), p.begin(), p.end());
    return end;
  };
  for (const std::string scheme : {"lagrangian = \"splitting\"", "lagrangian = \"midpoint\""}) {
    CAPTURE(scheme);
    run_with("1", scheme + "\ntangents = { parameters = [\"g\"] }");
    const std::vector<double> by_g = last_row(Reader(file), "/tangents/sensitivities");
    REQUIRE(by_g.size() == 4);
    CHECK(check(file).status == ExitStatus::done);
    const std::vector<double> above = run_with("1.00001", scheme), below = run_with("0.99999", scheme);
    for (std::size_t i = 0; i < 4; ++i) {
      CHECK(by_g[i] == Approx((above[i] - below[i]) / 2e-5).margin(1e-8));    // third derivatives of some tens
      CHECK(by_g[i] != Approx((above[i] - below[i]) / 2.1e-5).margin(1e-4));  // the twin
    }
  }
}

TEST_CASE("exponents of the double pendulum do not depend on its coordinates", "[run][constraints]") {
  // A chaotic orbit, whose two integrations part: exponents agree as far as those of any two parts of it.
  const Folder folder;
  const auto exponents_of = [&](const std::string& name) {
    const std::vector<std::string> settings = {"scheme.levels=fixed", "scheme.until=1000", "scheme.tangents=\"all\"",
                                               "scheme.step=0.05",    "scheme.stages=4",   "output.every=1000"};
    const Outcome outcome = run_problem(name, folder / "exponents.h5", settings);
    CHECK(outcome.statistics.tangents.defect.largest() < 1e-13);
    std::vector<double> exponents;
    for (std::size_t i = 0; i < 4; ++i) {
      exponents.push_back(outcome.statistics.exponent(i));
    }
    return exponents;
  };
  const std::vector<double> angles = exponents_of("double-pendulum"),
                            places = exponents_of("double-pendulum-cartesian");
  CHECK(places[0] > 0.03);
  CHECK(places[0] == Approx(angles[0]).epsilon(0.15));
  // The volume of phase space stays; in Cartesian coordinates to what a bounded factor makes of it.
  CHECK(std::abs(places[0] + places[1] + places[2] + places[3]) < 1e-2);
}

TEST_CASE("[solve] finds orbits with constraints, and their check", "[run][constraints]") {
  const Folder folder;
  const std::string file = folder / "solved.h5";
  const auto solved = [&](const std::string& text, const std::vector<std::string>& settings = {}) {
    SolveOutcome outcome =
        solve_problem(parse_problem(text, "text.toml", settings), {.output = file, .overwrite = true});
    INFO(outcome.message);
    REQUIRE(outcome.status == ExitStatus::done);
    CHECK(check(file).status == ExitStatus::done);
    return outcome;
  };
  // From rest to a place in a given time.
  const std::string rod_to = rod(length, "", "[solve]\nends = { a_0 = 0, x_1 = 0.3 }\ntime = 2.2\n");
  const std::vector<std::string> guess = {"initial.x=-0.96", "initial.y=-0.28", "initial.a=0", "initial.b=0",
                                          "scheme.until=2.2"};
  const auto end_of = [&](const std::vector<std::string>& more) {
    std::vector<std::string> settings = guess;
    settings.insert(settings.end(), more.begin(), more.end());
    solved(rod_to, settings);
    return last_row(Reader(file), "/states/p");
  };
  // The same in the angle, where x = sin q and (a, b) = p (cos q, sin q).
  const auto end_in_angle = [&](double h) {
    const std::string text =
        "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"p^2/2 - cos(q)\"\n[initial]\nq = -1.287\np = "
        "0\n[solve]\nends = [\"p_0 = 0\", \"sin(q_1) = 0.3\"]\ntime = 2.2\n[scheme]\nlevels = "
        "\"fixed\"\nlagrangian = \"gauss\"\nstages = 4\nuntil = 2.2\nstep = " +
        std::to_string(h) + "\n";
    solved(text);
    const double q = last_row(Reader(file), "/states/q")[0], p = last_row(Reader(file), "/states/p")[0];
    return std::vector<double>{p * std::cos(q), p * std::sin(q)};
  };
  const std::vector<double> exact = end_in_angle(0.05);
  CHECK(largest_distance(end_of({"scheme.levels=fixed", "scheme.lagrangian=splitting", "scheme.composition=kahan-li-8",
                                 "scheme.step=0.1"}),
                         exact) < 1e-9);
  for (const std::string levels : {"fixed", "variable"}) {
    const double coarse = largest_distance(end_of({"scheme.levels=" + levels, "scheme.step=0.1"}), exact),
                 fine = largest_distance(end_of({"scheme.levels=" + levels, "scheme.step=0.05"}), exact);
    CAPTURE(levels, coarse, fine);
    CHECK(std::abs(std::log2(coarse / fine) - 2.0) < 0.3);
  }

  // A branch: the rod grows.
  const SolveOutcome branch = solved(
      rod("length = \"x^2 + y^2 - l^2\"", "levels = \"fixed\"",
          "[parameters]\nl = 1\n[solve]\nends = { a_0 = 0, x_1 = 0.3 }\ntime = 2.2\ncontinue = { parameter = \"l\", "
          "to = 1.2 }\n"),
      guess);
  const std::vector<double> place = last_row(Reader(file), "/states/q");
  CHECK(std::hypot(place[0], place[1]) == Approx(1.2).epsilon(1e-12));
  CHECK(branch.branch.size() > 2);

  // A swing as a symmetric periodic orbit of a given energy, with two multipliers, both 1.
  const SolveOutcome swing =
      solved(rod(length, "levels = \"fixed\"",
                 "[solve]\nends = \"symmetric\"\nmirror = [\"a\", \"b\"]\nperiod = \"free\"\nenergy = -0.28\n"),
             {"initial.x=-0.95", "initial.y=-0.3122498999199199", "initial.a=0", "initial.b=0", "scheme.until=7.4"});
  CHECK(swing.closes);
  REQUIRE(swing.multipliers.size() == 2);
  CHECK(std::abs(swing.multipliers[0] - 1.0) < 1e-6);

  // The twin: a state that is moved off the rod.
  falsify(file, "/states/q", 6, 1e-9);
  CHECK(check(file).status == ExitStatus::contradiction);
}

TEST_CASE("constraints that cannot be met are refused with a remedy", "[run][constraints]") {
  CHECK(refusal(rod(length)).empty());
  CHECK(refusal(rod(length, "")).empty());
  CHECK(refusal(rod(length, "lagrangian = \"splitting\"\norder = 4")).empty());
  const auto says = [](const std::string& text, const std::string& part,
                       const std::vector<std::string>& settings = {}) {
    INFO(part);
    CHECK_THAT(refusal(text, settings), Contains(part) && Catch::StartsWith("text.toml:"));
  };
  says(rod("length = \"x^2 + y^2 - 2\""), "start from x = 0.84");
  says(rod("length = \"x^2 + y^2 - 1\"\nlength_dot = \"x - 0.6\""), "rename one of them");
  says(rod("length = \"x^2 + y^2 - 1\"\nheight = \"x - 0.6\""), "leave nothing to move");
  says(rod("length = \"x^2 + t\""), "names t");
  says(rod("length = \"x^2 + a\""), "names a");
  says(rod("length = \"pi\""), "names no coordinate");
  says(rod("length = \"x^2 + q\""), "q");
  says(rod("length = \"(x^2 + y^2 - 1)^2\""), "without a power");
  says(rod(length, "lagrangian = \"gauss\"\nstages = 2"), "use \"midpoint\" or \"splitting\"");
  says(rod(length, "lagrangian = \"splitting\"\ncomposition = \"golden\""), "verlet, suzuki-4, kahan-li-6, kahan-li-8");
  says(rod(length, "lagrangian = \"splitting\"\norder = 3"), "order = 3");
  says(rod(length, "lagrangian = \"splitting\"\norder = 4\ncomposition = \"verlet\""), "is of order 2");
  says(rod(length, "lagrangian = \"splitting\"\ntangents = 3"), "a phase space of dimension 2 has no more than 2");
  says(rod("length = \"x^2 + y^2 - l^2\"", "lagrangian = \"splitting\"\ntangents = { parameters = [\"l\"] }",
           "[parameters]\nl = 1\n"),
       "names l, and a start that is held fixed would not satisfy it");

  says(rod(length, "lagrangian = \"gauss\"\nstages = 2", "[solve]\nends = { a_0 = 0 }\n"), "are not available for");
  says(rod(length, "", "[solve]\nends = { a_0 = 0 }\n"), "less two for each constraint");
  says(rod(length, "", "[solve]\nends = \"connection\"\n"), "coordinates that need no constraint");
  says(rod(length), "needs an H that does not name t", {"hamiltonian.H=\"(a^2 + b^2)/2 + y*cos(t)\""});
  says(rod(length), "no time_scale", {"scheme.time_scale=\"2\""});
  says(rod(length), "a = 0.73", {"initial.a=0.7"});
  CHECK_THAT(refusal(rod(length), {"hamiltonian.H=\"(a^2 + b^2)*(1 + x^2)\""}), Contains("in [lagrangian]"));
}
