// H(q, p, t): driven systems, in an extended phase space in which the energy law is the balance (3.4).

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/orbit_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

struct End {
  double q = 0.0, p = 0.0, work = 0.0;
};

/// The driven pendulum at t = 5 with equal steps. There E_k is that of the extended system, so that nothing is said of
/// levels.
End end_of(std::vector<std::string> settings, double step) {
  settings.insert(settings.end(), {"scheme.levels=fixed", fmt::format("scheme.step={}", step), "scheme.until=5"});
  OrbitIntegrator orbit = make_integrator(read_problem("driven-pendulum", settings));
  while (orbit.t() < 5.0 - 1e-9) {
    REQUIRE(orbit.step().status == Status::success);
  }
  return {orbit.q()[0], orbit.p()[0], -orbit.p()[1]};
}

std::string refusal(const std::vector<std::string>& settings) {
  try {
    static_cast<void>(read_problem("driven-pendulum", settings));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("driven orbits converge with the order of their scheme, and the work is that of the force") {
  const std::vector<std::string> gauss = {"scheme.lagrangian=gauss", "scheme.stages=6"};
  const End exact = end_of(gauss, 0.05);  // order 12: error about 0.05^12, below rounding
  // H(q, p, t) less its value at the start is the work.
  const double start = -std::cos(0.5) - 0.5 * 0.5;
  const double now = exact.p * exact.p / 2.0 - std::cos(exact.q) - exact.q * 0.5 * std::cos(0.7 * 5.0);
  CHECK(exact.work == Approx(now - start).margin(1e-13));
  CHECK(std::abs(exact.work) > 0.1);
  struct Row {
    std::vector<std::string> settings;
    double order, step;
  };
  for (const Row& row : {Row{{"scheme.lagrangian=midpoint"}, 2, 0.1}, Row{{"scheme.lagrangian=splitting"}, 2, 0.1},
                         Row{{"scheme.lagrangian=splitting", "scheme.composition=kahan-li-6"}, 6, 0.5},
                         Row{{"scheme.lagrangian=generating", "scheme.order=4"}, 4, 0.2},
                         Row{{"scheme.lagrangian=gauss", "scheme.stages=2"}, 4, 0.2}}) {
    INFO(row.settings.back());
    double last = 0.0;
    for (int i = 0; i < 3; ++i) {
      const End end = end_of(row.settings, row.step / std::exp2(i));
      const double error = std::max(std::hypot(end.q - exact.q, end.p - exact.p), std::abs(end.work - exact.work));
      CHECK(error > 1e-13);
      if (i > 0) {
        // The next term of the error is h² smaller: at these steps a few tenths of the slope.
        CHECK(std::log2(last / error) == Approx(row.order).margin(0.4));
      }
      last = error;
    }
  }
}

TEST_CASE("with variable levels the energy balance of a driven system holds on every step") {
  for (const std::string scheme : {"midpoint", "gauss", "splitting", "generating"}) {
    std::vector<std::string> settings = {"scheme.lagrangian=" + scheme};
    if (scheme == "gauss") {
      settings.emplace_back("scheme.stages=3");
    } else if (scheme == "generating") {
      settings.emplace_back("scheme.order=4");
    }
    INFO(scheme);
    const Folder folder;
    const Outcome ran = run_problem("driven-pendulum", folder / "a.h5", settings);
    REQUIRE(ran.status == ExitStatus::done);
    CHECK(ran.statistics.balance);
    CHECK(ran.statistics.off_law_steps == 0);
    // The tolerance, 1e-13, is relative to the terms of H + w: T, cos q, q·force and w, each at most 2 more than the
    // energy of the pendulum.
    const double terms = 4.0 * (2.0 + ran.statistics.invariants.front().value.max());
    CHECK(ran.statistics.energy_deviation() <= 1e-13 * terms);
    // The twin: the energy of the pendulum itself is not conserved.
    CHECK(ran.statistics.invariants.front().value.max() > 1.0);
    const Outcome checked = check(folder / "a.h5");
    CHECK(checked.status == ExitStatus::done);
    CHECK(differences(ran, checked) == Names{});
    falsify(folder / "a.h5", "/states/p", 41, 1e-7);  // minus_work of level 20
    CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
  }
}

TEST_CASE("a parametric oscillator has the Floquet multipliers of its equation") {
  // q'' + (1 + a cos 2t) q = 0 over the period pi of its force: the trace of the monodromy matrix, by Gauss of order
  // 12, and by the splitting of order 8 to its own accuracy.
  const std::string text =
      replaced(replaced(pendulum, "p^2/2 - cos(q)", "p^2/2 + (1 + k*cos(2*t))*q^2/2"), "k = 1.0", "k = 0.4");
  const auto trace = [&](const std::vector<std::string>& scheme) {
    double sum = 0.0;
    for (const bool first : {true, false}) {
      std::vector<std::string> settings = scheme;
      settings.insert(settings.end(),
                      {"scheme.levels=fixed", "scheme.step=pi/64", "scheme.until=pi",
                       fmt::format("initial.q={}", first ? 1 : 0), fmt::format("initial.p={}", first ? 0 : 1)});
      OrbitIntegrator orbit = make_integrator(parse_problem(text, "t.toml", settings));
      for (int k = 0; k < 64; ++k) {
        REQUIRE(orbit.step().status == Status::success);
      }
      sum += first ? orbit.q()[0] : orbit.p()[0];
    }
    return sum;
  };
  const double gauss = trace({"scheme.lagrangian=gauss", "scheme.stages=6"});
  const double splitting = trace({"scheme.lagrangian=splitting", "scheme.composition=kahan-li-8"});
  CHECK(gauss == Approx(splitting).margin(1e-9));  // (pi/64)^8 times constants of the composition
  CHECK(gauss < -2.0);                             // inside the first tongue: unstable
  CHECK(std::abs(trace({"scheme.lagrangian=midpoint"}) - gauss) > 1e-6);
}

TEST_CASE("Gauss starts where a component and its slope are 0") {
  // Once the first correction had no unit there, and was called undefined.
  const std::string falling = replaced(replaced(pendulum, "p^2/2 - cos(q)", "p^2/2 + q"), "p = 1.9", "p = 0");
  for (const std::string stages : {"1", "2", "5"}) {
    OrbitIntegrator orbit = make_integrator(parse_problem(
        falling, "t.toml",
        std::vector<std::string>{"scheme.lagrangian=gauss", "scheme.stages=" + stages, "scheme.levels=fixed"}));
    REQUIRE(orbit.step().status == Status::success);
    CHECK(orbit.q()[0] == Approx(-0.005).epsilon(1e-14));
    CHECK(orbit.p()[0] == Approx(-0.1).epsilon(1e-14));
  }
}

TEST_CASE("a driven wave at rest stays there exactly, and a faint one is as any other") {
  const Folder folder;
  const auto largest = [&](const std::string& u, const std::string& scheme, int stages) {
    std::vector<std::string> settings = {"scheme.lagrangian=" + scheme};
    if (stages > 0) {
      settings.push_back(fmt::format("scheme.stages={}", stages));
    }
    const Problem wave = parse_problem(
        "[multisymplectic]\nfields = [\"u\", \"v\", \"w\"]\nM = [[\"u\", \"v\", -1]]\nK.x = [[\"u\", \"w\", 1]]\n"
        "S = \"(v^2 - w^2)/2 + exp(t/1000)*(1 - cos(exp(-t/2000)*u))\"\n"
        "[grid]\nx = { from = 0, to = \"2*pi\", cells = 33 }\n[initial]\nu = \"" +
            u + "\"\nv = 0\n[scheme]\nlevels = \"fixed\"\nstep = 0.1\nuntil = 5\n",
        "t.toml", settings);
    const Outcome outcome = run(wave, {.output = folder / "a.h5", .overwrite = true, .threads = 1});
    INFO(outcome.message);
    REQUIRE(outcome.status == ExitStatus::done);
    std::vector<double> sizes;
    for (const char* field : {"/states/u", "/states/minus_work"}) {
      double& size = sizes.emplace_back(0.0);
      for (const double value : record::Reader(folder / "a.h5").read(field)) {
        size = std::max(size, std::abs(value));
      }
    }
    return sizes;
  };
  for (const auto& [scheme, stages] :
       {std::pair{"box", 1}, {"box", 2}, {"fourier", 1}, {"fourier", 2}, {"euler-box", 0}, {"splitting", 0}}) {
    INFO(scheme << ", " << stages << " stages");
    CHECK(largest("0", scheme, stages) == std::vector{0.0, 0.0});
    // A standing wave, linear to rounding.
    CHECK(largest("1e-30*cos(x)", scheme, stages)[0] == Approx(1e-30).epsilon(0.01));
    // The twin: something moves, and does work.
    CHECK(largest("cos(x)", scheme, stages)[1] > 1e-6);
  }
}

TEST_CASE("a driven run is the same whether it was stopped and continued or not") {
  const Folder folder;
  const std::string straight = folder / "straight.h5", stopped = folder / "stopped.h5";
  REQUIRE(run_problem("driven-pendulum", straight, {"scheme.until=20"}).status == ExitStatus::done);
  REQUIRE(run_problem("driven-pendulum", stopped, {"scheme.until=7"}).status == ExitStatus::done);
  REQUIRE(resume(stopped, 20.0, {.threads = 1}).status == ExitStatus::done);
  CHECK(different_datasets(straight, stopped) == Names{});
}

TEST_CASE("what a driven system cannot have is refused with the reason") {
  CHECK_THAT(refusal({"output.times=[\"t\"]"}), Contains("unknown name 't'") && !Contains("unknown name 'time'"));
  CHECK_THAT(refusal({"initial.next={ q = 0.5, p = 0, t = 0.1 }"}),
             Contains("the work done until the second level is not known"));
  CHECK_THAT(refusal({"scheme.lagrangian=custom", "scheme.L=(q_1-q_0)^2"}), Contains("one that does not name t"));
  CHECK_THAT(refusal({"parameters={ strength = 1, omega = 1, time = 2 }"}),
             Contains("\"time\" cannot name one of the pair"));
}
