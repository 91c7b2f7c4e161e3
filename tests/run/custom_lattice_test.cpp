// lagrangian = "custom" on lattices, from problem files.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

const std::string nine_points = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + 1 - cos(u)"

[parameters]
g = "sqrt(0.75)"

[grid]
x = { from = -20, to = 20, cells = 101 }

[initial]
u = "0"
v = "4*g*sech(g*x)"

[definitions]
rate = "(u_10 + u_11 - u_00 - u_01)/(2*h)"
slope = "(u_01 + u_11 - u_00 - u_10)/(2*dx)"

[scheme]
lagrangian = "custom"
L = "rate^2/2 - slope^2/2 - 1 + cos((u_00 + u_01 + u_10 + u_11)/4)"
step = 0.1
until = 6
)toml";

/// A density of the phase space, asymmetric in time: it keeps momenta and begins with a step of another scheme.
const std::string two_step_density =
    "L = \"v_00*(u_10 - u_00)/h - (v_00^2 + v_10^2)/4 - ((u_01 - u_00)/dx)^2/2 - 1 + (cos(u_00) + cos(u_10))/2\"";

}  // namespace

TEST_CASE("a run of a stated action is checked and resumed to the bit", "[run][custom]") {
  const Folder folder;
  const std::string whole = folder / "whole.h5", parts = folder / "parts.h5";
  for (const std::string levels : {"variable", "fixed"}) {
    INFO(levels);
    const std::string text = nine_points + "levels = \"" + levels + "\"\n";
    const RunOptions to_whole{.output = whole, .overwrite = true, .tangents = true};
    const Outcome ran = run(parse_problem(text, "f.toml"), to_whole);
    REQUIRE(ran.status == ExitStatus::done);
    const Outcome checked = check(whole);
    CHECK(checked.status == ExitStatus::done);
    CHECK(run(parse_problem(text, "f.toml", std::vector<std::string>{"scheme.until=3"}),
              {.output = parts, .overwrite = true, .tangents = true})
              .status == ExitStatus::done);
    CHECK(resume(parts, 6.0).status == ExitStatus::done);
    if (levels == "fixed") {  // a step potential is chosen by the length of the run
      CHECK(different_datasets(whole, parts) == Names{});
    }
    falsify(whole, "/states/u", 5 * 101 + 7, 1e-6);
    CHECK(check(whole).status == ExitStatus::contradiction);
  }
}

TEST_CASE("a stated action keeps the mean slope of a potential; its runs are checked, resumed and refined as others",
          "[run][custom]") {
  const std::string soliton = R"toml(
[multisymplectic]
fields = ["phi", "u", "v", "w"]
M = [["phi", "u", 0.5]]
K.x = [["phi", "w", 1], ["u", "v", -1]]
S = "v^2/2 - u*w + u^3"
[grid]
x = { from = -10, to = 10, cells = 101 }
[initial]
u = "2*sech(x)^2"
[definitions]
p = "(phi_00 + phi_01 + phi_10 + phi_11)/4"
p_t = "(phi_10 + phi_11 - phi_00 - phi_01)/(2*h)"
p_x = "(phi_01 + phi_11 - phi_00 - phi_10)/(2*dx)"
a = "(u_00 + u_01 + u_10 + u_11)/4"
a_t = "(u_10 + u_11 - u_00 - u_01)/(2*h)"
a_x = "(u_01 + u_11 - u_00 - u_10)/(2*dx)"
b = "(v_00 + v_01 + v_10 + v_11)/4"
b_x = "(v_01 + v_11 - v_00 - v_10)/(2*dx)"
c = "(w_00 + w_01 + w_10 + w_11)/4"
c_x = "(w_01 + w_11 - w_00 - w_10)/(2*dx)"
[scheme]
lagrangian = "custom"
L = "(p*a_t - a*p_t)/4 + (p*c_x - c*p_x)/2 - (a*b_x - b*a_x)/2 - b^2/2 + a*c - a^3"
step = 0.01
until = 0.4
)toml";
  const Folder folder;
  const std::string whole = folder / "whole.h5", parts = folder / "parts.h5", box = folder / "box.h5";
  for (const std::string levels : {"variable", "fixed"}) {
    INFO(levels);
    const std::string text = soliton + "levels = \"" + levels + "\"\n";
    const Outcome ran = run(parse_problem(text, "s.toml"), {.output = whole, .overwrite = true});
    REQUIRE(ran.status == ExitStatus::done);
    CHECK(ran.judgement.verdict == figures::Verdict::good);
    CHECK(check(whole).status == ExitStatus::done);
    CHECK(run(parse_problem(text, "s.toml", std::vector<std::string>{"scheme.until=0.2"}),
              {.output = parts, .overwrite = true})
              .status == ExitStatus::done);
    CHECK(resume(parts, 0.4).status == ExitStatus::done);
    REQUIRE(
        run(parse_problem(replaced(text, "lagrangian = \"custom\"\nL = \"", "lagrangian = \"box\"\n# \""), "s.toml"),
            {.output = box, .overwrite = true})
            .status == ExitStatus::done);
    if (levels == "fixed") {
      CHECK(different_datasets(whole, parts) == Names{});
      const std::vector<double> of_box = record::Reader(box).read("/levels/node_energy");
      const std::vector<double> found = record::Reader(whole).read("/levels/node_energy");
      for (std::size_t k = 0; k < of_box.size(); ++k) {
        CHECK(found[k] == Approx(of_box[k]).epsilon(1e-12));
      }
    }
    falsify(whole, "/states/u", 5 * 101 + 7, 1e-6);
    CHECK(check(whole).status == ExitStatus::contradiction);
  }
  const ConvergenceOutcome refined =
      converge(parse_problem(soliton, "s.toml", std::vector<std::string>{"scheme.levels=fixed", "grid.x.cells=201"}),
               std::nullopt);
  REQUIRE(refined.status == ExitStatus::done);
  CHECK(refined.quantities.front().step.order().value() == Approx(2.0).margin(0.1));
}

TEST_CASE("converge sees the order of a stated action", "[run][custom]") {
  const Problem problem = parse_problem(
      nine_points, "f.toml", std::vector<std::string>{"scheme.until=2", "scheme.levels=fixed", "grid.x.cells=201"});
  const ConvergenceOutcome outcome = converge(problem, std::nullopt);
  REQUIRE(outcome.status == ExitStatus::done);
  CHECK(outcome.quantities.front().step.order().value() == Approx(2.0).margin(0.1));
  CHECK(outcome.quantities.front().grid->order().value() == Approx(2.0).margin(0.1));
  CHECK(to_table(outcome).find("does not approximate") == std::string::npos);

  const std::string wrong = replaced(nine_points, "- 1 + cos", "- slope^2/50 - 1 + cos");
  const ConvergenceOutcome of_wrong = converge(
      parse_problem(wrong, "f.toml", std::vector<std::string>{"scheme.until=1", "scheme.levels=fixed"}), std::nullopt);
  CHECK_THAT(to_json(of_wrong), Contains("L does not approximate the equation: the variation by u"));
}

TEST_CASE("a stated action of another equation makes a run doubtful, in its record and where that is checked, too",
          "[run][custom]") {
  const Folder folder;
  const std::string file = folder / "wrong.h5";
  const auto reasons = [&](const std::string& text, figures::Verdict expected) {
    const Outcome ran = run(parse_problem(text, "f.toml", std::vector<std::string>{"scheme.until=0.5"}),
                            {.output = file, .overwrite = true});
    CHECK(ran.status == ExitStatus::done);
    CHECK(ran.judgement.verdict == expected);
    const Outcome checked = check(file);
    CHECK(checked.status == ExitStatus::done);
    CHECK(figures::text_of(checked.judgement) == figures::text_of(ran.judgement));
    return figures::text_of(ran.judgement);
  };
  CHECK(reasons(nine_points, figures::Verdict::good) == "good");
  const std::string wrong = replaced(nine_points, "- 1 + cos", "- slope^2/50 - 1 + cos");
  CHECK_THAT(reasons(wrong, figures::Verdict::doubtful), Contains("L does not approximate the equation"));
  CHECK_THAT(reasons(wrong + "[verdict]\naccept = [\"action\"]\n", figures::Verdict::good),
             Contains("accepted by [verdict]: L does not"));
  // In a frame L is of the fields there.
  const std::string moving = nine_points + "frame = { velocity = 0.5 }\nlevels = \"fixed\"\n";
  CHECK_THAT(reasons(moving, figures::Verdict::doubtful), Contains("L does not approximate the equation"));
  CHECK(reasons(replaced(moving, "rate^2/2", "(rate - 0.5*slope)^2/2"), figures::Verdict::good) == "good");
  // A record that conceals it contradicts its problem.
  CHECK(reasons(nine_points, figures::Verdict::good) == "good");
  replace_problem(file, wrong);
  const Outcome concealed = check(file);
  CHECK(concealed.status == ExitStatus::contradiction);
  CHECK(std::ranges::count(concealed.disagreements, figures::measures_path, &Disagreement::dataset) == 1);
}

TEST_CASE("between walls a stated action's derived fields are those of the fields that its checkpoint has",
          "[run][custom]") {
  const Folder folder;
  const std::string file = folder / "walls.h5", parts = folder / "parts.h5";
  const std::string text =
      replaced(replaced(nine_points, "x = { from = -20, to = 20, cells = 101 }",
                        "x = { from = -20, to = 20, cells = 40, left = \"fixed\", right = \"fixed\" }"),
               "4*g*sech(g*x)", "0.2*cos(pi*x/40)");
  for (const std::string levels : {"fixed", "variable"}) {
    const auto run_to = [&](const std::string& until, const std::string& to) {
      const std::vector<std::string> settings = {"scheme.until=" + until, "scheme.levels=" + levels,
                                                 "initial.u=0.7*cos(pi*x/40)+0.3*sin(pi*x/20)"};
      REQUIRE(run(parse_problem(text, "w.toml", settings), {.output = to, .overwrite = true}).status ==
              ExitStatus::done);
    };
    for (const std::string until : {"10", "15", "20"}) {
      run_to(until, file);
      CHECK(check(file).status == ExitStatus::done);
    }
    run_to("10", parts);
    CHECK(resume(parts, 20.0).status == ExitStatus::done);
    if (levels == "fixed") {
      CHECK(different_datasets(file, parts) == Names{});
    }
    const std::size_t numbers = record::Reader(file).read("/states/w").size();
    falsify(file, "/states/w", numbers - 1, 1e-15);
    CHECK(check(file).status == ExitStatus::contradiction);
  }
}

TEST_CASE("a field in the middle of steps is none of the first level of a stated action", "[run][custom]") {
  // On an even number of cells u is not the difference of phi at the start, so that the energy would know p.
  const std::string text = R"toml(
[multisymplectic]
fields = ["phi", "u", "v", "w", "p"]
M = [["phi", "v", -1]]
K.x = [["phi", "p", 1], ["u", "w", 1]]
S = "v^2/2 - w^2/2 + u^2/2 + u^3/3 - p*u"
[grid]
x = { from = 0, to = 6, cells = 20 }
[initial]
u = "0.2 + 0.1*cos(pi*x/3)"
v = "0.1*sin(pi*x/3)"
[definitions]
f_t = "(phi_10 + phi_11 - phi_00 - phi_01)/(2*h)"
f_x = "(phi_01 + phi_11 - phi_00 - phi_10)/(2*dx)"
a = "(u_00 + u_01 + u_10 + u_11)/4"
a_x = "(u_01 + u_11 - u_00 - u_10)/(2*dx)"
b = "(v_00 + v_01 + v_10 + v_11)/4"
c = "(w_00 + w_01 + w_10 + w_11)/4"
d = "(p_00 + p_01 + p_10 + p_11)/4"
[scheme]
lagrangian = "custom"
levels = "fixed"
L = "b*f_t - d*f_x - c*a_x - b^2/2 + c^2/2 - a^2/2 - a^3/3 + d*a"
step = 0.02
until = 0.2
)toml";
  const Folder folder;
  const std::string file = folder / "even.h5";
  REQUIRE(run(parse_problem(text, "b.toml"), {.output = file}).status == ExitStatus::done);
  CHECK(check(file).status == ExitStatus::done);
  falsify(file, "/levels/node_energy", 0, 1e-6);
  CHECK(check(file).status == ExitStatus::contradiction);
}

TEST_CASE("a second level of the problem begins a stated action", "[run][custom]") {
  const Folder folder;
  const std::string file = folder / "next.h5";
  std::string text = replaced(nine_points, "[definitions]",
                              "[initial.next]\nt = 0.05\nu = \"4*atan(g/0.5*sin(0.5*t)*sech(g*x))\"\n[definitions]");
  text = replaced(text, "step = 0.1\n", "levels = \"fixed\"\n");
  REQUIRE(run(parse_problem(text, "f.toml"), {.output = file}).status == ExitStatus::done);
  CHECK(check(file).status == ExitStatus::done);
  const record::Reader reader(file);
  CHECK(reader.read("/levels/h").front() == Approx(0.05));
  // The nodes nearest to x = 0 are half a spacing off.
  const std::vector<double> second = reader.read("/states/u", 1, 1);
  CHECK(*std::ranges::max_element(second) ==
        Approx(4.0 * std::atan(std::sqrt(0.75) / 0.5 * std::sin(0.025))).epsilon(2e-2));

  // A field that L leaves out would not be used.
  const std::string with_v = replaced(text, "[definitions]", "v = 77\n[definitions]");
  CHECK_THROWS_WITH(run(parse_problem(with_v, "f.toml"), {.output = file, .overwrite = true}),
                    Contains("f.toml:21:5") && Contains("leave it out of [initial.next], too"));

  // It moves with the step where it is a formula of t.
  const std::vector<std::string> settings = {"scheme.until=1", "grid.x.cells=201"};
  const ConvergenceOutcome refined = converge(parse_problem(text, "f.toml", settings), std::nullopt);
  REQUIRE(refined.status == ExitStatus::done);
  CHECK(refined.quantities.front().step.order().value() == Approx(2.0).margin(0.1));
  const std::string one_level = replaced(text, "sin(0.5*t)", "sin(0.5*0.05)");
  CHECK_THROWS_WITH(converge(parse_problem(one_level, "f.toml", settings), std::nullopt),
                    Contains("write its fields as formulas of t, or leave it out"));
}

TEST_CASE("a stated action with momenta of its own begins with a step of the box", "[run][custom]") {
  const Folder folder;
  const std::string file = folder / "kept.h5";
  const std::size_t begin = nine_points.find("L = "), end = nine_points.find('\n', begin);
  std::string text = nine_points;
  text.replace(begin, end - begin, two_step_density);
  text += "levels = \"fixed\"\n";
  for (const std::string cells : {"101", "100"}) {  // by the Fourier scheme on an even number
    const Outcome ran =
        run(parse_problem(text, "f.toml", std::vector<std::string>{"grid.x.cells=" + cells, "scheme.until=2"}),
            {.output = file, .overwrite = true});
    REQUIRE(ran.status == ExitStatus::done);
    CHECK(check(file).status == ExitStatus::done);
  }
}

TEST_CASE("a stated action of a driven lattice approximates it, and one with another drive does not", "[run][custom]") {
  const Folder folder;
  const auto warnings = [&](const std::string& drive) {
    const std::string text = R"toml(
[field]
fields = ["u"]
L = "u_t^2/2 - u_x^2/2 - (1 - cos(u))*(1 + 0.1*sin(t))"
[grid]
x = { from = -20, to = 20, cells = 101 }
[initial]
u = 0
u_t = "2*sech(x)"
[scheme]
lagrangian = "custom"
levels = "fixed"
L = "((u_10 - u_00)/h)^2/2 - ((u_01 - u_00)/dx)^2/2 - (1 - cos(u_00))*(1 + DRIVE*sin(t))"
step = 0.05
until = 0.2
)toml";
    const Problem problem = parse_problem(replaced(text, "DRIVE", drive), "driven.toml");
    return to_json(run(problem, {.output = folder / "driven.h5", .overwrite = true}));
  };
  CHECK(warnings("0.1").find("does not approximate") == std::string::npos);
  CHECK_THAT(warnings("0.2"), Contains("does not approximate the equation: the variation by u"));
}

TEST_CASE("between levels a stated action has states of the step it is in, symmetric in time or not") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  constexpr double h = 0.05;
  const std::string text = fmt::format(R"toml([multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + u^2/2"
[grid]
x = {{ from = 0, to = "2*pi", cells = 40 }}
[initial]
u = "cos(x)"
v = 0
[scheme]
lagrangian = "custom"
L = "0"
levels = "fixed"
step = {}
until = 2
[output]
interval = 0.13
[events]
down = {{ crossing = "u", at = {{ x = 0 }} }}
)toml",
                                       h);
  const std::string kinetic = "((u_10 - u_00)/h)^2/2", strain = "((u_01 - u_00)/dx)^2/2",
                    later = "((u_11 - u_10)/dx)^2/2";
  for (const std::string& L : {kinetic + " - " + strain + " - u_00^2/2", kinetic + " - " + later + " - u_10^2/2",
                               kinetic + " - (" + strain + " + " + later + ")/2 - (u_00^2 + u_10^2)/4"}) {
    INFO(L);
    const Problem problem = parse_problem(text, "own.toml", std::vector<std::string>{"scheme.L=" + L});
    REQUIRE(run(problem, {.output = file, .overwrite = true, .threads = 1}).complete);
    CHECK(check(file).status == ExitStatus::done);
    const record::Reader reader(file);
    const auto error = [&](const std::string& group, double shift) {
      const std::vector<double> t = reader.read(group + "/t"), u = reader.read(group + "/u");
      double largest = 0.0;
      for (std::size_t i = 0; i < t.size(); ++i) {
        largest = std::max(largest, std::abs(u[40 * i] - std::cos(std::numbers::sqrt2 * (t[i] + shift))));
      }
      return largest;
    };
    // A step over a part has an error of its own, of h² at order 1: half of u_tt = -2u times that.
    const double allowed = error("/states", 0.0) + h * h;
    CHECK(error("/output", 0.0) < allowed);
    CHECK(error("/output", 0.5 * h) > allowed);  // the twin: half a step off
    const std::vector<double> crossed = reader.read("/events/down/t");
    REQUIRE(crossed.size() == 1);
    CHECK(std::abs(crossed.front() - 0.5 * std::numbers::pi / std::numbers::sqrt2) < allowed);
  }
}

TEST_CASE("a stated action steps alike in all units of length and time", "[run][custom]") {
  const Folder folder;
  const std::string file = folder / "units.h5";
  const std::string others =
                        " - c^2*((u_01 + u_11 - u_00 - u_10)/(2*dx))^2/2 - w^2*(1 - cos((u_00 + u_01 + u_10 + "
                        "u_11)/4))\"",
                    rate_at_nodes = "L = \"(((u_10 - u_00)/h)^2 + ((u_11 - u_01)/h)^2)/4" + others,
                    mean_rate = "L = \"((u_10 + u_11 - u_00 - u_01)/(2*h))^2/2" + others;
  for (const std::string& L : {rate_at_nodes, mean_rate}) {
    const auto last = [&](double length, double speed) {
      const std::string text = fmt::format(R"toml([field]
equation = "u_tt = c^2*u_xx - w^2*sin(u)"
[parameters]
l = {:.17g}
c = {:.17g}
w = "c/l"
[grid]
x = {{ from = "-10*l", to = "10*l", cells = 41 }}
[initial]
u = "2*exp(-(x/l)^2)"
u_t = 0
[scheme]
lagrangian = "custom"
{}
levels = "fixed"
step = "0.1*l/c"
until = "2*l/c"
)toml",
                                           length, speed, L);
      REQUIRE(run(parse_problem(text, "units.toml"), {.output = file, .overwrite = true, .threads = 1}).complete);
      std::vector<double> u = record::Reader(file).read("/states/u");
      u.erase(u.begin(), u.end() - 41);
      return u;
    };
    const std::vector<double> natural = last(1.0, 1.0);
    const auto off = [&](const std::vector<double>& u) {
      double largest = 0.0;
      for (std::size_t i = 0; i < u.size(); ++i) {
        largest = std::max(largest, std::abs(u[i] - natural[i]));
      }
      return largest;
    };
    // Twenty solves, each to some roundings of u.
    CHECK(off(last(1e-9, 3e8)) < 1e-12);
    CHECK(off(last(1e12, 1e-3)) < 1e-12);
    CHECK(off(last(1.0, 1.01)) < 1e-12);
    CHECK(off(std::vector<double>(natural.size(), natural.front())) > 0.1);  // that there is something to be off
  }
}
