// [lagrangian]: problems stated by L(q, q_dot), from the file to the record and back.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/record_notes.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

/// A particle in a field that is not uniform; the tests change one thing in it.
const std::string magnetic = R"toml(title = "T"
[lagrangian]
q = ["r[2]"]
L = "(r1_dot^2 + r2_dot^2)/2 + (r1 + r1^3/3)*r2_dot - w*(r1^2 + 2*r2^2)"
[parameters]
w = 0.25
[initial]
r = [0.5, 0.2]
r_dot = [0.1, "w + 0.35"]
[scheme]
step = 0.1
until = 20
)toml";

/// The same by H.
const std::string magnetic_by_H = R"toml(title = "T"
[hamiltonian]
q = ["r[2]"]
p = ["u", "v"]
H = "(u^2 + (v - r1 - r1^3/3)^2)/2 + (r1^2 + 2*r2^2)/4"
[initial]
r = [0.5, 0.2]
u = 0.1
v = "0.6 + 0.5 + 0.5^3/3"
[scheme]
step = 0.1
until = 20
)toml";

const std::string oscillator = R"toml([lagrangian]
q = ["x"]
L = "x_dot^2/2 - x^2/2"
[initial]
x = 1
x_dot = 0
[invariants]
energy = "x*x/2 + x_dot*p_x/2"
[exact]
x = "cos(t)"
x_dot = "-sin(t)"
[scheme]
step = 0.1
until = 20
)toml";

std::string complaint(const std::string& text, const std::vector<std::string>& settings = {}) {
  try {
    static_cast<void>(parse_problem(text, "f.toml", settings));
    return "";
  } catch (const ProblemError& error) {
    return error.what();
  }
}

Outcome run_text(const std::string& text, const std::string& file, const std::vector<std::string>& settings = {}) {
  return run(parse_problem(text, "f.toml", settings), {.output = file, .overwrite = true});
}

using Settings = std::vector<std::string>;
const std::vector<Settings> schemes = {{"scheme.lagrangian=midpoint"},
                                       {"scheme.lagrangian=trapezoid"},
                                       {"scheme.lagrangian=lobatto", "scheme.stages=3"},
                                       {"scheme.lagrangian=gauss", "scheme.stages=2"}};

Settings with(Settings settings, const Settings& more) {
  settings.insert(settings.end(), more.begin(), more.end());
  return settings;
}

}  // namespace

TEST_CASE("velocities and momenta of a problem stated by L have the names of its coordinates", "[run]") {
  const Problem problem = parse_problem(magnetic, "f.toml");
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  CHECK(orbit.q == Names{"r1", "r2"});
  CHECK(orbit.q_dot == Names{"r1_dot", "r2_dot"});
  CHECK(orbit.p == Names{"p_r1", "p_r2"});
  CHECK(orbit.initial.q_dot == std::vector<double>{0.1, 0.6});
  CHECK(std::abs(orbit.initial.p[1] - (0.6 + 0.5 + 0.125 / 3)) < 1e-15);
  // Given one by one, and from the effective text, it is the same.
  const Problem again =
      parse_problem(replaced(magnetic, "r_dot = [0.1, \"w + 0.35\"]", "r2_dot = 0.6\nr1_dot = 0.1"), "f.toml");
  CHECK(again.hamiltonian()->initial.p == orbit.initial.p);
  CHECK(parse_problem(problem.text, "f.toml").hamiltonian()->initial.p == orbit.initial.p);
  CHECK(parse_problem(magnetic, "f.toml", Settings{"initial.r_dot=[0,0]"}).hamiltonian()->initial.p[0] == 0.0);
  CHECK(read_problem("double-pendulum").hamiltonian()->L.has_value());
  const std::string from_catalogue =
      "[lagrangian]\nsystem = \"double-pendulum\"\n[initial]\na = 1\nb = 0\na_dot = 0\nb_dot = 0\n"
      "[scheme]\nstep = 0.1\nuntil = 1\n";
  CHECK(parse_problem(from_catalogue, "f.toml").hamiltonian()->q_dot == Names{"a_dot", "b_dot"});
  CHECK_THAT(complaint(replaced(from_catalogue, "[lagrangian]", "[hamiltonian]")), Contains("it is not of this kind"));
}

TEST_CASE("an orbit stated by L is the one stated by H", "[run]") {
  const Folder folder;
  for (const char* scheme : {"midpoint", "gauss"}) {
    Settings settings = {std::string("scheme.lagrangian=") + scheme};
    if (settings[0].ends_with("gauss")) {
      settings.emplace_back("scheme.stages=3");
      settings.emplace_back("scheme.levels=fixed");  // the law of order 6 fixes h to a few digits only
    } else {
      settings.emplace_back(
          "scheme.step_potential=none");  // a potential's strength is as accurate as the estimate of η
    }
    const Outcome by_L = run_text(magnetic, folder / "l.h5", settings);
    const Outcome by_H = run_text(magnetic_by_H, folder / "h.h5", settings);
    REQUIRE(by_L.status == ExitStatus::done);
    REQUIRE(by_L.statistics.steps == by_H.statistics.steps);
    const record::Reader l(folder / "l.h5"), h(folder / "h.h5");
    for (const char* dataset : {"/states/q", "/states/p", "/levels/h", "/levels/energy", "/levels/node_energy"}) {
      const std::vector<double> a = l.read(dataset), b = h.read(dataset);
      double largest = 0.0;
      for (std::size_t i = 0; i < a.size(); ++i) {
        largest = std::max(largest, std::abs(a[i] - b[i]));
      }
      INFO(scheme << dataset << ": " << largest);
      // A step's length is the root of E(h) = E, which rounding moves by 1e-16/|dE/dh|; 200 steps of it.
      CHECK(largest < 1e-9);
    }
    // The twin: another quadrature is another orbit.
    REQUIRE(run_text(magnetic, folder / "l.h5", {"scheme.lagrangian=trapezoid", "scheme.levels=fixed"}).status ==
            ExitStatus::done);
    CHECK(record::Reader(folder / "l.h5").read("/states/q").back() != Approx(h.read("/states/q").back()));
  }
}

TEST_CASE("runs of every quadrature keep their energy, and check makes their records anew", "[run]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  for (const Settings& scheme : schemes) {
    for (const char* every : {"1", "7"}) {
      INFO(scheme[0] << ", every " << every);
      const Outcome ran = run_text(magnetic, file, with(scheme, {std::string("output.every=") + every}));
      REQUIRE(ran.status == ExitStatus::done);
      CHECK(ran.statistics.relative_energy_deviation() < 1e-13);
      const Outcome checked = check(file);
      CHECK(checked.status == ExitStatus::done);
      CHECK(differences(ran, checked) == Names{});
      CHECK(checked.statistics.residuals.at(0).value.largest() < 1e-13);
    }
  }
  for (const char* dataset : {"/states/q", "/states/p", "/states/q_dot", "/levels/energy", "/levels/node_energy"}) {
    REQUIRE(run_text(magnetic, file, schemes[2]).status == ExitStatus::done);
    falsify(file, dataset, 20, 1e-9);
    INFO(dataset);
    CHECK(check(file).status == ExitStatus::contradiction);
  }
}

TEST_CASE("a run stated by L that was resumed is the one that never stopped", "[run]") {
  const Folder folder;
  for (const Settings& scheme : schemes) {
    INFO(scheme[0]);
    REQUIRE(run_text(magnetic, folder / "whole.h5", scheme).status == ExitStatus::done);
    REQUIRE(run_text(magnetic, folder / "part.h5", with(scheme, {"scheme.until=7"})).status == ExitStatus::done);
    REQUIRE(resume(folder / "part.h5", 20.0, {}).status == ExitStatus::done);
    CHECK(different_datasets(folder / "whole.h5", folder / "part.h5") == Names{});
  }
}

TEST_CASE("invariants and exact solutions of a problem stated by L may name velocities and momenta", "[run]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Outcome ran = run_text(oscillator, file, {"scheme.lagrangian=gauss", "scheme.stages=4"});
  REQUIRE(ran.status == ExitStatus::done);
  REQUIRE(ran.statistics.errors.size() == 2);
  // Gauss with four stages, h = 0.1: phase errors of h^8 t/(8!)-like size, below 1e-11.
  CHECK(ran.statistics.errors[0].name == "x");
  CHECK(ran.statistics.errors[1].name == "x_dot");
  for (const auto& error : ran.statistics.errors) {
    CHECK(error.value.largest() < 1e-11);
  }
  CHECK(check(file).status == ExitStatus::done);
  const record::Reader reader(file);
  CHECK(std::abs(reader.read("/laws/energy").back() - 0.5) < 1e-13);
  CHECK(reader.read_strings("/states/velocity") == Names{"x_dot"});
  const std::vector<double> q = reader.read("/states/q"), v = reader.read("/states/q_dot"),
                            p = reader.read("/states/p");
  for (std::size_t k = 0; k < v.size(); ++k) {
    REQUIRE(std::abs(v[k] - p[k]) < 1e-15);  // L = x_dot^2/2 - …
  }
  CHECK(v != q);
  CHECK_NOTHROW(notes_on(reader));
}

TEST_CASE("definitions serve L, invariants and exact solutions", "[run]") {
  const std::string defined = replaced(replaced(oscillator, "x_dot^2/2 - x^2/2", "kinetic - x^2/2"), "[initial]",
                                       "[definitions]\nkinetic = \"x_dot^2/2\"\nswing = \"cos(t)\"\n[initial]");
  const Folder folder;
  REQUIRE(run_text(defined, folder / "a.h5").status == ExitStatus::done);
  REQUIRE(run_text(oscillator, folder / "b.h5").status == ExitStatus::done);
  CHECK(record::Reader(folder / "a.h5").read("/states/q") == record::Reader(folder / "b.h5").read("/states/q"));
}

TEST_CASE("a problem stated by L starts from the record of another", "[run]") {
  const Folder folder;
  REQUIRE(run_text(magnetic, folder / "a.h5").status == ExitStatus::done);
  const record::Reader reader(folder / "a.h5");
  const std::string from = replaced(replaced(magnetic, "r = [0.5, 0.2]", "from = \"" + (folder / "a.h5") + "\""),
                                    "r_dot = [0.1, \"w + 0.35\"]", "r2_dot = 0.25");
  const Problem problem = parse_problem(from, "f.toml", Settings{"scheme.until=30"});
  const PhasePoint& start = problem.hamiltonian()->initial;
  const std::vector<double> q = reader.read("/states/q"), v = reader.read("/states/q_dot");
  CHECK(start.q == std::vector<double>(q.end() - 2, q.end()));
  CHECK(start.q_dot == std::vector<double>{v[v.size() - 2], 0.25});
  CHECK(start.t == reader.read("/states/t").back());
  REQUIRE(run_text(magnetic_by_H, folder / "h.h5").status == ExitStatus::done);
  CHECK_THAT(complaint(replaced(from, "/a.h5", "/h.h5")), Contains("stated by L"));
}

TEST_CASE("step = auto works for a problem stated by L", "[run]") {
  const Folder folder;
  const Outcome ran = run_text(
      replaced(replaced(oscillator, "- x^2/2", "+ cos(x)"), "step = 0.1", "step = \"auto\"\nenergy_tolerance = 1e-4"),
      folder / "a.h5", schemes[0]);
  REQUIRE(ran.status == ExitStatus::done);
  // The tolerance is about E, near which H(z_k) stays; from its first value it strays at most twice as far.
  CHECK(ran.statistics.node_energy.max() < 2e-4);
  CHECK(ran.statistics.node_energy.max() > 1e-6);
}

TEST_CASE("a problem stated by L with one thing wrong is refused at that place", "[run][bad input]") {
  REQUIRE(complaint(magnetic).empty());
  struct Case {
    std::string from, to, where, what;
  };
  const std::string L = "(r1_dot^2 + r2_dot^2)/2 + (r1 + r1^3/3)*r2_dot - w*(r1^2 + 2*r2^2)";
  for (const Case& c : std::vector<Case>{
           // tables and keys
           {"[lagrangian]", "[hamiltonian]", "2:2", "[hamiltonian] needs p"},
           {"[lagrangian]", "[lagranjian]", "2:2", "did you mean lagrangian?"},
           {"[parameters]", "[hamiltonian]\nq = [\"q\"]\n[parameters]", "2:2", "in one problem; keep one of them"},
           {"[parameters]", "[multisymplectic]\n[parameters]", "5:2", "[lagrangian] and [multisymplectic]"},
           {"q = [\"r[2]\"]", "q = [\"r[2]\"]\np = [\"u\", \"v\"]", "4:1", "momenta follow from L"},
           {"q = [\"r[2]\"]", "q = [\"r[2]\"]\nq_dot = [\"u\", \"v\"]", "4:1", "with _dot"},
           {"L = ", "H = ", "4:1", "stated by L"},
           {"L = \"" + L + "\"\n", "", "2:2", "[lagrangian] needs L"},
           {"q = [\"r[2]\"]\n", "", "2:2", "[lagrangian] needs q"},
           {"q = ", "time_scale = \"r1\"\nq = ", "3:1", "time_scale is for problems stated by H"},
           {"step =", "time_scale = \"r1\"\nstep =", "11:1", "time_scale is for problems stated by H"},
           {"[scheme]", "[grid]\n[scheme]", "10:2", "belongs to a [multisymplectic] problem"},
           // names
           {"q = [\"r[2]\"]", "q = [\"r1\", \"r1_dot\"]", "3:5", "\"r1_dot\" cannot name a velocity: it is already"},
           {"w = 0.25", "w = 0.25\np_r1 = 1", "7:1", "it is already a momentum"},
           {"w = 0.25", "w = 0.25\nr2_dot = 1", "7:1", "it is already a velocity"},
           {"q = [\"r[2]\"]", "q = [\"t\"]", "3:7", "it is the time"},
           // L
           {"(r1_dot^2", "(r_dot^2", "4:7", "the velocities of its components are r1_dot, r2_dot"},
           {"(r1_dot^2", "(r1dot^2", "4:7", "did you mean 'r1_dot'?"},
           {"(r1_dot^2", "(p_r1^2", "4:7", "unknown name 'p_r1'"},
           {"w*(r1^2", "w*(t^2", "4:58", "unknown name 't'"},
           {"r2_dot^2)/2", "r2_dot^2/2", "4:6", "never closed"},
           {L, "r1_dot^2/2 - r1^2*r2", "4:6", "no second derivative by r2_dot"},
           {L, "(r1_dot + r2_dot)^2 - r1^2", "4:6", "resists a change of the velocities along"},
           {L, "r1*r2_dot - r1^2 - r2^2", "4:6", "state H in [hamiltonian]"},
           {L, "r1", "4:6", "L is singular"},
           {L, "log(r1 - 0.5) + r1_dot^2 + r2_dot^2", "7:2", "not finite at the initial state"},
           // the start
           {"r_dot = [0.1, \"w + 0.35\"]\n", "", "7:2",
            "gives no value for r1_dot, r2_dot; every coordinate and velocity"},
           {"r_dot = [0.1, \"w + 0.35\"]", "p_r = [0.1, 0.2]", "9:1", "momenta follow; give r1_dot, r2_dot"},
           {"r_dot = [0.1, \"w + 0.35\"]", "p = 0.1", "9:1", "momenta follow"},
           {"r_dot = [0.1, \"w + 0.35\"]", "r_dto = [0.1, 0.2]", "9:1", "did you mean r_dot?"},
           {"r_dot = [0.1, \"w + 0.35\"]", "r_dot = [0.1]", "9:9",
            "r_dot has 1 values, and was declared as r_dot[2]: give 2, one number for all"},
           {"r_dot = [0.1, \"w + 0.35\"]", "r_dot = true", "9:9", "r1_dot: expected a number"},
           {"[scheme]", "[initial.next]\nt = 0.1\n[scheme]", "10:10", "[initial.next] begins a two-step form"},
           {"[initial]", "[start]", "7:2", "unknown table start"},
           // schemes
           {"step =", "lagrangian = \"splitting\"\nstep =", "11:15",
            "is for ODEs ([hamiltonian]); here it may be \"midpoint\""},
           {"step =", "lagrangian = \"fourier\"\nstep =", "11:15", "is for lattices"},
           {"step =", "lagrangian = \"trapezium\"\nstep =", "11:15", "trapezoid"},
           {"step =", "lagrangian = \"lobatto\"\nstep =", "10:2", "needs stages, its points, from 2 to 9"},
           {"step =", "lagrangian = \"lobatto\"\nstages = 1\nstep =", "12:10", "2 to 9 points"},
           {"step =", "lagrangian = \"lobatto\"\nstages = 10\nstep =", "12:10", "2 to 9 points"},
           {"step =", "lagrangian = \"lobatto\"\norder = 4\nstep =", "12:1", "write stages, half the order and one"},
           {"step =", "lagrangian = \"gauss\"\nstep =", "10:2", "needs stages, from 1 to 8"},
           {"step =", "lagrangian = \"gauss\"\nstages = 9\nstep =", "12:10", "1 to 8 stages"},
           {"step =", "stages = 3\nstep =", "11:1", "\"gauss\" and \"lobatto\", and this problem has \"midpoint\""},
           {"step =", "L = \"q_0\"\nstep =", "11:1", "L applies to lagrangian = \"custom\""},
       }) {
    INFO(c.from << " -> " << c.to);
    CHECK_THAT(complaint(replaced(magnetic, c.from, c.to)),
               Catch::StartsWith("f.toml:" + c.where + ": ") && Contains(c.what));
  }
  for (const char* word : {"trapezoid", "lobatto"}) {
    CHECK_THAT(complaint(pendulum, {std::string("scheme.lagrangian=") + word}),
               Contains("is for problems stated by L ([lagrangian])"));
  }
}
