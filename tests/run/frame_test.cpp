// [scheme] frame: the equation in a frame that moves with the wave, and what is reported on the laboratory.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/page.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem_texts.hpp"
#include "records.hpp"
#include "report/page_reader.hpp"
#include "run/mailboxes.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

const Settings soliton = {"scheme.lagrangian=fourier", "scheme.step=0.02", "scheme.until=2"};
const Settings schroedinger = {"scheme.lagrangian=fourier", "grid.x.cells=151", "scheme.step=0.05"};
constexpr const char* with_the_wave = "scheme.frame.velocity=4*pi/L";  // of nls, one wave of the phase over the period
constexpr const char* with_its_phase = "scheme.frame.phase.charge=1+c^2/4";

/// u = 2 (log F)_xx, speeds 1.44 and 3.24.
constexpr const char* two_solitons = R"toml(
[multisymplectic]
equation = "kdv"
[parameters]
L = 60
k = 1.8
l = 1.2
a = "((k - l)/(k + l))^2"
[definitions]
e = "exp(k*x - k^3*t)"
f = "exp(l*x - l^3*t)"
F = "1 + e + f + a*e*f"
F_x = "k*e + l*f + a*(k + l)*e*f"
U = "2*((k^2*e + l^2*f + a*(k + l)^2*e*f)/F - (F_x/F)^2)"
[grid]
x = { from = "-L/2", to = "L/2", cells = 257 }
[initial]
t = -4
u = "U"
[exact]
u = "U"
[scheme]
lagrangian = "fourier"
stages = 4
levels = "fixed"
step = 0.1
until = 2
)toml";

/// A name of the catalogue, or the text of a problem.
Problem problem_of(const std::string& problem, const Settings& settings) {
  return problem.find('\n') == std::string::npos ? read_problem(problem, settings)
                                                 : parse_problem(problem, "problem.toml", settings);
}

/// The largest error of the first field of [exact].
double error_of(const std::string& problem, const Settings& settings) {
  const Folder folder;
  const Outcome outcome = run(problem_of(problem, settings), {.output = folder / "a.h5", .threads = 1});
  REQUIRE(outcome.status == ExitStatus::done);
  return outcome.statistics.errors.front().value.largest();
}

}  // namespace

TEST_CASE("a wave that rests in the frame has no error of the step") {
  // The published soliton is not quite periodic: its tail at the seam, 4 exp(-L) = 8e-9, is what is left.
  CHECK(error_of("kdv", joined(soliton, {"scheme.frame.velocity=4"})) < 1e-7);
  const double laboratory = error_of("kdv", soliton);
  CHECK(laboratory > 1e-2);
  // Twins: the other way round, and a frame that does not turn with the phase.
  CHECK(error_of("kdv", joined(soliton, {"scheme.frame.velocity=-4"})) > laboratory);
  CHECK(error_of("nls", joined(schroedinger, {with_the_wave, with_its_phase})) < 1e-8);
  CHECK(error_of("nls", joined(schroedinger, {with_the_wave})) > 0.9 * error_of("nls", schroedinger));
}

TEST_CASE("steps that resolve what moves in the frame are resolved, and no potential is a wave at the seam") {
  const auto outcome_in = [](const std::string& velocity) {
    const Folder folder;
    return run(problem_of("kdv", joined(soliton, {"scheme.stages=4", "scheme.step=0.4", "scheme.levels=fixed",
                                                  "scheme.frame.velocity=" + velocity})),
               {.output = folder / "a.h5", .threads = 1});
  };
  const Outcome at_rest = outcome_in("4"), slow = outcome_in("3.9"), moving = outcome_in("0");
  CHECK(at_rest.judgement.verdict == figures::Verdict::good);
  CHECK(slow.judgement.verdict == figures::Verdict::good);
  CHECK(std::isnan(outcome_in("3").statistics.measures.seam_t));
  // The twin: in the laboratory such steps are none.
  CHECK(moving.judgement.verdict != figures::Verdict::good);
}

TEST_CASE("two solitons gain in the frame between them") {
  const double laboratory = error_of(two_solitons, {"scheme.frame.velocity=0"});
  CHECK(error_of(two_solitons, {"scheme.frame.velocity=2.3"}) < laboratory / 500.0);
  CHECK(error_of(two_solitons, {"scheme.frame.velocity=-1"}) > laboratory);
}

TEST_CASE("what a formula without a period misses at the ends of a moving grid is no error of the steps") {
  // U is of the whole line, u repeats: at the lower end, x = -30 + 6 c, the two differ by up to the tail of the slower
  // soliton, 2 l^2 exp(l x - 2 l^3) = 6.3e-8 or 2.9e-7. From -40 on it is 2e-12, and codes by hand for the same steps
  // have errors of 1.14e-8 and 1.68e-8.
  const Settings away = {"grid.x.from=-40", "grid.x.to=20"};
  const auto in_frame = [&](const std::string& c, Settings settings) {
    settings.push_back("scheme.frame.velocity=" + c);
    return error_of(two_solitons, settings);
  };
  CHECK(in_frame("3.03", away) == Approx(1.14e-8).epsilon(0.05));
  CHECK(in_frame("3.24", away) == Approx(1.68e-8).epsilon(0.05));
  // The twin: ends that come near.
  CHECK(in_frame("3.24", {}) > 1e-7);
}

TEST_CASE("a breather that moves gains in its frame, where it breathes on") {
  // sine-Gordon, boosted to 0.8 of the speed of light; the tails at the seam are 2e-9.
  constexpr const char* breather = R"toml(
[multisymplectic]
equation = "sine-gordon"
[parameters]
omega = 0.5
gamma = "sqrt(1 - omega^2)"
c = 0.8
G = "1/sqrt(1 - c^2)"
[definitions]
A = "gamma/omega*sin(omega*G*(t - c*x))"
B = "cosh(gamma*G*(x - c*t))"
U = "4*atan(A/B)"
U_t = "4/(1 + (A/B)^2)*(gamma*G*cos(omega*G*(t - c*x))/B + A*gamma*G*c*sinh(gamma*G*(x - c*t))/B^2)"
[grid]
x = { from = -22, to = 30, cells = 525 }
[initial]
u = "U"
v = "U_t"
[exact]
u = "U"
[scheme]
lagrangian = "fourier"
stages = 2
levels = "fixed"
step = 0.2
until = 8
)toml";
  const double laboratory = error_of(breather, {});
  CHECK(laboratory > 1e-3);
  CHECK(error_of(breather, {"scheme.frame.velocity=0.8"}) < laboratory / 100.0);
  CHECK(error_of(breather, {"scheme.frame.velocity=-0.8"}) > laboratory);
}

TEST_CASE("a soliton's line in the plane rests in the frame that goes across it") {
  // Its potential is constant along waves across x, and is held there at the rate of each of them.
  const Settings plane = {"scheme.lagrangian=fourier", "parameters.L=48",  "grid.x.cells=117",
                          "grid.y.cells=117",          "scheme.step=0.04", "scheme.until=0.2"};
  const double laboratory = error_of("zakharov-kuznetsov", plane);
  CHECK(laboratory > 1e-4);
  CHECK(error_of("zakharov-kuznetsov", joined(plane, {"scheme.frame.velocity=[1, 1]"})) < laboratory / 1000.0);
  // Along the crest nothing moves; the other way round it is farther.
  CHECK(error_of("zakharov-kuznetsov", joined(plane, {"scheme.frame.velocity=[1, -1]"})) ==
        Approx(laboratory).epsilon(0.01));
  CHECK(error_of("zakharov-kuznetsov", joined(plane, {"scheme.frame.velocity=[-1, -1]"})) > laboratory);
  const Folder folder;
  CHECK_THROWS_WITH(run(problem_of("zakharov-kuznetsov", {"scheme.frame.velocity=[0, 1]"}),
                        {.output = folder / "box.h5", .threads = 1}),
                    Contains("moves along y") && Contains("fourier"));
}

TEST_CASE("a frame that rests changes no bit") {
  const Folder folder;
  for (const char* scheme : {"box", "fourier"}) {
    const Settings settings = {std::string("scheme.lagrangian=") + scheme, "scheme.until=0.2"};
    static_cast<void>(run(read_problem("kdv", settings), {.output = folder / "plain.h5", .overwrite = true}));
    static_cast<void>(run(read_problem("kdv", joined(settings, {"scheme.frame.velocity=0"})),
                          {.output = folder / "frame.h5", .overwrite = true}));
    static_cast<void>(run(read_problem("kdv", joined(settings, {"scheme.frame.velocity=1e-9"})),
                          {.output = folder / "twin.h5", .overwrite = true}));
    const auto states = [&](const char* name) { return record::Reader(folder / name).read("/states/u"); };
    CHECK(states("plain.h5") == states("frame.h5"));
    CHECK(states("plain.h5") != states("twin.h5"));
  }
}

TEST_CASE("the velocity and the rate of a frame are fitted, and the record has the numbers") {
  const Problem one = read_problem("kdv", joined(soliton, {"scheme.frame.velocity=fit"}));
  REQUIRE(one.scheme.frame);
  // By midpoints of a step of h/64: c is off by its error, (h/64)²/24 of the cube of the fastest rate, about 10.
  CHECK(one.scheme.frame->velocity->front() == Approx(4.0).margin(1e-4));
  CHECK_THAT(one.text, !Contains("fit\""));
  const Problem other =
      read_problem("nls", joined(schroedinger, {"scheme.frame.velocity=fit", "scheme.frame.phase.charge=fit"}));
  const double c = 0.1 * 3.14159265358979323846;  // 4π/L
  CHECK(other.scheme.frame->velocity->front() == Approx(c).margin(1e-5));
  CHECK(*other.scheme.frame->rate == Approx(1.0 + c * c / 4.0).margin(1e-5));
  // Whatever the scheme: the trial has its own.
  const Problem split = read_problem(
      "nls", joined(schroedinger, {"scheme.lagrangian=splitting", "scheme.order=4", "scheme.space=differences",
                                   "scheme.frame.velocity=fit", "scheme.frame.phase.charge=fit"}));
  CHECK(split.scheme.frame->velocity->front() == Approx(c).margin(1e-5));
  // With the velocity given the rate alone is fitted.
  const Problem third =
      read_problem("nls", joined(schroedinger, {"scheme.frame.velocity=0.25", "scheme.frame.phase.charge=fit"}));
  CHECK(third.scheme.frame->velocity->front() == 0.25);
  // A complex unknown of [field] is the name of the symmetry of its phase.
  const auto of_field = [](const std::string& name) {
    std::string text = R"toml(
[field]
equation = "i*psi_t + psi_xx + 2*abs2(psi)*psi = 0"
psi = ["p", "q"]
[grid]
x = { from = -20, to = 20, cells = 101 }
[initial]
p = "sech(x)*cos(x/2)"
q = "sech(x)*sin(x/2)"
[scheme]
step = 0.05
until = 1
frame = { velocity = 1, phase = { NAME = "fit" } }
)toml";
    text.replace(text.find("NAME"), 4, name);
    return parse_problem(text, "field.toml");
  };
  CHECK(*of_field("psi").scheme.frame->rate == *of_field("charge").scheme.frame->rate);
  CHECK_THROWS_WITH(of_field("psi3"), Contains("did you mean") || Contains("those are"));
  // Two solitons of speeds 1.44 and 3.24: between them, nearer to the taller one.
  const Problem two = problem_of(two_solitons, {"scheme.frame.velocity=fit"});
  CHECK(two.scheme.frame->velocity->front() == Approx(3.03).margin(0.05));
}

TEST_CASE("states are of the frame; output at times, points, events and invariants are of the laboratory") {
  const Folder folder;
  const std::string file = folder / "frame.h5";
  // The crest of u = 2 sech²(x - 4 t) comes to x = 3.2 at t = 0.8, which is a level: between levels
  // output has an error of its own.
  const Settings reported = joined(
      soliton, {"scheme.frame.velocity=4", "output.times=[0.8, 1.6]",
                "output.quantities={ u = \"u\", here = { formula = \"u\", at = { x = 3.2 } }, all = \"integral(u)\" }",
                "events={ crest = { crossing = \"dx(u)\", at = { x = 3.2 }, direction = \"up\" } }",
                "invariants={ moment = \"x*u\" }"});
  const Outcome outcome = run(read_problem("kdv", reported), {.output = file, .threads = 1});
  REQUIRE(outcome.status == ExitStatus::done);
  auto reader = std::make_unique<record::Reader>(file);
  const std::vector<double> x = reader->read("/grid/x"), u = reader->read("/output/quantities/u"),
                            here = reader->read("/output/quantities/here"), crest = reader->read("/events/crest/t");
  // With its images: the period is 20.
  const auto wave = [](double place) {
    return 2.0 / std::pow(std::cosh(place), 2) + 2.0 / std::pow(std::cosh(place + 20.0), 2) +
           2.0 / std::pow(std::cosh(place - 20.0), 2);
  };
  double distance = 0.0, unmoved = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    distance = std::max(distance, std::abs(u[i] - wave(x[i] - 3.2)));
    unmoved = std::max(unmoved, std::abs(u[i] - wave(x[i])));
  }
  CHECK(distance < 1e-7);  // as the error of the run
  CHECK(unmoved > 1.0);    // the twin: it is not what the frame has
  CHECK(here[0] == Approx(2.0).margin(1e-7));
  CHECK(here[1] == Approx(wave(3.2)).margin(1e-7));
  REQUIRE(crest.size() == 1);
  CHECK(crest[0] == Approx(0.8).margin(1e-6));

  // The stored state has moved by nothing, its nodes by 4 t.
  const std::vector<double> shift = reader->read("/frame/shift"), t = reader->read("/states/t");
  CHECK(shift.back() == 4.0 * t.back());
  CHECK(largest_distance(reader->read("/states/u", 0, 1), last_row(*reader, "/states/u")) < 1e-7);
  CHECK(largest_distance(last_row(*reader, "/exact/u"), last_row(*reader, "/states/u")) < 1e-7);

  // ∫xu = 4·4t while the wave is far from the seam.
  const std::vector<double> moment = reader->read("/laws/moment"), levels = reader->read("/levels/t");
  const auto at = static_cast<std::size_t>(std::ranges::find(levels, 0.5) - levels.begin());
  REQUIRE(at < levels.size());
  CHECK(moment[at] == Approx(8.0).margin(1e-4));

  CHECK(check(file).status == ExitStatus::done);
  reader.reset();
  falsify(file, "/frame/shift", 1, 1e-9);
  CHECK(check(file).status == ExitStatus::contradiction);
}

TEST_CASE("the energy of a frame is that of the laboratory with momentum and charge, and both are told") {
  const Folder folder;
  const auto outcome = [&](const Settings& more) {
    return run(read_problem("nls", joined(schroedinger, more)),
               {.output = folder / "a.h5", .overwrite = true, .threads = 1});
  };
  const Outcome plain = outcome({}), frame = outcome({with_the_wave, with_its_phase});
  const auto& invariants = frame.statistics.invariants;
  const auto reported = std::ranges::find(invariants, "laboratory_energy", &figures::Named<figures::Deviation>::name);
  REQUIRE(reported != invariants.end());
  const double lab = plain.statistics.node_energy.initial;
  CHECK(reported->value.initial == Approx(lab).margin(1e-14));
  CHECK(frame.statistics.node_energy.initial != Approx(lab).margin(0.1));
  CHECK(frame.statistics.relative_energy_deviation().value() < 1e-13);
  CHECK(std::ranges::find(plain.statistics.invariants, "laboratory_energy",
                          &figures::Named<figures::Deviation>::name) == plain.statistics.invariants.end());
  CHECK(check(folder / "a.h5").status == ExitStatus::done);
  falsify(folder / "a.h5", "/frame/turn", 20, 1e-6);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
}

TEST_CASE("a run in a frame that is resumed has the bits of one never stopped, with variable levels, too") {
  const Folder folder;
  const Settings settings = joined(schroedinger, {with_the_wave, with_its_phase, "scheme.levels=variable"});
  static_cast<void>(run(read_problem("nls", joined(settings, {"scheme.until=1"})), {.output = folder / "whole.h5"}));
  static_cast<void>(run(read_problem("nls", joined(settings, {"scheme.until=0.5"})), {.output = folder / "part.h5"}));
  static_cast<void>(resume(folder / "part.h5", 1.0));
  const auto states = [&](const char* name) { return record::Reader(folder / name).read("/states/p"); };
  CHECK(states("whole.h5") == states("part.h5"));
}

TEST_CASE("a run begins where one in a frame was, in the laboratory or in the frame again") {
  const Folder folder;
  const std::string old = folder / "old.h5";
  const Settings first = joined(schroedinger, {with_the_wave, with_its_phase, "scheme.until=1"});
  REQUIRE(run(read_problem("nls", first), {.output = old, .threads = 1}).status == ExitStatus::done);
  const Settings from = {"-initial.p", "-initial.q", "initial.from=" + old, "initial.at=0.5"};
  const auto error_at_start = [&](const Settings& more) {
    const std::string file = folder / "new.h5";
    const Settings settings = joined(schroedinger, joined(from, joined({"scheme.until=0.6"}, more)));
    REQUIRE(run(read_problem("nls", settings), {.output = file, .overwrite = true, .threads = 1}).status ==
            ExitStatus::done);
    CHECK(check(file).status == ExitStatus::done);
    const record::Reader reader(file);
    CHECK(reader.read("/states/t").front() == Approx(0.5).margin(1e-12));
    return std::max(largest_distance(reader.read("/exact/p", 0, 1), reader.read("/states/p", 0, 1)),
                    largest_distance(reader.read("/exact/q", 0, 1), reader.read("/states/q", 0, 1)));
  };
  // Whichever frame the new one is in, and on other cells. Between nodes the waves of sech x are missing that the grid
  // does not have: exp(-πk/2) = 8e-9 for k = 151π/40, on both sides, and those beyond.
  constexpr double interpolation = 4e-8;
  CHECK(error_at_start({}) < interpolation);
  CHECK(error_at_start({with_the_wave, with_its_phase}) < interpolation);
  CHECK(error_at_start({"grid.x.cells=180"}) < interpolation);
  // The twin: rows as they are stored are far from the laboratory's.
  const record::Reader reader(old);
  const std::vector<double> t = reader.read("/states/t");
  const auto row = static_cast<std::size_t>(std::ranges::find_if(t, [](double s) { return s > 0.49; }) - t.begin());
  CHECK(largest_distance(reader.read("/states/p", row, 1), reader.read("/states/p", 0, 1)) < 1e-8);
  CHECK(error_at_start({"initial.t=0.5", "initial.at=0"}) > 0.1);
  // In two dimensions the start is what the first run reports of the laboratory there.
  const Settings plane = {"scheme.lagrangian=fourier", "scheme.frame.velocity=[0.5, -0.25]", "scheme.until=0.1",
                          "output.times=[0.1]"};
  const auto run_plane = [&](const char* name, const Settings& more) {
    REQUIRE(run(wave_on_torus(21, 15, joined(plane, more)), {.output = folder / name, .threads = 1}).status ==
            ExitStatus::done);
    return record::Reader(folder / name);
  };
  const std::vector<double> reported = run_plane("part.h5", {}).read("/output/u");
  const record::Reader next =
      run_plane("next.h5", {"-initial.u", "-initial.v", fmt::format("initial.from={}", folder / "part.h5"),
                            "scheme.until=0.2", "output.times=[0.2]"});
  CHECK(largest_distance(reported, next.read("/states/u", 0, 1)) < 1e-13);
}

TEST_CASE("the phase of a complex unknown needs no symmetry that the problem states") {
  const auto stated = [](const std::string& more) {
    return "[field]\nequation = \"i*psi_t + psi_xx + 2*abs2(psi)*psi = 0\"\npsi = [\"p\", \"q\"]\n"
           "[grid]\nx = { from = -20, to = 20, cells = 151 }\n[parameters]\nc = \"pi/10\"\n"
           "[initial]\np = \"sech(x)*cos(c*x/2)\"\nq = \"sech(x)*sin(c*x/2)\"\n"
           "[exact]\np = \"sech(x - c*t)*cos(c*x/2 + (1 - c^2/4)*t)\"\n" +
           more + "[scheme]\nlagrangian = \"fourier\"\nlevels = \"fixed\"\nstep = 0.05\nuntil = 2\n";
  };
  const std::string frame = "scheme.frame={ velocity = \"c\", phase = { psi = \"1 + c^2/4\" } }";
  CHECK(error_of(stated(""), {frame}) < 1e-8);
  CHECK(error_of(stated(""), {}) > 1e-4);
  // One that is stated is not found again.
  const auto names = [](const Problem& problem) {
    std::vector<std::string> result;
    std::ranges::transform(problem.multisymplectic()->symmetries, std::back_inserter(result), &StatedSymmetry::name);
    return result;
  };
  CHECK(names(problem_of(stated(""), {})) == std::vector<std::string>{"charge"});
  CHECK(names(problem_of(stated("[symmetries]\nturn = [[\"p\", \"q\", -2], [\"q\", \"p\", 2], [\"p_x\", \"q_x\", -2], "
                                "[\"q_x\", \"p_x\", 2]]\n"),
                         {})) == std::vector<std::string>{"turn"});
}

/// The catalogue's kink alone on a ring, which its frame holds at rest.
const Settings lone_kink = {"scheme.lagrangian=fourier", "scheme.step=0.1", "scheme.until=8"};
constexpr const char* with_the_kink = "scheme.frame.velocity=c";

TEST_CASE("a kink that rests in its frame jumps there as in the laboratory, and has no error of the step") {
  const double laboratory = error_of("sine-gordon-kink", lone_kink);
  CHECK(laboratory > 1e-4);
  // What is left is that of 151 nodes, and of the elliptic function.
  CHECK(error_of("sine-gordon-kink", joined(lone_kink, {with_the_kink})) < 1e-9);
  // Twins: the other way round, and the unchanged equation at the moving nodes.
  CHECK(error_of("sine-gordon-kink", joined(lone_kink, {"scheme.frame.velocity=-c"})) > laboratory);
  const Problem fitted = read_problem("sine-gordon-kink", joined(lone_kink, {"scheme.frame.velocity=fit"}));
  CHECK(fitted.scheme.frame->velocity->front() == Approx(0.5).margin(1e-4));
}

TEST_CASE("of a field that jumps in a frame, output, laws and pages are of the laboratory") {
  const Folder folder;
  const std::string file = folder / "kink.h5";
  // To t = 40 the kink goes round the ring of length 8.4 more than once, and u falls by 2 pi where it has passed.
  const Settings settings =
      joined(lone_kink, {with_the_kink, "scheme.until=40", "output.times=[8, 23, 40]",
                         "output.quantities={ error = \"u - (pi + 2*am(g*(x - c*t)/sqrt(m), m))\", "
                         "unmoved = \"u - (pi + 2*am(g*x/sqrt(m), m))\", slope = \"dx(u) - w\", "
                         "all = \"integral(w)/(2*pi)\", sum = \"integral(u)\" }"});
  const Outcome outcome = run(read_problem("sine-gordon-kink", settings), {.output = file, .threads = 1});
  REQUIRE(outcome.status == ExitStatus::done);
  const auto largest = [&](const char* path) { return grids::max_abs(record::Reader(file).read(path)); };
  CHECK(largest("/output/quantities/error") < 1e-8);
  CHECK(largest("/output/quantities/unmoved") > 6.0);  // the twin
  CHECK(largest("/output/quantities/slope") < 1e-8);
  for (const double charge : record::Reader(file).read("/output/quantities/all")) {
    CHECK(charge == Approx(1.0).margin(1e-12));
  }
  // ∫u over the ring falls by 2 pi c in a unit of time.
  const std::vector<double> sum = record::Reader(file).read("/output/quantities/sum");
  CHECK(sum[2] - sum[0] == Approx(-2.0 * std::numbers::pi * 0.5 * 32.0).epsilon(1e-12));

  CHECK(check(file).status == ExitStatus::done);

  // The energy of the frame is H + cP with that of the whole field.
  const Outcome plain = run(read_problem("sine-gordon-kink", lone_kink), {.output = folder / "plain.h5"});
  const auto value_of = [](const auto& list, const char* name) {
    const auto found = std::ranges::find_if(list, [&](const auto& one) { return one.name == name; });
    REQUIRE(found != list.end());
    return found->value.initial;
  };
  const double energy = plain.statistics.node_energy.initial, momentum = value_of(plain.statistics.totals, "momentum");
  CHECK(value_of(outcome.statistics.invariants, "laboratory_energy") == Approx(energy).epsilon(1e-12));
  CHECK(value_of(outcome.statistics.totals, "momentum") == Approx(momentum).epsilon(1e-12));
  CHECK(outcome.statistics.node_energy.initial == Approx(energy + 0.5 * momentum).epsilon(1e-12));
  CHECK(std::abs(momentum) > 0.1);

  const auto codes = [&](const Settings& more) {
    const std::string drawn = folder / "drawn.h5";
    static_cast<void>(run(
        read_problem("sine-gordon-kink", joined(lone_kink, joined({"scheme.until=20", "scheme.levels=fixed"}, more))),
        {.output = drawn, .overwrite = true, .threads = 1}));
    return sample::numbers_after(report::page(record::Reader(drawn)),
                                 {R"("maps":)", R"("name":"u","group":"field")", R"("values":)"});
  };
  const std::vector<double> resting = codes({}), moving = codes({with_the_kink});
  // Nodes are shown at the nearest one, half a spacing of 0.056 off, where u rises by 2.3 a unit: 0.064 of a range of
  // 13.8, in codes to 65,535.
  CHECK(largest_distance(resting, moving) < 600.0);
}

TEST_CASE("a run of a kink in its frame is resumed to the same bits, and begins others") {
  const Folder folder;
  const Settings settings = joined(lone_kink, {with_the_kink, "scheme.levels=variable"});
  const auto make = [&](const char* name, const Settings& more) {
    return run(read_problem("sine-gordon-kink", joined(settings, more)), {.output = folder / name, .threads = 1})
        .status;
  };
  REQUIRE(make("whole.h5", {}) == ExitStatus::done);
  REQUIRE(make("part.h5", {"scheme.until=4"}) == ExitStatus::done);
  static_cast<void>(resume(folder / "part.h5", 8.0));
  const auto states = [&](const char* name) { return record::Reader(folder / name).read("/states/u"); };
  CHECK(states("whole.h5") == states("part.h5"));

  // In the laboratory again, from t = 8: the error is that of its own short steps, not 2 pi at the nodes passed.
  const std::string next = folder / "next.h5";
  const Outcome outcome =
      run(read_problem("sine-gordon-kink",
                       joined(lone_kink, {"-initial.u", "-initial.v", "initial.from=" + (folder / "whole.h5"),
                                          "scheme.step=0.001", "scheme.until=8.01", "scheme.stages=2"})),
          {.output = next, .threads = 1});
  REQUIRE(outcome.status == ExitStatus::done);
  CHECK(outcome.statistics.errors.front().value.largest() < 1e-7);
}

TEST_CASE("the page of a run in a frame is of the laboratory") {
  const Folder folder;
  const auto page_of = [&](const Settings& more) {
    const std::string file = folder / "a.h5";
    const Settings settings = joined(schroedinger, joined({"scheme.until=2"}, more));
    static_cast<void>(run(read_problem("nls", settings), {.output = file, .overwrite = true, .threads = 1}));
    return report::page(record::Reader(file));
  };
  const auto codes = [](const std::string& page) {
    return sample::numbers_after(page, {R"("maps":)", R"("name":"q","group":"field")", R"("values":)"});
  };
  const std::string turning = "scheme.frame={ velocity = 0, phase = { charge = 1 } }";
  const std::vector<double> plain = codes(page_of({}));
  // Of 65,535 codes: errors of a few thousandths of the field, and of the range of codes.
  CHECK(largest_distance(plain, codes(page_of({turning}))) < 1000.0);
  CHECK(largest_distance(plain, codes(page_of({"scheme.frame={ velocity = 0, phase = { charge = -1 } }"}))) < 1000.0);
  // The twin: half a period away.
  CHECK(largest_distance(plain, codes(page_of({"scheme.frame.velocity=0", "initial.p=-sech(x)"}))) > 10000.0);
  // With quantities at times of their own, which are of the laboratory already, and with few fields stored.
  CHECK(codes(page_of({turning, "output.times=[0.5, 1]", "output.quantities={ d = \"p^2 + q^2\" }"})).size() ==
        plain.size());
  CHECK_FALSE(codes(page_of({turning, "output.states=false"})).empty());
}

TEST_CASE("ranks share a lattice in a frame") {
  const Folder folder;
  const Settings settings = {"scheme.lagrangian=fourier", "scheme.frame.velocity=[0.5, -0.25]",
                             "output.times=[0.1, 0.25]", "invariants.mass=u^2 + sin(x)*u"};
  const Problem problem = wave_on_torus(20, 15, settings);
  const Outcome one = run(problem, {.output = folder / "one.h5", .threads = 1});
  REQUIRE(one.status == ExitStatus::done);
  const Outcome all = with_ranks(3, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
  CHECK(all.status == ExitStatus::done);
  const auto read = [&](const char* name, const char* path) { return record::Reader(folder / name).read(path); };
  // Transforms of several ranks round otherwise; each of the few steps is solved to some roundings.
  for (const char* path : {"/output/u", "/states/u", "/laws/mass", "/frame/shift"}) {
    INFO(path);
    CHECK(largest_distance(read("one.h5", path), read("all.h5", path)) < 1e-11);
  }
  CHECK(check(folder / "all.h5").status == ExitStatus::done);
}

TEST_CASE("a frame that cannot be is refused, with place and remedy") {
  const auto message = [](const std::string& name, const Settings& settings) {
    try {
      static_cast<void>(read_problem(name, settings));
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK_THAT(message("kdv", {"scheme.frame.velocity=[1, 2]"}),
             Contains("velocity has 2 components") && Contains("1 direction"));
  CHECK_THAT(message("kdv", {"scheme.frame.velocity=\"best\""}), Contains("best"));
  CHECK_THAT(message("kdv", {"scheme.frame.speed=4"}), Contains("speed") && Contains("velocity"));
  CHECK_THAT(message("nls", {"scheme.frame.phase.chrage=1"}), Contains("did you mean charge?"));
  CHECK_THAT(message("kdv", {"scheme.frame.phase.charge=1"}),
             Contains("no entry of [symmetries]") && Contains("state it there"));
  CHECK_THAT(message("sine-gordon-2d", {"scheme.frame.velocity=1"}), Contains("such as [1, 0]"));
  CHECK_THAT(message("trapped-condensate", {"scheme.frame.velocity=1"}), Contains("S names x"));
  CHECK_THAT(message("pendulum", {"scheme.frame.velocity=1"}), Contains("frame is for lattices"));
  // Waves of which S names no value: they may jump, and turn into each other, but not both.
  const auto refusal = [](const Settings& settings) {
    constexpr const char* two_waves = R"toml(
[multisymplectic]
fields = ["a", "b", "a_t", "b_t", "a_x", "b_x"]
M = [["a", "a_t", -1], ["b", "b_t", -1]]
K.x = [["a", "a_x", 1], ["b", "b_x", 1]]
S = "(a_t^2 + b_t^2 - a_x^2 - b_x^2)/2"
[symmetries]
turn = [["a", "b", 1], ["b", "a", -1], ["a_t", "b_t", 1], ["b_t", "a_t", -1], ["a_x", "b_x", 1], ["b_x", "a_x", -1]]
[grid]
x = { from = 0, to = 6, cells = 31 }
[initial]
a = "x/6"
b = 0
a_t = 0
b_t = 0
[scheme]
lagrangian = "fourier"
step = 0.1
until = 1
)toml";
    try {
      static_cast<void>(parse_problem(two_waves, "waves.toml", settings));
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK_THAT(refusal({"grid.x.jump.a=1", "scheme.frame={ phase = { turn = 0.1 } }"}),
             Contains("turn turns the field a, which jumps"));
  CHECK(refusal({"grid.x.jump.a=1", "scheme.frame.velocity=0.1"}).empty());
  CHECK(message("kdv", {"scheme.frame.velocity=1"}).empty());
}
