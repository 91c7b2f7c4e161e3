// Steps that are not taken, found by runs of random problems that independent code took again.

#include <catch2/catch.hpp>

#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;

TEST_CASE("a step that meets the law and is not taken, with no plain step in its place, ends the run") {
  // At t = -8.59 the law is met again by a step that differs much from what it asks for, and the plain step in its
  // place has another energy altogether.
  const std::string text = R"toml(
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "0.9713*u^2 + 1.354*v^2 - 1.701*cos(x) - 1.803*cos(y) - 0.8219*cos(y - x) + 0.2181*sin(y + (-0.5374)*v) + 0.1106*sin(v + (-0.7387)*x)"
[initial]
x = -0.6218
y = 1.036
u = 0.794
v = 0.8867
[scheme]
lagrangian = "generating"
order = 1
darboux = [[0.3085, -0.4243, -0.2873, 0.3575], [-0.4243, -0.1861, 0.1317, -0.5417], [-0.2873, 0.1317, -0.2206, -0.4906], [0.3575, -0.5417, -0.4906, 0.4099]]
step_potential = "none"
step = -0.3321
until = -69.74
max_steps = 40
on_singular = "plain"
[levels]
every = 1
)toml";
  const Folder folder;
  const std::string file = folder / "run.h5";
  const Outcome outcome = run(parse_problem(text, "p"), {.output = file, .threads = 1});
  CHECK(outcome.status == ExitStatus::failed);
  CHECK(outcome.statistics.steps == 29);
  const std::vector<double> t = record::Reader(file).read("/levels/t");
  for (std::size_t k = 1; k < t.size(); ++k) {
    CHECK(t[k] < t[k - 1]);
  }
  CHECK(check(file).status == ExitStatus::done);
}

TEST_CASE("a correction as large as the step does not end the iteration for a generating function") {
  // A step of half a turn of Kepler's orbit: corrections that leave for 1e23, beside which the residual of the
  // increment before is nothing.
  const std::string text = R"toml(
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)"
[initial]
x = 0.92244
y = 0
u = 0
v = 1.080815756236431
[scheme]
lagrangian = "generating"
order = 6
step = STEP
until = -581.5
max_steps = 20
)toml";
  const auto outcome_of = [&](const std::string& step) {
    const Folder folder;
    std::string changed = text;
    changed.replace(changed.find("STEP"), 4, step);
    return run(parse_problem(changed, "p"), {.output = folder / "run.h5", .threads = 1});
  };
  const Outcome outcome = outcome_of("-3.383");
  CHECK(outcome.status == ExitStatus::failed);
  CHECK(outcome.statistics.steps == 0);
  CHECK(outcome_of("-0.1").statistics.steps == 20);
}

TEST_CASE("a run into a pole is checked by what rounding is along the way, not by where it ends") {
  // From H = 0 to states of 1e117 in 25 steps: a part of these, added to an earlier state, is no state of that step.
  const std::string text = R"toml(
[hamiltonian]
q = ["x"]
p = ["u"]
H = "u^2/2 - 1.594*x^4 - 0.08948831793600065"
[initial]
x = -0.3943
u = 0.506
[scheme]
lagrangian = "gauss"
stages = 7
levels = "fixed"
step = 0.1304
until = 12.96
[levels]
every = 1
)toml";
  const Folder folder;
  const std::string file = folder / "run.h5";
  static_cast<void>(run(parse_problem(text, "p"), {.output = file, .threads = 1}));
  CHECK(check(file).status == ExitStatus::done);
  // The twin: another energy of an early step.
  falsify(file, "/levels/energy", 5, 1e-9);
  CHECK(check(file).status == ExitStatus::contradiction);
}
