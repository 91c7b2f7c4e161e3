#include <array>
#include <catch2/catch.hpp>
#include <cmath>

#include <fmt/format.h>

#include <rubato/catalogue/catalogue.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/problem/document.hpp>
#include <rubato/problem/problem.hpp>

#include "problem_texts.hpp"

namespace {

using namespace rubato;
using namespace rubato::run_tests;
using rubato::Levels;
using rubato::OnSingular;

Problem read(const std::string& text, const std::vector<std::string>& settings = {}) {
  return parse_problem(text, "folder/mine.toml", settings);
}

double parameter(const Problem& problem, const std::string& name) {
  for (const Parameter& p : problem.parameters) {
    if (p.name == name) {
      return p.value;
    }
  }
  throw std::logic_error("no parameter " + name);
}

/// Whether two problems would run the same: all numbers bit for bit, all formulas letter for letter.
bool same(const Problem& a, const Problem& b) {
  bool equal = a.title == b.title && a.parameters.size() == b.parameters.size() && a.scheme.step == b.scheme.step &&
               a.scheme.until == b.scheme.until && a.scheme.levels == b.scheme.levels &&
               a.scheme.word() == b.scheme.word() && a.scheme.on_singular == b.scheme.on_singular &&
               a.output.every == b.output.every;
  for (const Parameter& p : a.parameters) {
    equal = equal && parameter(b, p.name) == p.value;
  }
  const auto same_formulas = [](const std::vector<NamedFormula>& left, const std::vector<NamedFormula>& right) {
    return std::equal(left.begin(), left.end(), right.begin(), right.end(), [](const auto& l, const auto& r) {
      return l.name == r.name && l.formula.text == r.formula.text;
    });
  };
  if (const auto* left = a.hamiltonian()) {
    const auto* right = b.hamiltonian();
    return equal && right != nullptr && left->names() == right->names() && left->H.text == right->H.text &&
           left->initial.q == right->initial.q && left->initial.p == right->initial.p &&
           left->initial.t == right->initial.t && same_formulas(left->invariants, right->invariants) &&
           same_formulas(left->exact, right->exact);
  }
  const auto* left = a.multisymplectic();
  const auto* right = b.multisymplectic();
  return equal && right != nullptr && left->fields == right->fields && left->M.entries == right->M.entries &&
         left->S.text == right->S.text && same_formulas(left->exact, right->exact);
}

}  // namespace

TEST_CASE("an ODE problem is read as it is written", "[problem]") {
  const Problem problem = read(pendulum);
  CHECK(problem.name == "mine");
  CHECK(problem.title == "T");
  CHECK(problem.output.file == "mine.h5");
  CHECK(problem.text == pendulum);
  REQUIRE(problem.hamiltonian() != nullptr);
  const auto& ode = *problem.hamiltonian();
  CHECK(ode.names() == std::vector<std::string>{"q", "p"});
  CHECK(ode.H.text == "p^2/2 - cos(q)");
  CHECK(ode.H.location.text() == "folder/mine.toml:5:6");
  CHECK(ode.initial.q == std::vector{0.0});
  CHECK(ode.initial.p == std::vector{1.9});
  CHECK(problem.start() == 0.0);
  CHECK(problem.scheme.lagrangian == LagrangianName::midpoint);
  CHECK(problem.scheme.levels == Levels::variable);
  CHECK(problem.scheme.on_singular == OnSingular::plain);
  CHECK(problem.scheme.max_steps == 100'000'000);
  CHECK(problem.scheme.tolerance == 1e-13);
}

TEST_CASE("numbers may be formulas of parameters, in any order", "[problem]") {
  const Problem problem =
      read(replaced(replaced(pendulum, "k = 1.0", "k = \"2*b\"\nb = \"a^2 + pi\"\na = 3"), "1.9", "\"sqrt(k)\""));
  CHECK(parameter(problem, "k") == 2 * (9 + std::acos(-1.0)));
  CHECK(problem.hamiltonian()->initial.p[0] == std::sqrt(parameter(problem, "k")));
}

TEST_CASE("vectors are declared once and given whole or by component", "[problem]") {
  const std::string vectors = R"(
[hamiltonian]
q = ["r[2]", "e"]
p = ["s[2]", "E"]
H = "(s1^2 + s2^2 + E^2)/2 + r1^2 + r2^2 + e^2"
[initial]
t = 2
r = [1, "1/2"]
e = 0.25
s1 = 3
s2 = 4
E = 5
[scheme]
step = -0.1
until = -1
)";
  const Problem problem = read(vectors);
  const auto& ode = *problem.hamiltonian();
  CHECK(ode.names() == std::vector<std::string>{"r1", "r2", "e", "s1", "s2", "E"});
  CHECK(ode.initial.q == std::vector{1.0, 0.5, 0.25});
  CHECK(ode.initial.p == std::vector{3.0, 4.0, 5.0});
  CHECK(problem.start() == 2.0);
  CHECK_THROWS_WITH(read(replaced(vectors, "e = 0.25", "e = 0.25\nr1 = 7")), Catch::Contains("given twice"));
  CHECK_THROWS_WITH(read(replaced(vectors, "[1, \"1/2\"]", "[1]")), Catch::Contains("declared as r[2]"));
  CHECK_THROWS_WITH(read(replaced(vectors, "+ r2^2", "+ r^2")), Catch::Contains("components are r1, r2"));
}

TEST_CASE("a starting pair sets the first step", "[problem]") {
  const std::string pair = replaced(
      replaced(pendulum, "[scheme]", "[initial.next]\nt = 0.25\nq = 0.4\np = 1.8\n[scheme]"), "step = 0.1\n", "");
  const Problem problem = read(pair);
  REQUIRE(problem.hamiltonian()->next.has_value());
  CHECK(problem.hamiltonian()->next->q == std::vector{0.4});
  CHECK(problem.scheme.step == 0.25);
  CHECK_THROWS_WITH(read(replaced(pair, "t = 0.25\n", "")), Catch::Contains("needs t"));
}

TEST_CASE("a lattice problem is read as it is written", "[problem]") {
  const Problem problem = read(breather);
  REQUIRE(problem.multisymplectic() != nullptr);
  const auto& pde = *problem.multisymplectic();
  CHECK(pde.fields == std::vector<std::string>{"u", "v", "w"});
  CHECK(pde.M.entries == std::vector{0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0});
  REQUIRE(pde.K.size() == 1);
  CHECK(pde.K[0].entries == std::vector{0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0});
  REQUIRE(pde.axes.size() == 1);
  CHECK(pde.axes[0].from == -20);
  CHECK(pde.axes[0].cells == 401);
  CHECK(pde.initial[0].has_value());
  CHECK(!pde.initial[2].has_value());
  REQUIRE(pde.symmetries.size() == 1);
  CHECK(pde.symmetries[0].B(0, 1) == 1);
  CHECK(pde.symmetries[0].B(1, 0) == -1);
  // The full array says the same as the triples.
  const Problem full = read(replaced(breather, R"([["u", "v", -1]])", "[[0, -1, 0], [\"2/2\", 0, 0], [0, 0, 0]]"));
  CHECK(full.multisymplectic()->M.entries == pde.M.entries);
}

TEST_CASE("formulas are built with parameters as constants and derivatives as variables", "[problem]") {
  const Problem problem = read(breather);
  const std::vector<std::string> names = {"x", "t"};
  rubato::formula::Graph graph;
  const auto exact = problem.build(problem.multisymplectic()->exact[0].formula, graph, names);
  const std::array outputs = {exact};
  const std::array inputs = {graph.variable("x"), graph.variable("t")};
  rubato::formula::ScalarEvaluator evaluate{rubato::formula::Bytecode(outputs, inputs)};
  const std::array<double, 2> at = {0.3, 1.7};
  std::array<double, 1> value{};
  evaluate(at, value);
  const double gamma = std::sqrt(0.75);
  // A handful of operations, each good to a rounding or two of its result.
  CHECK(value[0] == Approx(4 * std::atan(gamma / 0.5 * std::sin(0.85) / std::cosh(gamma * 0.3))).epsilon(1e-14));

  rubato::formula::Graph other;
  const std::vector<std::string> fields = {"u", "v", "w"};
  const auto twice = problem.build({"dx(dx(u)) + w", {}}, other, fields, fields);
  CHECK(rubato::formula::variables_of(twice).size() == 2);
  CHECK(other.variable("dx(dx(u))").index() != other.variable("dx(u)").index());
  CHECK_THROWS_AS(problem.build({"dy(u)", {}}, other, fields, fields), ProblemError);
  CHECK_THROWS_AS(problem.build({"dx(u^2)", {}}, other, fields, fields), ProblemError);
}

TEST_CASE("a setting changes the effective problem, which reads back the same", "[problem]") {
  const Problem problem = read(pendulum, {"scheme.step=0.05", "scheme.levels=fixed", "parameters.k=sqrt(2)",
                                          "output.file=other.h5", "initial.p=1.1000000000000001"});
  CHECK(problem.scheme.step == 0.05);
  CHECK(problem.scheme.levels == Levels::fixed);
  CHECK(problem.output.file == "other.h5");
  CHECK(parameter(problem, "k") == std::sqrt(2.0));
  const Problem again = read(problem.text);
  CHECK(same(problem, again));
  CHECK(again.text == problem.text);
  CHECK(!same(problem, read(pendulum)));
  CHECK(read(breather, {"grid.x.cells=201"}).multisymplectic()->axes[0].cells == 201);
}

TEST_CASE("a setting with a minus sign removes an entry or a table", "[problem]") {
  const std::string gauss = replaced(pendulum, "step = 0.1", "lagrangian = \"gauss\"\nstages = 2\nstep = 0.1");
  // Two schemes of one file: the other one has no stages.
  const Problem problem = read(gauss, {"scheme.lagrangian=midpoint", "-scheme.stages"});
  CHECK(problem.scheme.lagrangian == LagrangianName::midpoint);
  CHECK(same(problem, read(problem.text)));
  CHECK_THROWS_WITH(read(gauss, {"scheme.lagrangian=midpoint"}), Catch::Contains("stages"));  // the twin
  // Removed before others are set, in whatever order they are given.
  CHECK(read(gauss, {"scheme.step=0.2", "scheme.until=3", "-scheme"}).scheme.step == 0.2);
  CHECK(read("[hamiltonian]\nsystem = \"kepler\"\n[initial]\nx = 1\ny = 0\nu = 0\nv = 1\n[exact]\nx = \"cos(t)\"\n"
             "[scheme]\nstep = 0.1\nuntil = 1\n",
             {"-exact"})
            .hamiltonian()
            ->exact.empty());
  // Of a table inside another.
  CHECK(read(breather, {"-invariants.topological_charge"}).multisymplectic()->invariants.empty());
  const auto refusal = [&](const std::string& removed) -> std::string {
    try {
      static_cast<void>(read(gauss, {"-" + removed}));
      return "";
    } catch (const ProblemError& error) {
      return error.what();
    }
  };
  using Catch::Contains;
  CHECK_THAT(
      refusal("scheme.stagse"),
      Contains("--unset scheme.stagse: the problem has nothing called stagse in [scheme]; did you mean stages?"));
  CHECK_THAT(refusal("shceme.stages"), Contains("nothing called shceme; did you mean scheme?"));
  CHECK_THAT(refusal("scheme.order"), Contains("nothing called order in [scheme]; it has lagrangian, stages, step"));
  CHECK_THAT(refusal("title.x"), Contains("unknown path: title is a string, not a table"));
  CHECK_THAT(refusal("scheme..step"), Contains("a name on each side of every dot"));
  CHECK_THAT(refusal("scheme.step"), Contains("step"));
}

TEST_CASE("cells may be about a number, and the effective problem has the one that was chosen", "[problem]") {
  const auto cells = [](const std::vector<std::string>& settings) {
    const Problem problem = read(breather, settings);
    const std::int64_t chosen = problem.multisymplectic()->axes.front().cells;
    CHECK(problem.text.find("about") == std::string::npos);
    CHECK(parse_problem(problem.text, "again.toml").multisymplectic()->axes.front().cells == chosen);
    return chosen;
  };
  CHECK(cells({"grid.x.cells=about 500"}) == 501);
  CHECK(cells({"grid.x.cells=\" about\t500 \""}) == 501);
  CHECK(cells({"grid.x.cells=about 500", "scheme.lagrangian=fourier"}) == 500);
  CHECK(cells({"grid.x.cells=about 500", "scheme.lagrangian=fourier", "scheme.stages=3"}) == 500);
  CHECK(cells({"grid.x.cells=about 500", "scheme.lagrangian=box", "scheme.stages=2"}) == 525);
  CHECK(cells({"grid.x.cells=about 500", "scheme.lagrangian=splitting"}) == 500);
  CHECK(cells({"grid.x.cells=about 500", "scheme.lagrangian=leapfrog"}) == 500);
  // What is wrong elsewhere is said there, and what is no number here.
  const auto refusal = [](const std::string& setting, const std::string& more = "scheme.step=0.1") -> std::string {
    try {
      static_cast<void>(read(breather, {setting, more}));
      return "";
    } catch (const ProblemError& error) {
      return error.what();
    }
  };
  using Catch::Contains;
  CHECK_THAT(refusal("grid.x.cells=about 500", "scheme.lagrangian=bocks"), Contains("\"bocks\" is not known"));
  CHECK_THAT(refusal("grid.x.cells=about 500", "scheme.stages=99"), Contains("stages"));
  for (const std::string wrong : {"about", "about many", "about 2", "about 12.5", "about -5", "about 99999999999"}) {
    INFO(wrong);
    CHECK_THAT(refusal("grid.x.cells=" + wrong), Contains("cells = \"" + wrong + "\": after \"about\" goes a whole"));
  }
  CHECK_THAT(refusal("grid.x.cells=aboutness"), Contains("unknown name"));
}

TEST_CASE("any text is read back as it was written", "[problem]") {
  std::string text = "Schwingung \\ \" ' <é>";
  for (char c = 1; c <= 0x20; ++c) {
    text += c;
  }
  text += '\x7F';
  Value root;
  root.data = Value::Table(1);
  root.table()->front().key = "a key\t";
  root.table()->front().value.data = text;
  const Value again = read_document(write_document(root), "f.toml");
  REQUIRE(again.table()->size() == 1);
  CHECK(again.table()->front().key == "a key\t");
  CHECK(*again.table()->front().value.string() == text);
}

TEST_CASE("the catalogue gives a system or an equation, and the user's parameters win", "[problem]") {
  const std::string text = R"(
[hamiltonian]
system = "kepler"
[parameters]
mu = 2.0
[initial]
x = 1
y = 0
u = 0
v = 1
[scheme]
step = 0.01
until = 1
)";
  const Problem problem = read(text);
  CHECK(problem.hamiltonian()->names() == std::vector<std::string>{"x", "y", "u", "v"});
  CHECK(parameter(problem, "mu") == 2.0);
  CHECK(parameter(read(replaced(text, "[parameters]\nmu = 2.0\n", "")), "mu") == 1.0);
  CHECK(problem.text.find("system") == std::string::npos);  // the record does not depend on the catalogue
  CHECK(same(problem, read(problem.text)));
  CHECK(parameter(read(text, {"parameters.e=0.1"}), "e") == 0.1);
  CHECK_THROWS_WITH(read(replaced(text, "\"kepler\"", "\"keppler\"")), Catch::Contains("did you mean \"kepler\"?"));
  CHECK_THROWS_WITH(read(replaced(text, "\"kepler\"", "\"kepler\"\nH = \"x\"")),
                    Catch::Contains("H comes from system"));
}

TEST_CASE("byte order mark, CRLF, tabs and UTF-8 are text", "[problem]") {
  std::string crlf = "\xEF\xBB\xBF";
  for (const char c : pendulum) {
    crlf += c == '\n' ? "\r\n" : std::string(1, c);
  }
  CHECK(same(read(crlf), read(pendulum)));
  CHECK(read(replaced(pendulum, "\"T\"", "\t\"Schwingung – größer\"")).title == "Schwingung – größer");
  // Columns count characters: the name after the two-byte ones is where an editor shows it.
  CHECK_THROWS_WITH(read(replaced(pendulum, "title = \"T\"", "title = \"éé\"; x")), Catch::Contains("mine.toml:1:13"));
}

TEST_CASE("every problem of the catalogue is complete, and its effective text reads back the same", "[problem]") {
  REQUIRE(rubato::catalogue::entries().size() >= 10);
  for (const auto& entry : rubato::catalogue::entries()) {
    INFO(entry.name);
    const std::string name(entry.name);
    const Problem problem = read_problem(name);
    CHECK(problem.name == name);
    CHECK(problem.title != name);
    const Problem rewritten =
        read_problem(name, std::vector<std::string>{fmt::format("output.every={}", problem.output.every)});
    CHECK(same(problem, rewritten));
    CHECK(same(rewritten, parse_problem(rewritten.text, name)));
  }
}

TEST_CASE("the outer Solar System is at rest nowhere and bound", "[problem]") {
  // A transposed digit in the table of initial data would show here: the total energy of Hairer, Lubich and Wanner's
  // data, from an independent evaluation in Python.
  const Problem problem = read_problem("outer-solar-system");
  const auto& ode = *problem.hamiltonian();
  const auto names = ode.names();
  REQUIRE(names.size() == 36);
  rubato::formula::Graph graph;
  const std::array outputs = {problem.build(ode.H, graph, names)};
  std::vector<rubato::formula::Expression> inputs;
  std::vector<double> state = ode.initial.q;
  state.insert(state.end(), ode.initial.p.begin(), ode.initial.p.end());
  for (const std::string& name : names) {
    inputs.push_back(graph.variable(name));
  }
  rubato::formula::ScalarEvaluator evaluate{rubato::formula::Bytecode(outputs, inputs)};
  std::array<double, 1> energy{};
  evaluate(state, energy);
  CHECK(energy[0] == Approx(-3.2154531832081636e-08).epsilon(1e-13));
}
