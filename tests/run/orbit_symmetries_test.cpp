// [symmetries] of orbits: momentum maps, their changes in each step, and the linear ones that are found.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;
using rubato::record::Reader;

namespace {

/// A quartic central force in the plane, and what is added to it.
std::string central(const std::string& symmetries, const std::string& more = "") {
  return R"(
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "(u^2 + v^2)/2 + (x^2 + y^2)^2/4)" +
         more + R"("
[initial]
x = 1
y = 0.2
u = -0.1
v = 0.7
[symmetries]
)" + symmetries +
         R"(
[scheme]
step = 0.1
until = 10
)";
}
const std::string rotation = "rotation = { x = \"-y\", y = \"x\" }";

Outcome run_text(const std::string& text, const std::string& file, const std::vector<std::string>& settings = {}) {
  return run(parse_problem(text, "text.toml", settings), {.output = file, .overwrite = true, .threads = 1});
}
double change_of(const Outcome& outcome, const std::string& name) {
  const auto found = std::ranges::find(outcome.statistics.residuals, name, &Named<Spread>::name);
  REQUIRE(found != outcome.statistics.residuals.end());
  return found->value.largest();
}
std::string why_not(const std::string& text) {
  try {
    static_cast<void>(parse_problem(text, "text.toml"));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("a symmetry of the discrete action keeps its momentum map, a broken one does not", "[run][symmetries]") {
  const Folder folder;
  const std::string file = folder / "run.h5";
  const std::vector<std::vector<std::string>> schemes = {{},
                                                         {"scheme.lagrangian=gauss", "scheme.stages=2"},
                                                         {"scheme.lagrangian=splitting"},
                                                         {"scheme.lagrangian=generating", "scheme.order=4"}};
  for (const std::vector<std::string>& scheme : schemes) {
    const Outcome kept = run_text(central(rotation), file, scheme);
    CHECK(change_of(kept, "rotation") < 1e-14);  // a sum of two products of order 1
    const auto& J = kept.statistics.invariants.front();
    CHECK(J.name == "rotation");
    CHECK(J.value.initial == Approx(1.0 * 0.7 - 0.2 * -0.1));
    CHECK(J.value.max() < 1e-13);
    CHECK(check(file).status == ExitStatus::done);
    CHECK_THAT(to_json(kept), Contains("\"residuals\": {\"rotation\": {\"max\""));

    const Outcome broken = run_text(central(rotation, " + 0.01*x^2*y"), file, scheme);
    CHECK(change_of(broken, "rotation") > 1e-5);
    CHECK(check(file).status == ExitStatus::done);
  }
  falsify(file, "/laws/rotation_max", 5, 1e-9);
  const Outcome found = check(file);
  CHECK(std::ranges::any_of(found.disagreements, [](const Disagreement& one) {
    return one.dataset == "/laws/rotation_max" && one.reason.find("around the step") != std::string::npos;
  }));
}

TEST_CASE("a momentum map that no scheme keeps changes by the order of the scheme", "[run][symmetries]") {
  // x -> (1 + s) x is a symmetry of no H; x² ∂_y of H = y^2-free motion is one whose momentum map is cubic.
  const std::string text = R"(
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "u^2/2 + v*u*x + x^4/4 + v^2/2"
[initial]
x = 0.7
y = 0.1
u = 0.2
v = 0.3
[symmetries]
shift = { y = "1" }
[scheme]
lagrangian = "gauss"
stages = 1
levels = "fixed"
step = 0.1
until = 4
)";
  const Folder folder;
  CHECK(change_of(run_text(text, folder / "a.h5"), "shift") < 1e-15);
  CHECK(change_of(run_text(text, folder / "a.h5", {"symmetries.shift={y=\"x\"}"}), "shift") > 1e-3);
}

TEST_CASE("generators of both coordinates and momenta are linear and canonical", "[run][symmetries]") {
  const Folder folder;
  const std::string both = "turn = { x = \"-y\", y = \"x\", u = \"-v\", v = \"u\" }";
  const Outcome lifted = run_text(central(rotation), folder / "a.h5");
  const Outcome stated = run_text(central(both), folder / "b.h5");
  CHECK(stated.statistics.invariants.front().value.initial ==
        Approx(lifted.statistics.invariants.front().value.initial));
  CHECK(change_of(stated, "turn") < 1e-14);

  CHECK_THAT(why_not(central("a = { x = \"-y\", y = \"x\", u = \"v\", v = \"u\" }")), Contains("no canonical motion"));
  CHECK_THAT(why_not(central("a = { x = \"-y\", u = \"x^2\" }")), Contains("has to be linear"));
  CHECK_THAT(why_not(central("a = { w = \"-y\" }")), Contains("no coordinate or momentum"));
  CHECK_THAT(why_not(central("a = 3")), Contains("has to be a generator"));
  CHECK_THAT(why_not(central("a = {}")), Contains("a moves nothing"));
  CHECK_THAT(why_not(central("a = { x = \"0\", u = \"0\" }")), Contains("a moves nothing"));
  CHECK_THAT(why_not(central("a = { x = \"u\" }")), Contains("u"));
  CHECK_THAT(why_not(central(rotation + "\n[invariants]\nrotation = \"x\"")), Contains("[invariants], too"));
}

TEST_CASE("linear symmetries are found, but the flow of H itself and those that are stated", "[run][symmetries]") {
  const Folder folder;
  const Outcome found = run_text(central("find = true"), folder / "a.h5");
  REQUIRE(found.statistics.invariants.size() == 1);
  CHECK(found.statistics.invariants.front().name == "linear_1");
  CHECK(std::abs(found.statistics.invariants.front().value.initial) == Approx(0.72));
  CHECK(change_of(found, "linear_1") < 1e-14);
  CHECK(run_text(central("find = true\n" + rotation), folder / "a.h5").statistics.invariants.size() == 1);
  CHECK(run_text(central("find = true", " + x^2*y"), folder / "a.h5").statistics.invariants.empty());

  // Two equal oscillators: U(2) has four generators, and one is the flow of H.
  const Outcome oscillators = run_text(R"(
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "(u^2 + v^2 + x^2 + y^2)/2"
[initial]
x = 1
y = 0.2
u = -0.1
v = 0.7
[symmetries]
find = true
[scheme]
step = 0.1
until = 10
levels = "fixed"
)",
                                       folder / "b.h5");
  CHECK(oscillators.statistics.invariants.size() == 3);
  for (const auto& [name, value] : oscillators.statistics.invariants) {
    CHECK(value.max() < 1e-13);
  }
  CHECK(check(folder / "b.h5").status == ExitStatus::done);
}

TEST_CASE("a problem stated by L has momentum maps, too", "[run][symmetries]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Outcome outcome = run_text(R"(
[lagrangian]
q = ["x", "y"]
L = "(x_dot^2 + y_dot^2)/2 - (x^2 + y^2)^2/4"
[initial]
x = 1
y = 0.2
x_dot = -0.1
y_dot = 0.7
[symmetries]
rotation = { x = "-y", y = "x" }
[laws]
every = 3
[scheme]
step = 0.1
until = 5
)",
                                   file);
  CHECK(change_of(outcome, "rotation") < 1e-14);
  CHECK(check(file).status == ExitStatus::done);
  CHECK(check(file, {.replay = true}).status == ExitStatus::done);
}
