// [ensemble]: many runs of one problem.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/orbit_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/ensemble.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

Problem with(const std::string& ensemble, const std::vector<std::string>& settings = {}) {
  return parse_problem(pendulum + "[ensemble]\n" + ensemble + "\n", "t.toml", settings);
}

std::string refusal(const std::string& ensemble) {
  try {
    const Problem problem = with(ensemble);
    const Folder folder;
    static_cast<void>(run_ensemble(problem, {.output = folder / "a.h5"}));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

double figure(const EnsembleOutcome& outcome, const std::string& name, std::size_t member) {
  for (std::size_t i = 0; i < outcome.summary.size(); ++i) {
    if (outcome.summary[i].name == name) {
      return outcome.figures[member][i];
    }
  }
  FAIL("no figure " << name);
  return 0.0;
}

}  // namespace

TEST_CASE("members of an ensemble are the runs of their problems, bit by bit") {
  const Folder folder;
  const Problem problem = with("grid = { initial.p = \"0.5:2.5:3\", scheme.levels = [\"variable\", \"fixed\"] }");
  const EnsembleOutcome all = run_ensemble(problem, {.output = folder / "all.h5"});
  CHECK(all.status == ExitStatus::done);
  REQUIRE(all.members == 6);
  REQUIRE(all.finished == 6);
  const record::Reader reader(folder / "all.h5");
  const std::vector<double> q = reader.read("/members/last/q"), p = reader.read("/members/last/p");
  CHECK(reader.read("/members/values/initial.p") == std::vector<double>{0.5, 0.5, 1.5, 1.5, 2.5, 2.5});
  CHECK(reader.read("/members/values/scheme.levels") == std::vector<double>{0, 1, 0, 1, 0, 1});
  for (std::size_t m = 0; m < 6; ++m) {
    INFO(problem.ensemble->described(m));
    const Outcome one = run(member_problem(problem, m), {.output = folder / "one.h5", .overwrite = true});
    const record::Reader alone(folder / "one.h5");
    const std::size_t last = alone.rows("/states/t") - 1;
    CHECK(alone.read("/states/q", last, 1).front() == q[m]);
    CHECK(alone.read("/states/p", last, 1).front() == p[m]);
    CHECK(figure(all, "steps", m) == static_cast<double>(one.statistics.steps));
    CHECK(figure(all, "node_energy/max_deviation", m) == one.statistics.node_energy.max());
    CHECK(figure(all, "discrete_energy/max_relative_deviation", m) == one.statistics.relative_energy_deviation());
    CHECK(std::isnan(figure(all, "off_law/steps", m)) == (m % 2 == 1));  // equal steps choose no levels
  }
  // What is reported on all: of the second member the node energy strays most among the slow ones.
  const std::string json = to_json(all);
  CHECK_THAT(json, Contains("\"members\": 6") && Contains("\"node_energy\": {") && Contains("\"worst\": ") &&
                       Contains("\"mean\": ") && !Contains("nan"));
  CHECK_THAT(to_table(all, true), Contains("initial.p") && Contains("\"fixed\""));
}

TEST_CASE("the record of an ensemble is the same for every number of threads, and interrupted and continued") {
  const Folder folder;
  const Problem problem =
      with("random = { count = 60, seed = 3, initial.p = \"normal(0, 1)\", parameters.k = \"uniform(1, 2)\" }",
           {"scheme.until=200", "events.top=p"});
  const EnsembleOutcome one = run_ensemble(problem, {.output = folder / "one.h5", .threads = 1});
  const EnsembleOutcome three = run_ensemble(problem, {.output = folder / "three.h5", .threads = 3});
  CHECK(different_datasets(folder / "one.h5", folder / "three.h5") == Names{});
  CHECK(record::Reader(folder / "one.h5").rows("/events/top/member") > 60);
  CHECK(to_json(one).substr(0, 400) == to_json(three).substr(0, 400));

  // Stopped again and again, after ten members each time: twice by one thread, which stops there. Of two threads one
  // may come to the last member while the other is not given a processor.
  const std::string file = folder / "stopped.h5";
  std::size_t stops = 0;
  EnsembleOutcome outcome;
  do {
    const std::size_t before = outcome.finished;
    outcome = interrupt_after(10, problem, file, before == 0, stops < 2 ? 1 : 2);
    stops += outcome.status == ExitStatus::interrupted ? 1 : 0;
    CHECK(record::Reader(file).rows("/members/number") == outcome.finished);
    REQUIRE(outcome.finished > before);
  } while (outcome.finished < 60);
  CHECK(stops > 1);
  CHECK(outcome.status == ExitStatus::done);
  CHECK(to_json(outcome).substr(0, 400) == to_json(one).substr(0, 400));
  CHECK(different_datasets(folder / "one.h5", file) == Names{});
}

TEST_CASE("check runs the members again, and finds what was altered") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  static_cast<void>(run_ensemble(with("members = [{ initial.p = 1 }, { initial.p = \"sqrt(2)\" }]"), {.output = file}));
  CHECK(record::Reader(file).read("/members/values/initial.p").back() == std::sqrt(2.0));
  const EnsembleOutcome sound = check_ensemble(file);
  CHECK(sound.status == ExitStatus::done);
  CHECK(sound.compared > 40);
  falsify(file, "/members/last/p", 1, 1e-12);
  const EnsembleOutcome altered = check_ensemble(file);
  CHECK(altered.status == ExitStatus::contradiction);
  CHECK_THAT(altered.message, Contains("/members/last/p of member 1"));
  CHECK_THROWS_WITH(resume_ensemble(file), Contains("/members/last/p"));
}

TEST_CASE("members that fail do not end the others, and are told") {
  const Folder folder;
  const EnsembleOutcome outcome =
      run_ensemble(with("grid = { scheme.max_steps = [5, 1000] }"), {.output = folder / "a.h5"});
  CHECK(outcome.status == ExitStatus::failed);
  CHECK(outcome.statuses == std::vector{ExitStatus::failed, ExitStatus::done});
  CHECK_THAT(outcome.message, Contains("1 of 2 members ended early") && Contains("scheme.max_steps = 5"));
  CHECK(outcome.findings.verdict() == figures::Verdict::doubtful);
  CHECK_THAT(to_json(outcome), Contains(R"("verdicts": {"good": 1, "doubtful": 1, "lost": 0})") &&
                                   Contains(R"("what": "end")") && Contains(R"("ended_early": 1)"));
  CHECK_THAT(to_json(outcome), Contains("\"members\": 2, \"finished\": 1, \"ended_early\": 1"));
}

TEST_CASE("an ensemble of lattices keeps the last fields where the grid is one for all") {
  const Folder folder;
  const std::string text =
      replaced(replaced(replaced(breather, "until = 20", "until = 0.5"), "cells = 401", "cells = 51"),
               "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", "");
  const auto members = [&](const std::string& ensemble) {
    const std::string file = folder / (std::to_string(ensemble.size()) + ".h5");
    CHECK(run_ensemble(parse_problem(text + "[ensemble]\n" + ensemble, "t.toml"), {.output = file}).status ==
          ExitStatus::done);
    return record::Reader(file).has("/members/last/u");
  };
  CHECK(members("grid = { parameters.omega = \"0.4:0.6:3\" }\n"));
  CHECK_FALSE(members("grid = { grid.x.cells = [51, 61] }\n"));
}

TEST_CASE("an ensemble keeps what is told at output times, of all members one after the other") {
  const Folder folder;
  const Problem problem =
      with("grid = { initial.p = [0.5, 1.9] }", {"output.interval=0.25", "output.quantities.twice=\"2*q\""});
  static_cast<void>(run_ensemble(problem, {.output = folder / "all.h5"}));
  const auto read = [&](const char* path) { return record::Reader(folder / "all.h5").read(path); };
  const std::vector<double> q = read("/output/q"), twice = read("/output/quantities/twice"),
                            member = read("/output/member");
  std::size_t row = 0;
  for (std::size_t m = 0; m < 2; ++m) {
    static_cast<void>(run(member_problem(problem, m), {.output = folder / "one.h5", .overwrite = true}));
    for (const double value : record::Reader(folder / "one.h5").read("/output/q")) {
      REQUIRE(row < q.size());
      CHECK(q[row] == value);
      CHECK(twice[row] == 2.0 * value);
      CHECK(member[row] == static_cast<double>(m));
      ++row;
    }
  }
  CHECK(row == q.size());
  CHECK(check_ensemble(folder / "all.h5").status == ExitStatus::done);
  falsify(folder / "all.h5", "/output/q", 3, 1e-9);
  CHECK_THAT(check_ensemble(folder / "all.h5").message, Contains("/output/q"));
}

TEST_CASE("members on different grids keep their crossings and quantities, and it is said that fields are not kept") {
  const Folder folder;
  const auto ensemble_of = [&](const std::string& members) {
    const Problem problem = parse_problem(
        "[field]\nequation = \"u_tt = u_xx\"\n[grid]\nx = { from = 0, to = \"2*pi\", cells = 16 }\n[initial]\nu = "
        "\"a*cos(x)\"\nu_t = 0\n[parameters]\na = 1\n[scheme]\nlagrangian = \"splitting\"\nlevels = \"fixed\"\nstep = "
        "0.1\nuntil = 2\n[output]\ninterval = 1\nquantities = { mass = \"integral(u^2)\" }\n[events]\npass = { "
        "crossing "
        "= \"u\", at = { x = 0 } }\n[ensemble]\nmembers = " +
            members + "\n",
        "t.toml");
    return run_ensemble(problem, {.output = folder / "a.h5", .overwrite = true});
  };
  const auto warned = [](const EnsembleOutcome& outcome) {
    const std::vector<std::string> warnings = outcome.findings.warnings("members");
    return std::ranges::any_of(warnings,
                               [](const std::string& one) { return one.find("different grids") != std::string::npos; });
  };
  CHECK(warned(ensemble_of("[{ grid.x.cells = 16 }, { grid.x.cells = 32 }]")));
  {
    const record::Reader reader(folder / "a.h5");
    CHECK_FALSE(reader.has("/output/u"));
    CHECK_FALSE(reader.has("/members/last/u"));
    const std::vector<double> mass = reader.read("/output/quantities/mass");
    REQUIRE(mass.size() == 6);
    CHECK(mass[0] == Approx(std::numbers::pi));
    CHECK(mass[3] == Approx(mass[0]));
    CHECK(reader.read_integers("/output/member") == std::vector<std::int64_t>{0, 0, 0, 1, 1, 1});
    CHECK(reader.rows("/events/pass/t") == 2);
  }
  CHECK(check_ensemble(folder / "a.h5", {}).status == ExitStatus::done);
  // The twin: one grid for all.
  CHECK_FALSE(warned(ensemble_of("[{ parameters.a = 1 }, { parameters.a = 2 }]")));
  CHECK(record::Reader(folder / "a.h5").has("/output/u"));
}

TEST_CASE("the distribution of a figure over members") {
  const double none = std::nan("");
  const std::vector<double> values = {4.0, none, 1.0, 8.0, 2.0, 8.0};
  const figures::Distribution found = figures::distribution_of(values);
  CHECK(found.min == 1.0);
  CHECK(found.lower == 2.0);
  CHECK(found.median == 4.0);
  CHECK(found.upper == 8.0);
  CHECK(found.max == 8.0);
  CHECK(found.mean == 23.0 / 5.0);
  CHECK(found.worst == 3);  // the first of those that are largest
  CHECK((found.defined == 5 && found.undefined == 1));
  CHECK_FALSE(figures::distribution_of(std::vector<double>{none}).any());
  CHECK_THAT(figures::line_of("x", found).value, Contains("1 to 8") && Contains("half in 2 to 8"));
  CHECK_THAT(figures::line_of("x", found).remark, Contains("member 3") && Contains("none in 1"));
}

TEST_CASE("random members are what was asked for, and more of them do not change the first") {
  const auto drawn = [](int count) {
    return with(fmt::format(
        "random = {{ count = {}, seed = 5, initial.p = \"uniform(1, 3)\", initial.q = \"normal(2, 0.5)\" }}", count));
  };
  const Problem few = drawn(10), many = drawn(4000);
  CHECK(std::equal(few.ensemble->values.begin(), few.ensemble->values.end(), many.ensemble->values.begin()));
  double sum = 0.0, normal_sum = 0.0, normal_squares = 0.0, least = 9.0, most = 0.0;
  for (const auto& values : many.ensemble->values) {
    const double uniform = std::stod(values[0]), normal = std::stod(values[1]) - 2.0;
    sum += uniform;
    least = std::min(least, uniform);
    most = std::max(most, uniform);
    normal_sum += normal;
    normal_squares += normal * normal;
  }
  // Four standard deviations of the mean of 4000: of uniform(1, 3) 0.58, of normal 0.5, of its square 0.35.
  CHECK(sum / 4000.0 == Approx(2.0).margin(4.0 * 0.58 / 63.0));
  CHECK(normal_sum / 4000.0 == Approx(0.0).margin(4.0 * 0.5 / 63.0));
  CHECK(normal_squares / 4000.0 == Approx(0.25).margin(4.0 * 0.36 / 63.0));
  CHECK((least > 1.0 && least < 1.01 && most < 3.0 && most > 2.99));
  CHECK(with("random = { count = 10, seed = 6, initial.p = \"uniform(1, 3)\" }").ensemble->values !=
        few.ensemble->values);
}

TEST_CASE("what is wrong with an ensemble is told before anything is written") {
  CHECK_THAT(refusal("members = []"), Contains("changes nothing"));
  CHECK_THAT(refusal("membres = []"), Contains("did you mean members?"));
  CHECK_THAT(refusal("members = [{ initial.p = 1 }]\ngrid = { initial.p = [1] }"),
             Contains("one of members, grid and random"));
  CHECK_THAT(refusal("members = [{ initial.p = 1 }, { initial.q = 1 }]"),
             Contains("t.toml:15:31") && Contains("the first has initial.p"));
  CHECK_THAT(refusal("grid = { initial.p = \"0:1\" }"), Contains("from:to:count"));
  CHECK_THAT(refusal("grid = { initial.p = \"0:1:0\" }"), Contains("at least 1"));
  CHECK_THAT(refusal("grid = { initial.p = \"0:1:1\" }"), Contains("count of 2 or more"));
  CHECK_THAT(refusal("grid = { initial.p = 3 }"), Contains("\"from:to:count\" or a list"));
  CHECK_THAT(refusal("grid = { p = [1, 2] }"), Contains("write its whole path"));
  CHECK_THAT(refusal("grid = { initial.u = [1, 2] }"),
             Contains("member 0 (initial.u = 1)") && Contains("unknown key u"));
  CHECK_THAT(refusal("grid = { parameters.K = [1, 2] }"), Contains("did you mean k?") || Contains("it has k"));
  CHECK_THAT(refusal("grid = { scheme.step = [0.1, -0.1] }"), Contains("member 1 (scheme.step = -0.1)"));
  CHECK_THAT(refusal("grid = { output.every = [1, 2] }"), Contains("one for all members"));
  CHECK_THAT(refusal("random = { initial.p = \"uniform(0, 1)\" }"), Contains("count"));
  CHECK_THAT(refusal("random = { count = 2, initial.p = \"unifrom(0, 1)\" }"), Contains("uniform(from, to)"));
  CHECK_THAT(refusal("random = { count = 2, initial.p = \"normal(0, -1)\" }"), Contains("deviation of normal"));
  CHECK_THAT(refusal("random = { count = 2, initial.p = \"uniform(2, 0)\" }"), Contains("uniform(from, to) needs"));
  CHECK_THAT(refusal("random = { count = 2, initial.p = \"1/(uniform(0, 1) - uniform(0, 1))*0/0\" }"),
             Contains("for member 0"));
  CHECK_THAT(refusal("grid = { initial.p = \"0:1:100000\", initial.q = \"0:1:100000\" }"), Contains("more than"));
}
