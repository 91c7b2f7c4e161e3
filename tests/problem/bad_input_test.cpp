#include <catch2/catch.hpp>
#include <fstream>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>

#include "problem_texts.hpp"

namespace {

using namespace rubato;
using namespace rubato::run_tests;

/// What reading `text` says, or "" if nothing is wrong with it.
std::string complaint(const std::string& text, const std::vector<std::string>& settings = {}) {
  try {
    static_cast<void>(parse_problem(text, "f.toml", settings));
    return "";
  } catch (const ProblemError& error) {
    return error.what();
  }
}

std::string in_parentheses(const std::string& formula, std::size_t pairs) {
  std::string text(pairs, '(');
  text += formula;
  text.append(pairs, ')');
  return text;
}

struct Case {
  std::string from, to;
  std::string where;  ///< line:column
  std::string what;   ///< part of the message
};

/// Every change of `text` is refused, at its place and with its reason; unchanged it is accepted, so that the
/// complaint is about the change.
void check_cases(const std::string& text, const std::vector<Case>& cases) {
  REQUIRE(complaint(text).empty());
  for (const Case& c : cases) {
    INFO(c.from << " -> " << c.to.substr(0, 100));
    const std::string message = complaint(replaced(text, c.from, c.to));
    CHECK_THAT(message, Catch::StartsWith("f.toml:" + c.where + ": ") && Catch::Contains(c.what));
    CHECK(message.size() < 1000);
  }
}

}  // namespace

TEST_CASE("an ODE problem with one thing wrong is refused at that place", "[problem][bad input]") {
  check_cases(
      pendulum,
      {
          // keys and types
          {"step =", "stpe =", "12:1", "unknown key stpe in [scheme]; did you mean step?"},
          {"until = 10", "until = 10\nlevles = 1", "14:1", "did you mean levels?"},
          {"[scheme]", "[ouput]\n[scheme]", "11:2", "unknown table ouput; did you mean output?"},
          {"0.1", "true", "12:8", "step: expected a number or a formula, got a boolean"},
          {"until = 10", "until = 1979-05-27", "13:9", "got a date or time"},
          {"[\"q\"]", "\"q\"", "3:6", "expected an array of names, got a string"},
          {"p = 1.9", "p = 1.9\np = 2", "11:5", "cannot redefine"},
          {"[scheme]\n", "[schem]\n", "11:2", "did you mean scheme?"},
          // formulas
          {"cos(q)", "coss(q)", "5:14", "did you mean 'cos'?"},
          {"cos(q)", "cos(q", "5:17", "never closed"},
          {"cos(q)", "cos(q, p)", "5:14", "takes 1 argument, got 2"},
          {"cos(q)", "cos(Q)", "5:18", "unknown name 'Q'"},
          {"[scheme]", "[invariants]\nI = \"cos(t)\"\n[scheme]", "12:10", "t is available in H, [initial] and [exact]"},
          {"cos(q)", "cos(x)", "5:18", "x is available in S, [initial], [exact] and densities of a lattice"},
          {"\"T\"", "\"a\\u0000b\"", "1:10", "this text holds the character U+0000"},
          {"0.1", "1e11", "12:8", "so long beside the run, from t = 0 to until = 10"},
          {"[scheme]", "[invariants]\nt = \"q\"\n[scheme]", "12:1", "records have something else of that name"},
          {"cos(q)", in_parentheses("q", 100'000), "5:1014", "nesting deeper"},
          {"\"p^2/2 - cos(q)\"", "\"\"\"\np^2/2\n - coz(q)\"\"\"", "7:4", "did you mean 'cos'?"},
          {"\"p^2/2 - cos(q)\"", "\" \"", "5:6", "the formula is empty"},
          // names
          {"[\"p\"]", "[\"q\"]", "4:7", "already a coordinate"},
          {"[\"p\"]", "[\"sin\"]", "4:7", "it is a function"},
          {"[\"p\"]", "[\"t\"]", "4:7", "it is the time"},
          {"[\"p\"]", "[\"2p\"]", "4:7", "a name is a letter or _"},
          {"k = 1.0", "p = 1.0", "7:1", "already a momentum"},
          {"p = [\"p\"]", "p = [\"p\"]\nstructure = [[0, 1], [-1, 0]]", "5:1", "in its Darboux coordinates"},
          {"[\"q\"]", "[\"q\", \"r\"]", "4:5", "every coordinate needs its momentum"},
          {"[\"q\"]", "[\"r[x]\"]", "3:7", "does not declare a vector"},
          // parameters
          {"k = 1.0", "k = \"1/0\"", "7:6", "no finite value"},
          {"k = 1.0", "k = \"a + 1\"\na = \"b\"\nb = \"a\"", "8:1", "in a cycle: a -> b -> a"},
          // initial data
          {"p = 1.9\n", "", "8:2", "[initial] gives no value for p"},
          {"1.9", "nan", "10:5", "nan is not a finite number"},
          {"1.9", "-inf", "10:5", "-inf is not a finite number"},
          {"1.9", "[1, 2]", "10:5", "got an array"},
          // the scheme
          {"0.1", "0", "12:8", "step = 0 leads nowhere; it has to be positive"},
          {"0.1", "-0.1", "12:8", "does not lead from t = 0 to until = 10"},
          {"until = 10", "until = 0", "13:9", "leaves nothing to run"},
          {"until = 10", "until = 10\nmax_steps = 0", "14:13", "at least 1"},
          {"until = 10", "until = 10\ntolerance = 0", "14:13", "has to be positive"},
          {"until = 10", "until = 10\norder = 4", "14:1", "applies to lagrangian = \"generating\""},
          {"until = 10", "until = 10\nlagrangian = \"box\"", "14:15", "is for lattices"},
          // families of maps
          {"until = 10", "until = 10\nlagrangian = \"gauss\"", "11:2", "needs stages, from 1 to 8"},
          {"until = 10", "until = 10\nlagrangian = \"gauss\"\nstages = 9", "15:10", "made for 1 to 8 stages"},
          {"until = 10", "until = 10\nlagrangian = \"gauss\"\nstages = 0", "15:10", "at least 1"},
          {"until = 10", "until = 10\nlagrangian = \"gauss\"\nstages = 2\norder = 4", "16:1", "write stages"},
          {"until = 10", "until = 10\nstages = 2", "14:1", "applies to lagrangian = \"gauss\""},
          {"until = 10", "until = 10\nlagrangian = \"splitting\"\nspace = \"differences\"", "15:1", "is an orbit"},
          {"until = 10", "until = 10\ncomposition = \"verlet\"", "14:1", "applies to lagrangian = \"splitting\""},
          {"until = 10", "until = 10\nlagrangian = \"splitting\"\ncomposition = \"verlett\"", "15:16",
           "did you mean \"verlet\"?"},
          {"until = 10", "until = 10\nlagrangian = \"splitting\"\norder = 5", "15:9",
           "4 (blanes-moan-4), 6 (kahan-li-6)"},
          {"until = 10", "until = 10\nlagrangian = \"splitting\"\norder = 4\ncomposition = \"golden\"", "15:9",
           "is of order 2; leave one of them out"},
          {"until = 10", "until = 10\nlagrangian = \"splitting\"\n[initial.next]\nt = 0.1\nq = 0\np = 1", "15:10",
           "is a one-step map; leave the table out"},
          {"until = 10", "until = 10\nlagrangian = \"midpiont\"", "14:15", "did you mean \"midpoint\"?"},
          {"until = 10", "until = 10\nlagrangian = \"generating\"\norder = 4\ndarboux = [[1, 2], [3, 4]]", "16:11",
           "not symmetric"},
          {"until = 10", "until = 10\nlagrangian = \"custom\"\nL = \"p_0*(q_1 - q)\"", "15:17", "q_0 and q_1"},
          {"0.1", "\"auto\"", "12:9", "needs energy_tolerance"},
          {"until = 10", "until = 10\nenergy_tolerance = 1e-3", "14:1", "applies to step = \"auto\""},
          {"until = 10", "until = 10\nenergy_tolerance = 0", "14:20", "has to be positive"},
          {"until = 10", "until = 10\nenergy_tolerance = 2", "14:20", "has to be less than 1"},
          {"until = 10", "until = 10\nbridge = \"reversible\"", "14:1", "write on_singular = \"plain\" or \"stop\""},
          {"until = 10", "until = 10\non_singular = \"bridge\"", "14:1", "bridges are not available"},
          {"until = 10", "until = 10\non_singular = \"fixed\"", "14:1", "write on_singular = \"plain\" or \"stop\""},
          {"until = 10", "until = 10\non_singular = \"plane\"", "14:16", "did you mean \"plain\"?"},
          {"[scheme]", "[initial.next]\nt = 0.2\nq = 0\np = 1\n[scheme]", "16:8", "[initial.next] is at t = 0.2"},
          // output
          {"until = 10", "until = 10\n[output]\nevery = -1", "15:9", "at least 1"},
          {"until = 10", "until = 10\n[grid]\nx = 1", "14:2", "belongs to a [multisymplectic] problem"},
          // not TOML
          {"cos(q)\"", "cos(q)", "5:5", "the string that opens here is not closed"},
          {"title", "hello there", "1:7", "not TOML"},
      });
}

TEST_CASE("a composition of Nyström's kind is refused where T is not quadratic", "[problem][bad input]") {
  const std::string text =
      replaced(pendulum, "until = 10", "until = 10\nlagrangian = \"splitting\"\ncomposition = \"blanes-moan-rkn-6\"");
  check_cases(text, {
                        {"p^2/2", "p^2/2 + p^4/9", "15:16", "degree two alone"},
                        {"p^2/2", "sqrt(1 + p^2)", "15:16", "use \"kahan-li-6\""},
                    });
  CHECK(complaint(replaced(text, "p^2/2", "(p - 1)^2/2 + 3*p")).empty());
}

TEST_CASE("a splitting of an H that is none is refused at the term that mixes", "[problem][bad input]") {
  const std::string text = replaced(pendulum, "until = 10", "until = 10\nlagrangian = \"splitting\"");
  check_cases(text, {
                        {"cos(q)", "cos(q)*p", "5:14", "the term p*cos(q) depends"},
                        {"p^2/2 -", "p^2/2 + -1e-3*(q - p)^2 -", "5:14", "use \"gauss\""},
                        {"p^2/2 - cos(q)", "p^2/2 - (cos(q) + exp(p)*q)/2", "5:14", "the term q*exp(p)"},
                        {"\"p^2/2 - cos(q)\"", "\"\"\"\np^2/2\n - cos(q)\n + q*p\"\"\"", "8:4", "the term q*p"},
                    });
  // Sums of sums, and numbers before them, are no obstacle.
  CHECK(complaint(replaced(text, "p^2/2 - cos(q)", "-(cos(q) - 2*(p^2/2 - q))/4 + 1e-3*(p + q)")).empty());
}

TEST_CASE("a lattice problem with one thing wrong is refused at that place", "[problem][bad input]") {
  check_cases(
      breather,
      {
          {"[[\"u\", \"v\", -1]]", "[[0, -1, 0], [1, 0, 1], [0, 0, 0]]", "4:5", "M is not skew"},
          {"[[\"u\", \"v\", -1]]", "[[1, 0, 0], [0, 0, 0], [0, 0, 0]]", "4:5", "diagonal"},
          {"[[\"u\", \"v\", -1]]", "[[\"u\", \"v\", -1], [1, 0, 0]]", "4:22", "mixes"},
          {"[[\"u\", \"v\", -1]]", "[[\"u\", \"v\", -1], [\"v\", \"u\", 1]]", "4:22", "given twice"},
          {"[[\"u\", \"v\", -1]]", "[[\"u\", \"u\", -1]]", "4:6", "on the diagonal"},
          {"[[\"u\", \"v\", -1]]", "[[\"u\", \"vv\", -1]]", "4:13", "not a field"},
          {"\"v\", \"w\"]", "\"v\", \"u\"]", "3:22", "already a field"},
          {"\"v\", \"w\"]", "\"v\", \"x\"]", "3:22", "a coordinate of the grid"},
          {"cos(u)", "cos(u + y)", "6:34", "y is available in S, [initial], [exact] and densities of a lattice"},
          {"omega*t", "omega*z", "16:35", "z is available in S, [initial], [exact] and densities of a lattice"},
          {"\"v\", \"w\"]", "\"v\", \"level\"]", "3:22", "records have something else"},
          {"turn", "x_cell", "20:1", "records have something else of that name"},
          {"turn", "momentum_x", "20:1", "a built-in law has that name"},
          {"topological_charge", "energy_max", "18:15", "records have something else"},
          {"topological_charge", "turn_rms", "18:13", "records have something else"},
          {"cos(u)", "cos(uu)", "6:30", "unknown name 'uu'"},
          {"to = 20", "to = -20", "8:1", "has to be less than"},
          {"cells = 401", "cells = 2", "8:36", "at least 3"},
          {"cells = 401", "cells = 400", "8:1", "Write cells = 401"},
          {"K.x", "K.y", "5:1", "K.x is not given"},
          {"u = \"0\"", "u = nan", "13:5", "not a finite number"},
          {"u = \"0\"", "u = \"0\"\nw = \"2*u\"", "14:6", "only its derivatives"},
          {"u = \"0\"", "u = \"0\"\nw = \"dy(u)\"", "14:6", "the grid, which has x"},
          {"u = \"0\"", "u = \"dx(w)\"\nw = \"dx(u)\"", "13:6", "depends on its own derivatives"},
          {"omega = 0.5", "omega = 2", "11:10", "no finite value"},
          {"turn", "energy", "20:1", "a built-in law has that name"},
          {"\"box\"", "\"euler-box\"", "23:11", "runs with levels = \"fixed\" only"},
          {"\"box\"", "\"fourier\"\nstages = 9", "23:10", "made for 1 to 8 stages"},
          {"\"box\"", "\"box\"\nstages = 9", "23:10", "made for 1 to 8 stages"},
          {"\"box\"", "\"box\"\nstages = 0", "23:10", "at least 1"},
          {"\"box\"", "\"box\"\nspace_stages = 3", "8:1", "odd multiple of space_stages = 3"},
          {"\"box\"", "\"box\"\nspace_stages = 2", "23:16", "take space_stages = 1 or 3"},
          {"\"box\"", "\"box\"\nspace_stages = 4", "23:16", "take space_stages = 3 or 1"},
          {"\"box\"", "\"box\"\nspace_stages = 5", "23:16", "made for 1 to 4 stages"},
          {"\"box\"", "\"box\"\nspace_stages = 0", "23:16", "at least 1"},
          {"\"box\"", "\"fourier\"\nspace_stages = 3", "23:1", "applies to lagrangian = \"box\""},
          {"\"box\"", "\"splitting\"\nstages = 2", "23:1", "applies to lagrangian = \"box\" and \"fourier\""},
          {"\"box\"", "\"fourier\"\ncomposition = \"golden\"", "23:1", "applies to"},
          {"\"box\"", "\"fourier\"\nspace = \"differences\"", "23:1", "space applies to lattices"},
          {"\"box\"", "\"splitting\"\nspace = \"difference\"", "23:10", "\"differences\""},
      });
}

TEST_CASE("a file that is no problem file is refused without a crash", "[problem][bad input]") {
  const auto begins = [](const std::string& text) { return complaint(text).substr(0, 200); };
  CHECK_THAT(begins(""), Catch::StartsWith("f.toml:1:1: the file is empty"));
  CHECK_THAT(begins("# only a comment\n"), Catch::StartsWith("f.toml:1:1: the file is empty"));
  CHECK_THAT(begins("title = \"x\"\n"), Catch::Contains("none of [hamiltonian], [lagrangian], [multisymplectic]"));
  std::string line = "H = ", brackets = "a = ";
  line.append(10'000'000, 'q');
  brackets.append(100'000, '[');
  CHECK_THAT(begins(line), Catch::StartsWith("f.toml:1:1: this line is"));
  CHECK_THAT(begins(brackets), Catch::Contains("brackets nested deeper"));
  std::string braces = "a = ", dots = "a";
  for (int i = 0; i < 100'000; ++i) {
    braces += "{a=";
    dots += ".a";
  }
  CHECK_THAT(begins(braces), Catch::Contains("brackets nested deeper"));
  CHECK_THAT(begins(dots + " = 1"), Catch::Contains("keys nested deeper"));
  CHECK_THAT(begins("[" + dots + "]"), Catch::Contains("keys nested deeper"));
  CHECK_THAT(begins(std::string("title = \"\0\"", 11)), Catch::Contains("1:10: byte 0x00 does not belong"));
  CHECK_THAT(begins("title = \"\xE9\""), Catch::Contains("1:10: byte 0xE9 does not belong"));
  CHECK_THAT(begins("[.x]"),
             Catch::StartsWith("f.toml:1:2: not TOML"));  // an assertion of the parser, in builds with any
  CHECK_THAT(begins("title = “é”"), Catch::StartsWith("f.toml:1:9: '“' may stand in strings and comments only"));
  CHECK_THAT(begins("tt\xEF\xBB\xBD$"), Catch::StartsWith("f.toml:1:3: "));  // unreachable, by the parser's tables
  CHECK_THAT(begins("title = \"é\" # “é”"), Catch::Contains("none of [hamiltonian]"));
  CHECK_THAT(begins("title = \"\xED\xA0\x80\""), Catch::Contains("does not belong"));  // a surrogate
  CHECK_THROWS_AS(read_problem("/"), ProblemError);
  CHECK_THROWS_WITH(read_problem("pendulun"), Catch::Contains("did you mean \"pendulum\"?"));
  CHECK_THROWS_WITH(read_problem("sine_gordn"), Catch::Contains("did you mean \"sine-gordon\"?"));
  CHECK_THROWS_WITH(read_problem("Zakharov"), Catch::Contains("did you mean \"zakharov-kuznetsov\" or "));
  CHECK_THROWS_WITH(read_problem("kdv-soliton"), Catch::Contains("did you mean \"kdv\"?"));
  CHECK_THROWS_WITH(read_problem("nothing of the kind"),
                    Catch::Contains("the catalogue has ") && Catch::Contains("kepler"));
  CHECK_THROWS_WITH(read_problem("/dev/zero"), Catch::Contains("is not a regular file"));
}

TEST_CASE("a wrong --set is refused by name", "[problem][bad input]") {
  const auto set = [](const std::string& setting) { return complaint(pendulum, {setting}); };
  CHECK(set("scheme.step=0.2").empty());
  CHECK(set(" scheme . step = 0.2").empty());
  CHECK_THAT(set("scheme.stpe=0.2"), Catch::StartsWith("--set scheme.stpe=0.2: unknown key stpe"));
  CHECK_THAT(set("shceme.step=0.2"), Catch::StartsWith("--set shceme.step=0.2: unknown table shceme"));
  CHECK_THAT(set("scheme.step.x=0.2"), Catch::Contains("step is a number, not a table"));
  CHECK_THAT(set("parameters.kk=2"), Catch::Contains("nothing called kk in [parameters]"));
  CHECK_THAT(set("scheme.step"), Catch::Contains("expected table.key=value"));
  CHECK_THAT(set("scheme..step=1"), Catch::Contains("expected table.key=value"));
  CHECK_THAT(set("scheme.step=0"), Catch::Contains("leads nowhere"));
  CHECK_THAT(set("hamiltonian.H=p^2/2 - coz(q)"), Catch::Contains("did you mean 'cos'?"));
}

TEST_CASE("a stated action on a lattice with one thing wrong is refused at that place", "[problem][bad input]") {
  const std::string custom = replaced(
      breather, "\"box\"", "\"custom\"\nL = \"((u_10 - u_00)/h)^2/2 - ((u_01 - u_00)/dx)^2/2 + cos(u_00) - 1\"");
  check_cases(custom, {
                          {"u_10 - u_00)/h", "u_20 - u_00)/h", "23:8", "u_00, …, u_11, digits 0 or 1 for the level"},
                          {"u_10 - u_00)/h", "u - u_00)/h", "23:8", "L is a density of the values at the corners"},
                          {"u_10 - u_00)/h", "u_1 - u_00)/h", "23:8", "L is a density of the values at the corners"},
                          {"u_10 - u_00)/h", "u_10 - u_00)/dy", "23:21", "unknown name 'dy'"},
                          {"cos(u_00)", "cos(u_00) + t", "23:67", "t is available in L of a driven lattice"},
                          {"cos(u_00)", "x*cos(u_00)", "23:6", "L names x, and S does not"},
                          {"L = \"", "# L = \"", "21:2", "needs L: a density of the values"},
                          {"\"custom\"", "\"box\"", "23:1", "L applies to lagrangian = \"custom\""},
                          {"omega = 0.5", "omega = 0.5\nh = 1", "24:1", "rename the parameter"},
                          {"[scheme]", "[initial.next]\nu = \"0\"\n[scheme]", "21:10", "[initial.next] needs t"},
                      });
  CHECK_THAT(complaint(replaced(breather, "[scheme]", "[initial.next]\nt = 0.1\nu = \"0\"\n[scheme]")),
             Catch::Contains("lagrangian = \"box\" is a one-step map"));
}
