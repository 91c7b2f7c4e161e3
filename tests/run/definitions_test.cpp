// [definitions]: formulas with a name, which stand for what they say wherever that is known.

#include <catch2/catch.hpp>

#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/problem.hpp>
#include <rubato/run/check.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

std::string refusal(const std::string& text, const std::vector<std::string>& settings = {}) {
  try {
    static_cast<void>(parse_problem(text, "t.toml", settings));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

/// The pendulum with what is put before [parameters].
std::string with(const std::string& definitions, const std::string& H = "p^2/2 - cos(q)") {
  return replaced(replaced(pendulum, "p^2/2 - cos(q)", H), "[parameters]",
                  "[definitions]\n" + definitions + "[parameters]");
}

Outcome run_text(const std::string& text, const std::string& file) {
  RunOptions options;
  options.output = file;
  return run(parse_problem(text, "t.toml"), options);
}

}  // namespace

TEST_CASE("a definition stands for its formula, bit by bit, on orbits") {
  const Folder folder;
  const std::string plain = replaced(pendulum, "[scheme]", "[invariants]\nI = \"p^2/2\"\n[scheme]");
  const std::string named = replaced(with("V = \"k*U\"\nT = \"p^2/2\"\nU = \"-cos(q)\"\nstart = \"1.9*k\"\n", "T + V"),
                                     "p = 1.9", "p = \"start\"");
  const Outcome a = run_text(plain, folder / "a.h5");
  const Outcome b = run_text(replaced(named, "[scheme]", "[invariants]\nI = \"T\"\n[scheme]"), folder / "b.h5");
  REQUIRE(a.status == ExitStatus::done);
  REQUIRE(b.status == ExitStatus::done);
  CHECK(differences(a, b) == Names{});
  // The twin: another definition is another orbit.
  const Outcome c = run_text(replaced(replaced(named, "k*U", "2*U"), "[scheme]", "[invariants]\nI = \"T\"\n[scheme]"),
                             folder / "c.h5");
  CHECK(differences(a, c) != Names{});
}

TEST_CASE("a definition stands for its formula on lattices: in S, densities, initial data and exact solutions") {
  const Folder folder;
  const std::string short_run =
      replaced(replaced(replaced(breather, "until = 20", "until = 0.5"), "cells = 401", "cells = 101"),
               "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", "");
  std::string named = replaced(short_run, "[parameters]", R"toml([definitions]
waves = "(v^2 - w^2)/2"
potential = "1 - cos(u)"
shape = "sech(gamma*x)"
breathing = "gamma/omega*sin(omega*t)*shape"
slope = "w/(2*pi)"
[parameters])toml");
  named = replaced(named, "(v^2 - w^2)/2 + 1 - cos(u)\"\n[grid]", "waves + potential\"\n[grid]");
  named = replaced(named, "4*gamma*sech(gamma*x)", "4*gamma*shape");
  named = replaced(named, "4*atan(gamma/omega*sin(omega*t)*sech(gamma*x))", "4*atan(breathing)");
  named = replaced(named, "topological_charge = \"w/(2*pi)\"", "topological_charge = \"slope\"");
  const Outcome a =
      run_text(replaced(short_run, "(v^2 - w^2)/2 + 1 - cos(u)", "(v^2 - w^2)/2 + (1 - cos(u))"), folder / "a.h5");
  const Outcome b = run_text(named, folder / "b.h5");
  REQUIRE(a.status == ExitStatus::done);
  REQUIRE(b.status == ExitStatus::done);
  CHECK(differences(a, b) == Names{});
}

TEST_CASE("densities of a lattice may name its coordinates and the time") {
  const Folder folder;
  const std::string text =
      replaced(replaced(replaced(replaced(breather, "until = 20", "until = 0.5"), "cells = 401", "cells = 101"),
                        "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", ""),
               "topological_charge = \"w/(2*pi)\"", "width = \"x^2*v^2\"\nclock = \"t + 1\"");
  const Outcome ran = run_text(text, folder / "a.h5");
  REQUIRE(ran.status == ExitStatus::done);
  REQUIRE(ran.statistics.invariants.size() == 2);
  const double gamma = std::sqrt(0.75), dx = 40.0 / 101.0;
  double width = 0.0;
  for (int i = 0; i < 101; ++i) {
    const double x = -20.0 + i * dx, v = 4.0 * gamma / std::cosh(gamma * x);
    width += dx * x * x * v * v;
  }
  CHECK(ran.statistics.invariants[0].value.initial == Approx(width).epsilon(1e-12));
  CHECK(ran.statistics.invariants[1].value.initial == Approx(40.0).epsilon(1e-12));
  CHECK(ran.statistics.invariants[1].value.max() == Approx(40.0 * ran.statistics.t).epsilon(1e-12));
  const Outcome checked = check(folder / "a.h5");
  CHECK(checked.status == ExitStatus::done);
  CHECK(differences(ran, checked) == Names{});
}

TEST_CASE("vectors are as long as a parameter, and started by one formula of their index") {
  const std::vector<std::string> settings = {"parameters.N=5"};
  const Problem chain = read_problem("fput-chain", settings);
  const PhasePoint& start = chain.hamiltonian()->initial;
  REQUIRE(start.q.size() == 5);
  for (std::size_t i = 0; i < 5; ++i) {
    CHECK(start.q[i] == std::sin(static_cast<double>(i + 1) * std::acos(-1.0) / 6.0));
    CHECK(start.p[i] == 0.0);
  }
  const auto wrong = [](const char* setting) {
    try {
      static_cast<void>(read_problem("fput-chain", std::vector<std::string>{setting}));
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK_THAT(wrong("parameters.N=0"), Contains("a vector has from 1 to"));
  CHECK_THAT(wrong("parameters.N=20.5"), Contains("or the name of an integer in [parameters]"));
  CHECK_THAT(wrong("initial.q=sin(j)"), Contains("unknown name 'j'"));
}

TEST_CASE("what is wrong with a definition is told at its place") {
  CHECK_THAT(refusal(with("T = \"p^2/2 +\"\n")), Contains("t.toml:7:13: a number, name or ( is missing"));
  CHECK_THAT(refusal(with("T = \"p^2/m\"\n")), Contains("t.toml:7:10: unknown name 'm'"));
  CHECK_THAT(refusal(with("a = \"b\"\nb = \"c*q\"\nc = \"a\"\n")),
             Contains("definitions depend on each other in a cycle: a -> b -> c -> a"));
  CHECK_THAT(refusal(with("k = \"q\"\n")), Contains("\"k\" cannot name a definition: it is already a parameter"));
  CHECK_THAT(refusal(with("q = \"p\"\n")), Contains("\"q\" cannot name a definition: it is already a coordinate"));
  CHECK_THAT(refusal(with("sin = \"p\"\n")), Contains("it is a function"));
  CHECK_THAT(refusal(with("T = [1]\n")), Contains("t.toml:7:5: T: expected a formula or a number"));
  // Known where it is defined, and not where it is used.
  const std::string at_start = refusal(replaced(with("T = \"p^2/2\"\n"), "p = 1.9", "p = \"T\""));
  CHECK_THAT(at_start,
             Contains("t.toml:7:6: unknown name 'p'") && Contains("in the definition of T, which is used at t.toml:"));
  CHECK_THAT(refusal(pendulum, {"definitions.T=p"}), Contains("nothing called T in [definitions]"));
  CHECK(refusal(with("T = \"p^2/2\"\n", "T - cos(q)"), {"definitions.T=p^2"}).empty());
}
