// [scheme] tangents: what a run, its record, its continuation, its check and its ensembles report of them.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/observed_run.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;
using rubato::record::Reader;

namespace {

const std::string saddle = R"(
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 - q^2/2"
[initial]
q = 0
p = 0
[scheme]
lagrangian = "gauss"
stages = 4
levels = "fixed"
step = 0.1
until = 500
tangents = "all"
)";

const std::string oscillator = R"(
[parameters]
k = 1.3
c = 0.4
m = 1.1
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "(u^2 + v^2)/(2*m) + k*x^2/2 + y^2/2 + c*x^2*y"
[initial]
x = 0.3
y = 0.2
u = -0.1
v = 0.25
[scheme]
lagrangian = "gauss"
stages = 3
step = 0.2
until = 6
)";

Outcome run_text(const std::string& text, const std::string& file, const std::vector<std::string>& settings = {}) {
  return run(parse_problem(text, "text.toml", settings), {.output = file, .overwrite = true, .threads = 1});
}

std::string why_not(const std::string& text, const std::vector<std::string>& settings) {
  try {
    const Folder folder;
    static_cast<void>(run_text(text, folder / "none.h5", settings));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("exponents of a saddle are those of its equation", "[run][tangents]") {
  const Folder folder;
  const std::string file = folder / "saddle.h5";
  const Outcome outcome = run_text(saddle, file);
  const std::vector<double> first = Reader(file).read("/tangents/growth_1"),
                            second = Reader(file).read("/tangents/growth_2");
  REQUIRE(first.size() == 5000);
  double growth = 0.0, pairs = 0.0;
  for (std::size_t k = 0; k < first.size(); ++k) {
    growth += k >= 500 ? first[k] : 0.0;
    pairs = std::max(pairs, std::abs(first[k] + second[k]));
  }
  // Of order 8 the exponent is 1 + O(h⁸)·1e-8, and what remains of the other direction at t = 50 is e^-100.
  CHECK(std::abs(growth / 450.0 - 1.0) < 1e-13);
  CHECK(pairs < 1e-14);  // a logarithm of 0.1, of sums of some roundings of 1
  CHECK(outcome.statistics.exponent(0) == Approx(1.0).margin(2e-3));
  CHECK(outcome.statistics.exponent(0) + outcome.statistics.exponent(1) == Approx(0.0).margin(1e-13));
  CHECK(outcome.statistics.megno() == Approx(250.0).epsilon(1e-3));  // t/2
  CHECK(outcome.statistics.tangents.defect.largest() < 1e-14);
  const std::string json = to_json(outcome), table = to_table(outcome);
  CHECK_THAT(json,
             Contains("\"lyapunov\": {\"exponents\": [") && Contains("\"megno\"") && Contains("\"symplecticity\""));
  CHECK_THAT(table, Contains("Lyapunov exponents") && Contains("MEGNO") && Contains("two-form"));

  // Of order 2 it is another number: ln((1 + h/2)/(1 - h/2))/h = 1 + h²/12.
  const Outcome midpoint = run_text(saddle, folder / "midpoint.h5", {"scheme.lagrangian=midpoint", "-scheme.stages"});
  CHECK(midpoint.statistics.exponent(0) - outcome.statistics.exponent(0) == Approx(0.01 / 12.0).epsilon(1e-2));
}

TEST_CASE("a checkpoint without the units of its tangent vectors is not taken for one that has them",
          "[run][tangents]") {
  // As an earlier build wrote it, shorter by the units of the two coordinates: whichever numbers are missing, the rest
  // are too few.
  const Problem problem = parse_problem(oscillator, "text.toml", std::vector<std::string>{"scheme.tangents=2"});
  ObservedRun observed(problem, false);
  StateWriter state;
  observed.save(state);
  const std::vector<double> whole(state.values().begin(), state.values().end());
  CHECK(restore({{"state", whole}}, observed));
  CHECK_FALSE(restore({{"state", std::vector<double>(whole.begin(), whole.end() - 2)}}, observed));
  std::vector<double> longer = whole;
  longer.insert(longer.end(), {1.0, 1.0});
  CHECK_FALSE(restore({{"state", longer}}, observed));
}

TEST_CASE("without tangents a run has the same bits", "[run][tangents]") {
  const Folder folder;
  const std::string plain = folder / "plain.h5", carried = folder / "carried.h5";
  run_text(oscillator, plain);
  run_text(oscillator, carried, {"scheme.tangents={vectors=4,matrix=true,parameters=[\"k\",\"c\"]}"});
  for (const char* path : {"/states/q", "/states/p", "/levels/h", "/levels/energy"}) {
    CHECK(Reader(plain).read(path) == Reader(carried).read(path));
  }
  CHECK_FALSE(Reader(plain).has("/tangents/growth_1"));
}

TEST_CASE("a matrix and sensitivities are derivatives of the orbit", "[run][tangents]") {
  const Folder folder;
  for (const std::vector<std::string>& scheme : std::vector<std::vector<std::string>>{
           {},
           {"scheme.lagrangian=midpoint", "-scheme.stages"},
           {"scheme.lagrangian=splitting", "-scheme.stages", "scheme.composition=kahan-li-6"},
           {"scheme.lagrangian=generating", "-scheme.stages", "scheme.order=4"}}) {
    std::vector<std::string> settings = scheme;
    settings.emplace_back("scheme.levels=fixed");  // so that the levels of neighbours are the same
    const auto end = [&](const std::string& change) {
      std::vector<std::string> changed = settings;
      if (!change.empty()) {
        changed.push_back(change);
      }
      const std::string file = folder / "end.h5";
      run_text(oscillator, file, changed);
      std::vector<double> z = Reader(file).read("/states/q"), p = Reader(file).read("/states/p");
      const std::vector<double> q_end(z.end() - 2, z.end()), p_end(p.end() - 2, p.end());
      return std::vector<double>{q_end[0], q_end[1], p_end[0], p_end[1]};
    };
    const std::string file = folder / "carried.h5";
    std::vector<std::string> carried = settings;
    carried.emplace_back("scheme.tangents={vectors=2,matrix=true,parameters=[\"k\",\"c\"]}");
    run_text(oscillator, file, carried);
    const std::vector<double> matrix = Reader(file).read("/tangents/matrix"),
                              sensitivities = Reader(file).read("/tangents/sensitivities");
    const std::size_t matrices = matrix.size() / 16, derivatives = sensitivities.size() / 8;
    REQUIRE(matrices == 31);
    REQUIRE(derivatives == 31);
    const auto check = [&](const std::string& entry, double value, const auto& carried_one) {
      CAPTURE(entry, scheme);
      constexpr double d = 1e-5;  // errors: d² of third derivatives, which are some hundreds at t = 6, and ε/d
      const std::vector<double> above = end(entry + "=" + std::to_string(value + d)),
                                below = end(entry + "=" + std::to_string(value - d));
      for (std::size_t i = 0; i < 4; ++i) {
        CHECK(carried_one(i) == Approx((above[i] - below[i]) / (2.0 * d)).margin(1e-6));
      }
    };
    check("initial.x", 0.3, [&](std::size_t i) { return matrix[(matrices - 1) * 16 + i * 4]; });
    check("initial.v", 0.25, [&](std::size_t i) { return matrix[(matrices - 1) * 16 + i * 4 + 3]; });
    check("parameters.k", 1.3, [&](std::size_t i) { return sensitivities[(derivatives - 1) * 8 + i]; });
    check("parameters.c", 0.4, [&](std::size_t i) { return sensitivities[(derivatives - 1) * 8 + 4 + i]; });
    // The mass is in T: of a splitting it rests among the momenta.
    carried.back() = "scheme.tangents={parameters=[\"m\"]}";
    run_text(oscillator, file, carried);
    const std::vector<double> by_mass = Reader(file).read("/tangents/sensitivities");
    check("parameters.m", 1.1, [&](std::size_t i) { return by_mass[by_mass.size() - 4 + i]; });
  }
}

TEST_CASE("a run with tangents is continued with the same bits, and its check finds what is false", "[run][tangents]") {
  const Folder folder;
  struct Kind {
    const char* name;
    std::vector<std::string> settings;
  };
  const std::vector<Kind> kinds = {
      {"henon-heiles", {"scheme.tangents={vectors=4,matrix=true,parameters=[]}", "scheme.until=20"}},
      {"henon-heiles",
       {"scheme.lagrangian=generating", "scheme.order=4", "scheme.tangents={vectors=3,matrix=true}", "scheme.until=5"}},
      {"henon-heiles", {"scheme.lagrangian=splitting", "scheme.tangents=2", "scheme.until=20"}},
      {"henon-heiles",
       {"scheme.lagrangian=forward", "scheme.allow_unstable=true", "scheme.levels=fixed", "scheme.tangents=4",
        "scheme.until=0.8"}},
      {"double-pendulum", {"scheme.tangents={vectors=\"all\",matrix=true}", "scheme.until=3"}},
      {"driven-pendulum", {"scheme.tangents=\"all\"", "scheme.until=10"}},
      {"spherical-pendulum", {"scheme.tangents={vectors=\"all\",matrix=true}", "scheme.until=20"}},
      {"double-pendulum-cartesian", {"scheme.tangents=\"all\"", "scheme.until=3"}},
      {"kepler",
       {"scheme.tangents={vectors=2,parameters=[\"mu\"]}", "parameters.mu=1", "hamiltonian.time_scale=x^2+y^2",
        "hamiltonian.H=(u^2+v^2)/2-mu/sqrt(x^2+y^2)", "scheme.until=2", "scheme.step=0.02"}},
  };
  for (const Kind& kind : kinds) {
    CAPTURE(kind.name, kind.settings);
    const std::string whole = folder / "whole.h5", parts = folder / "parts.h5";
    const Problem problem = read_problem(kind.name, kind.settings);
    const Outcome straight = run(problem, {.output = whole, .overwrite = true, .threads = 1});
    Problem begun = problem;
    std::vector<std::string> shorter = kind.settings;
    const double until = problem.scheme.until;
    shorter.push_back("scheme.until=" + std::to_string(problem.start() + 0.4 * (until - problem.start())));
    static_cast<void>(run(read_problem(kind.name, shorter), {.output = parts, .overwrite = true, .threads = 1}));
    const Outcome continued = resume(parts, until, {.threads = 1});
    for (const char* path : {"/tangents/growth_1", "/tangents/growth_2", "/tangents/two_form", "/tangents/matrix",
                             "/tangents/sensitivities"}) {
      CHECK(Reader(whole).has(path) == Reader(parts).has(path));
      if (Reader(whole).has(path)) {
        CHECK(Reader(whole).read(path) == Reader(parts).read(path));
      }
    }
    CHECK(straight.statistics.exponent(0) == continued.statistics.exponent(0));
    CHECK(straight.statistics.megno() == continued.statistics.megno());

    const Outcome checked = check(whole);
    CHECK(checked.status == ExitStatus::done);
    CHECK(checked.message == "");
    CHECK(checked.statistics.exponent(0) == straight.statistics.exponent(0));
    CHECK(checked.statistics.megno() == straight.statistics.megno());
    CHECK(check(whole, {.replay = true}).status == ExitStatus::done);
    for (const char* path :
         {"/tangents/growth_1", "/tangents/two_form", "/tangents/matrix", "/tangents/sensitivities"}) {
      static_cast<void>(run(problem, {.output = whole, .overwrite = true, .threads = 1}));
      if (Reader(whole).has(path)) {
        CAPTURE(path);
        constexpr std::size_t of_a_step = 3, behind_the_start = 40;
        const bool is_of_steps = Reader(whole).info(path).shape.size() == 1;
        falsify(whole, path, is_of_steps ? of_a_step : behind_the_start, 1e-6);
        const Outcome found = check(whole);
        CHECK(found.status == ExitStatus::contradiction);
        CHECK(std::ranges::any_of(found.disagreements, [path](const Disagreement& one) {
          return one.dataset == path && one.reason.find("tangents of the steps") != std::string::npos;
        }));
      }
    }
  }
}

TEST_CASE("of stored states and rows of some levels tangents are those of all", "[run][tangents]") {
  const Folder folder;
  const std::string all = folder / "all.h5", some = folder / "some.h5";
  const std::vector<std::string> settings = {"scheme.tangents={vectors=2,matrix=true}"};
  const Outcome whole = run_text(oscillator, all, settings);
  const Outcome thinned = run_text(oscillator, some, {settings.front(), "output.every=4"});
  CHECK(whole.statistics.exponent(0) == thinned.statistics.exponent(0));
  CHECK(whole.statistics.megno() == thinned.statistics.megno());
  const std::vector<double> matrices = Reader(all).read("/tangents/matrix"),
                            stored = Reader(some).read("/tangents/matrix");
  const std::size_t states = Reader(some).rows("/states/t");
  REQUIRE(stored.size() == 16 * states);
  CHECK(std::equal(stored.begin() + 16, stored.begin() + 32, matrices.begin() + 64));
  CHECK(std::equal(stored.end() - 16, stored.end(), matrices.end() - 16));
  CHECK(check(some).status == ExitStatus::done);
  CHECK(check(some, {.replay = true}).status == ExitStatus::done);
}

TEST_CASE("an ensemble has a distribution of exponents", "[run][tangents]") {
  const Folder folder;
  const std::string file = folder / "map.h5";
  const Problem problem = parse_problem(oscillator + R"(
tangents = 2
[ensemble]
grid = { initial.x = "0.1:0.3:3" }
)",
                                        "map.toml");
  const EnsembleOutcome outcome = run_ensemble(problem, {.output = file, .threads = 1});
  CHECK_THAT(to_json(outcome), Contains("\"lyapunov/exponents/1\"") || Contains("\"exponents\""));
  CHECK(check_ensemble(file, {.threads = 1}).status == ExitStatus::done);
}

TEST_CASE("what tangents cannot be is refused with the reason and a remedy", "[run][tangents]") {
  CHECK_THAT(why_not(saddle, {"scheme.tangents=3"}), Contains("dimension 2") && Contains("\"all\""));
  CHECK_THAT(why_not(saddle, {"scheme.tangents=every"}), Contains("a number of tangent vectors, or \"all\""));
  CHECK_THAT(why_not(saddle, {"scheme.tangents=-1"}), Contains("-1"));
  CHECK_THAT(why_not(oscillator, {"scheme.tangents={vector=2}"}), Contains("did you mean vectors"));
  CHECK_THAT(why_not(oscillator, {"scheme.tangents={parameters=[\"kk\"]}"}), Contains("no entry of [parameters]"));
  CHECK_THAT(why_not(oscillator, {"scheme.tangents={parameters=[\"k\",\"k\"]}"}), Contains("twice"));
  CHECK_THAT(why_not(oscillator,
                     {"scheme.lagrangian=splitting", "-scheme.stages", "scheme.tangents={parameters=[\"m\",\"k\"]}"}),
             Contains("gauss"));
  CHECK_THAT(why_not(oscillator, {"scheme.lagrangian=forward", "-scheme.stages", "scheme.allow_unstable=true",
                                  "scheme.tangents={parameters=[\"k\"]}"}),
             Contains("one-step map"));
  try {
    static_cast<void>(read_problem("sine-gordon", std::vector<std::string>{"scheme.tangents=2"}));
    CHECK(false);
  } catch (const ProblemError& error) {
    CHECK_THAT(error.what(), Contains("--tangents"));
  }
}
