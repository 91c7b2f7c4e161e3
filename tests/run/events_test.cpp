// [events] and [section]: what is found, reported, stopped, resumed, checked, and refused.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "records.hpp"
#include "told_along.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;
using rubato::record::Reader;

namespace {

const Settings orbit = {"scheme.until=20", "events.apsis=x*u+y*v", "events.near=x^2+y^2<1",
                        R"(section={crossing="y", direction="up", quantities=["x", "u", "t"]})"};
const Settings lattice = {"grid.x.cells=51", "scheme.until=8",
                          R"x(events.peak={crossing="v", at={x=0}, quantities=["integral(v^2/2)", "t"]})x",
                          R"x(events.half={crossing="integral(v^2/2)-3", direction="down"})x"};

}  // namespace

TEST_CASE("events are told with the state in which they are", "[run]") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  const Outcome outcome = run_problem("kepler", file, orbit);
  const Reader reader(file);
  const std::vector<double> t = reader.read("/events/apsis/t"), q = reader.read("/events/apsis/q"),
                            p = reader.read("/events/apsis/p"), direction = reader.read("/events/apsis/direction");
  REQUIRE(t.size() >= 4);
  for (std::size_t i = 0; i < t.size(); ++i) {
    // Products of numbers up to 2, from a zero located to a few roundings.
    CHECK(std::abs(q[2 * i] * p[2 * i] + q[2 * i + 1] * p[2 * i + 1]) < 1e-14);
    const bool pericentre = q[2 * i] * q[2 * i] + q[2 * i + 1] * q[2 * i + 1] < 1.0;
    CHECK(direction[i] == (pericentre ? 1.0 : -1.0));
    CHECK((i == 0 || t[i] > t[i - 1]));
  }
  CHECK(reader.read_strings("/events/section/quantity") == std::vector<std::string>{"x", "u", "t"});
  const std::vector<double> section = reader.read("/events/section/quantities"),
                            times = reader.read("/events/section/t");
  REQUIRE(section.size() == 3 * times.size());
  for (std::size_t i = 0; i < times.size(); ++i) {
    CHECK(section[3 * i] == reader.read("/events/section/q", i, 1).at(0));
    CHECK(section[3 * i + 2] == times[i]);
    CHECK(std::abs(reader.read("/events/section/q", i, 1).at(1)) < 1e-15);
  }
  // Every time that it comes near, and not where it leaves.
  CHECK(reader.rows("/events/near/t") == times.size() - (times.size() > reader.rows("/events/near/t") ? 1 : 0));
  CHECK(sound(file, true));
  CHECK(differences(outcome, check(file)) == Names{});
  const std::string json = to_json(outcome);
  CHECK_THAT(json, Contains(R"("apsis": {"count": )" + std::to_string(t.size())));
  CHECK_THAT(json, !Contains("stopped"));
  CHECK_THAT(to_table(outcome), Contains("event section"));
}

TEST_CASE("a run ends with the step in which an event stops it", "[run]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Settings settings = {"scheme.until=50", "events.stop=t > 7.03", R"(events.turns={crossing="y", stop=8})"};
  const Outcome outcome = run_problem("kepler", file, settings);
  CHECK(outcome.status == ExitStatus::done);
  CHECK(outcome.complete);
  REQUIRE(outcome.statistics.stopped_by() != nullptr);
  CHECK(outcome.statistics.stopped_by()->name == "stop");
  const Reader reader(file);
  const std::vector<double> t = reader.read("/levels/t");
  CHECK(std::abs(reader.read("/events/stop/t").front() - 7.03) < 1e-14);
  CHECK(t.back() >= 7.03);
  CHECK(t[t.size() - 2] < 7.03);
  CHECK(reader.read("/states/t").back() == t.back());
  CHECK(reader.read("/events/stop/stops") == std::vector<double>{1.0});
  CHECK_THAT(to_json(outcome), Contains(R"("stopped": {"event": "stop", "t": 7.03)"));
  CHECK_THAT(to_table(outcome), Contains("event stop at t = 7.03"));
  CHECK(sound(file, true));
  // No step is shortened: the levels are those of a run that goes on.
  run_problem("kepler", folder / "b.h5", {"scheme.until=9"});
  const std::vector<double> all = Reader(folder / "b.h5").read("/levels/t");
  CHECK(std::equal(t.begin(), t.end(), all.begin()));
  // And nothing is added to it.
  const Outcome again = resume(file, 100.0, {.threads = 1});
  CHECK(Reader(file).rows("/levels/t") == t.size());
  CHECK_THAT(again.warnings.back(), Contains("event stop ended the run"));
  // By its number.
  const Outcome second =
      run_problem("kepler", folder / "c.h5", {"scheme.until=50", R"(events.turns={crossing="y", stop=3})"});
  CHECK(second.statistics.stopped_by()->value.count == 3);
  // A condition that holds at the start ends it there.
  const Outcome none = run_problem("kepler", folder / "d.h5", {"events.stop=x^2+y^2>0.01"});
  CHECK(none.statistics.steps == 0);
  CHECK(none.statistics.stopped_by() != nullptr);
  CHECK(sound(folder / "d.h5", true));
  CHECK(run_problem("kepler", folder / "e.h5", {"events.stop=x^2+y^2-0.01"}).statistics.steps > 0);
}

TEST_CASE("runs with events are resumed bit by bit", "[run]") {
  // Before, in and after steps with crossings.
  check_resumes("kepler", orbit, {0.011, 3.0, 6.28, 12.5}, 20.0);
  check_resumes("kepler", with(orbit, {"scheme.levels=fixed", "scheme.step=0.05", "output.every=7"}), {3.1, 6.3}, 13.0);
  check_resumes("kepler", with(orbit, {"output.interval=0.31", "output.states=false"}), {6.28}, 13.0);
  check_resumes("sine-gordon", lattice, {0.06, 2.0, 5.9}, 8.0);
}

TEST_CASE("events of a lattice are of integrals and of fields at points", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "lattice.h5";
  const Outcome outcome = run_problem("sine-gordon", file, with(lattice, {"grid.x.cells=201"}));
  const Reader reader(file);
  // The breather's field at its middle, 4 atan(γ/ω sin ωt), turns at π/(2ω) = π; the box scheme is off by Δx², 0.04.
  REQUIRE(reader.rows("/events/peak/t") == 1);
  CHECK(std::abs(reader.read("/events/peak/t").front() - std::acos(-1.0)) < 0.1);
  CHECK(reader.read("/events/peak/quantities").at(1) == reader.read("/events/peak/t").front());
  CHECK(reader.rows("/events/half/t") >= 1);
  CHECK(sound(file, true));
  CHECK(differences(outcome, check(file)) == Names{});
}

TEST_CASE("times of a lattice's events are of the order of the scheme", "[run][lattice]") {
  const Folder folder;
  const auto times = [&](const Settings& settings) {
    const std::string file = folder / "a.h5";
    run_problem("sine-gordon", file,
                with({"grid.x.cells=64", "scheme.until=14", "scheme.levels=fixed", "scheme.lagrangian=fourier",
                      "laws.every=false", R"(events.turn={crossing="v", at={x=0.3}})"},
                     settings));
    std::vector<double> t = Reader(file).read("/events/turn/t");
    std::filesystem::remove(file);
    return t;
  };
  const std::vector<double> exact = times({"scheme.stages=4", "scheme.step=0.05"});
  REQUIRE(exact.size() == 2);
  for (const auto& [stages, step] : {std::pair(1, 0.1), {2, 0.4}}) {
    std::vector<double> errors;
    for (const double h : {step, step / 2.0, step / 4.0}) {
      const std::vector<double> t =
          times({"scheme.stages=" + std::to_string(stages), "scheme.step=" + std::to_string(h)});
      REQUIRE(t.size() == exact.size());
      errors.push_back(std::max(std::abs(t[0] - exact[0]), std::abs(t[1] - exact[1])));
    }
    INFO(errors[0] << " " << errors[1] << " " << errors[2]);
    // Crossings fall on other shares of a step at each h.
    CHECK(0.5 * std::log2(errors[0] / errors[2]) > 2 * stages - 0.35);
  }
}

TEST_CASE("driven problems and those in fictitious time know their times", "[run]") {
  const Folder folder;
  run_problem("driven-pendulum", folder / "a.h5", {"scheme.until=12", "events.clock=sin(t)"});
  const std::vector<double> t = Reader(folder / "a.h5").read("/events/clock/t");
  REQUIRE(t.size() == 3);
  CHECK(std::abs(t[2] - 3.0 * std::acos(-1.0)) < 1e-14);
  // The time is a coordinate there, which t and the times of crossings are of; what steps are of is another.
  const Outcome scaled =
      run_problem("kepler", folder / "b.h5", {"scheme.time_scale=x^2+y^2", "events.stop=time>2", "events.own=t-0.7"});
  const Reader reader(folder / "b.h5");
  CHECK(std::abs(reader.read("/events/stop/q").back() - 2.0) < 1e-14);
  CHECK(std::abs(reader.read("/events/own/q").back() - 0.7) < 1e-14);
  CHECK(reader.read("/events/own/t").back() == reader.read("/events/own/q").back());
  CHECK(std::abs(reader.read("/levels/t").back() - reader.read("/levels/time").back()) > 0.1);
  CHECK(scaled.statistics.stopped_by()->name == "stop");
  CHECK(sound(folder / "b.h5"));
}

TEST_CASE("a record whose events were changed is found out", "[run]") {
  const Folder folder;
  for (const auto& [name, dataset] :
       std::vector<std::pair<std::string, std::string>>{{"kepler", "/events/apsis/t"},
                                                        {"kepler", "/events/apsis/q"},
                                                        {"kepler", "/events/section/quantities"},
                                                        {"kepler", "/events/section/direction"},
                                                        {"kepler", "/events/near/missed"},
                                                        {"sine-gordon", "/events/peak/t"},
                                                        {"sine-gordon", "/events/peak/quantities"}}) {
    INFO(dataset);
    const std::string file = folder / "a.h5";
    run_problem(name, file, name == "kepler" ? orbit : lattice);
    CHECK(sound(file));
    falsify(file, dataset, 0, dataset.ends_with("direction") || dataset.ends_with("missed") ? 1.0 : 1e-6);
    const Outcome outcome = check(file);
    CHECK(outcome.status == ExitStatus::contradiction);
    CHECK(std::ranges::any_of(outcome.disagreements, [&](const Disagreement& disagreement) {  // not by its checksum
      return disagreement.dataset == dataset && disagreement.row.has_value();
    }));
    std::filesystem::remove(file);
  }
}

TEST_CASE("formulas of events that are not defined, or jump, are told", "[run]") {
  const Folder folder;
  const Outcome outcome = run_problem("kepler", folder / "a.h5",
                                      {"scheme.until=20", "events.root=sqrt(x)-0.1", "events.angle=atan2(y,x)",
                                       "events.pole=1/y", R"x(events.odd={crossing="y", quantities=["log(-x)"]})x"});
  const auto& events = outcome.statistics.events;  // in alphabetical order
  REQUIRE(events.size() == 4);
  CHECK(events[0].value.jumps > 0);       // angle, from pi to -pi
  CHECK(events[0].value.count > 0);       // and 0
  CHECK(events[1].value.incomplete > 0);  // odd
  CHECK(events[1].value.incomplete < events[1].value.count);
  CHECK(events[2].value.count == 0);  // pole
  CHECK(events[2].value.jumps == events[1].value.count);
  CHECK(events[3].value.undefined > 0);  // root
  CHECK_THAT(to_json(outcome), Contains("undefined") && Contains("jumps") && Contains("incomplete"));
  std::string warnings;
  for (const std::string& warning : outcome.warnings) {
    warnings += warning + "\n";
  }
  CHECK_THAT(warnings, Contains("event root is not defined in") && Contains("event pole jumps through zero") &&
                           Contains("of event odd a quantity is not defined"));
  CHECK(differences(outcome, check(folder / "a.h5")) == Names{});
}

TEST_CASE("a run that returns unseen through the zero that it starts at is doubtful", "[run]") {
  const Folder folder;
  const auto ball = [&](const std::string& v, const Settings& settings = {}) {
    return run(
        parse_problem("[hamiltonian]\nq = [\"x\"]\np = [\"v\"]\nH = \"v^2/2 + x\"\n[initial]\nx = 0\nv = " + v +
                          "\n[scheme]\nstep = 0.05\nuntil = 1\n[events]\nfloor = { crossing = \"x\", direction = "
                          "\"down\" }\n",
                      "t.toml", settings),
        {.output = folder / "a.h5", .overwrite = true});
  };
  const Outcome missed = ball("1e-7");  // back after 2e-7, a 250,000th of the step
  CHECK(missed.status == ExitStatus::done);
  CHECK(missed.judgement.verdict == figures::Verdict::doubtful);
  REQUIRE(missed.judgement.reasons.size() == 1);
  CHECK(missed.judgement.reasons.front().kind == figures::ReasonKind::event);
  CHECK(missed.statistics.events.front().value.count == 0);
  CHECK_THAT(to_json(missed), Contains(R"("floor": {"count": 0, "returned": 1})") && Contains(R"("what": "event")"));
  CHECK(Reader(folder / "a.h5").read("/events/floor/missed").front() == 4.0);
  const Outcome checked = check(folder / "a.h5");
  CHECK(checked.status == ExitStatus::done);
  CHECK(checked.judgement.verdict == figures::Verdict::doubtful);
  CHECK(ball("1e-7", {"verdict.accept=[\"event\"]"}).judgement.verdict == figures::Verdict::good);
  // The twins: it comes back later, and it falls from the start.
  const Outcome seen = ball("0.3");
  CHECK(seen.judgement.verdict == figures::Verdict::good);
  CHECK(seen.statistics.events.front().value.count == 1);
  CHECK(ball("-0.1").judgement.verdict == figures::Verdict::good);
}

TEST_CASE("members of an ensemble are ended by events, and count them", "[run]") {
  const Folder folder;
  const Settings settings = {"scheme.until=60",
                             "scheme.levels=fixed",
                             "scheme.step=0.1",
                             "events.stop=x^2+y^2>4",
                             R"(events.turns={crossing="v", direction="down"})",
                             "ensemble.members=[{initial.u=0.3},{initial.u=0.9}]"};
  const Problem problem = read_problem("henon-heiles", settings);
  const EnsembleOutcome outcome = run_ensemble(problem, {.output = folder / "e.h5", .threads = 1});
  CHECK(outcome.status == ExitStatus::done);
  const Reader reader(folder / "e.h5");
  const std::vector<double> stopped = reader.read("/members/stopped/t"), t = reader.read("/members/t"),
                            stops = reader.read("/members/events/stop/count");
  REQUIRE(stopped.size() == 2);
  CHECK(std::isnan(stopped[0]));
  CHECK(stops == std::vector<double>{0.0, 1.0});
  CHECK(t[0] >= 60.0 - 1e-9);
  CHECK(t[1] < 60.0);
  CHECK(stopped[1] <= t[1]);
  CHECK(check_ensemble(folder / "e.h5").status == ExitStatus::done);
  // The crossings are those of runs of the members alone.
  const std::vector<double> members = reader.read("/events/turns/member"), times = reader.read("/events/turns/t");
  const Outcome alone = run_problem("henon-heiles", folder / "alone.h5",
                                    {"scheme.until=60", "scheme.levels=fixed", "scheme.step=0.1", "initial.u=0.3",
                                     R"(events.turns={crossing="v", direction="down"})"});
  const std::vector<double> expected = Reader(folder / "alone.h5").read("/events/turns/t");
  REQUIRE(alone.statistics.events.front().value.count == expected.size());
  REQUIRE(times.size() > expected.size());
  CHECK(std::equal(expected.begin(), expected.end(), times.begin()));
  CHECK(static_cast<std::size_t>(std::count(members.begin(), members.end(), 0.0)) == expected.size());
  CHECK(static_cast<double>(times.size() - expected.size()) == reader.read("/members/events/turns/count").at(1));
  std::filesystem::copy_file(folder / "e.h5", folder / "false.h5");
  falsify(folder / "false.h5", "/events/turns/p", 2, 1e-9);
  CHECK(check_ensemble(folder / "false.h5").status == ExitStatus::contradiction);
}

TEST_CASE("events are refused with a remedy", "[run]") {
  const auto kepler = [](const char* setting) { return refusal("kepler", {setting}); };
  const auto wave = [](const char* setting) { return refusal("sine-gordon", {"grid.x.cells=51", setting}); };
  CHECK_THAT(kepler("events=1"), Contains("a table, [events]"));
  CHECK_THAT(kepler("events={}"), Contains("names no event"));
  CHECK_THAT(kepler("events.2a=x"), Contains("a name is a letter"));
  CHECK_THAT(kepler("events.section=x"), Contains("that of [section]"));
  CHECK_THAT(kepler("events.a=true"), Contains("expected a formula or a number"));
  CHECK_THAT(kepler("events.a="), Contains("the formula is empty"));
  CHECK_THAT(kepler("events.a=xx"), Contains("unknown name"));
  CHECK_THAT(kepler("events.a=1+1"), Contains("depends on nothing"));
  CHECK_THAT(kepler("events.a=x=1"), Contains(R"(write "a - b")"));
  CHECK_THAT(kepler("events.a=x!=1"), Contains(R"(write "a - b")"));
  CHECK_THAT(kepler("events.a=x>=1"), Contains("write > or <"));
  CHECK_THAT(kepler("events.a=0<x<1"), Contains("an event of its own"));
  CHECK_THAT(kepler("events.a=x>"), Contains("a side of the comparison is empty"));
  CHECK_THAT(kepler("events.a=>x"), Contains("a side of the comparison is empty"));
  CHECK_THAT(kepler("events.a=x>yy"), Contains("unknown name"));
  CHECK_THAT(kepler("events.stop=true"), Contains("expected a formula or a number"));
  CHECK_THAT(kepler(R"(events.a={direction="up"})"), Contains("[events.a] needs crossing"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", direction="upp"})"), Contains(R"(did you mean "up"?)"));
  CHECK_THAT(kepler(R"(events.a={crossing="x>1", direction="up"})"), Contains("where it becomes true"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", direktion="up"})"), Contains("did you mean direction?"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", stop=0})"), Contains("at least 1"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", stop="y>1"})"), Contains(R"(crossing = "a > b")"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", at={x=1}})"), Contains("leave it out"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", quantities=[]})"), Contains("there is none in it"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", quantities="y"})"), Contains("an array of formulas"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", quantities=["yy"]})"), Contains("unknown name"));
  CHECK_THAT(kepler(R"(events.a={crossing="x", quantities=["y", "y"]})"), Contains("there twice"));
  CHECK_THAT(kepler(R"(section={crossing="x"})"), Contains("[section] needs quantities"));
  CHECK_THAT(kepler(R"(section={quantities=["x"]})"), Contains("[section] needs crossing"));
  CHECK_THAT(kepler("scheme.stop=x>1"), Contains("it belongs to [events]"));
  CHECK_THAT(kepler("stop=x>1"), Contains("it belongs to [events]"));
  CHECK_THAT(wave("events.a=u"), Contains("differs from node to node"));
  CHECK_THAT(wave("events.a=integral(u)>u"), Contains("differs from node to node"));
  CHECK_THAT(wave(R"(events.a={crossing="u", at={x=100}})"), Contains("outside the grid"));
  CHECK_THAT(wave(R"x(events.a={crossing="u", at={x=1}, quantities=["integral(integral(u))"]})x"),
             Contains("in which there is no integral"));
  CHECK_THAT(refusal("pendulum", {"scheme.lagrangian=custom",
                                  "scheme.L=(p_0+p_1)/2*(q_1-q_0)/(t_1-t_0)-p_1^2/2+cos(q_1)*cos(t_0)", "events.a=q"}),
             Contains("leave out [events] and [section]"));
  // A comparison's place is that of the side that is wrong.
  CHECK_THAT(refusal("kepler", {"events.a=x > 1 + yy"}), Contains("1 + yy"));
}
