// [hamiltonian] time_scale: orbits in fictitious time, with the time as a coordinate (theory, section 9).

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include <rubato/problem/effective.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

const double pi = std::acos(-1.0);
const std::string kepler_scale = "hamiltonian.time_scale=(x^2 + y^2)^(3/4)";

/// A Kepler orbit of semi-major axis 1 from its pericentre.
Problem kepler(double e, std::vector<std::string> settings) {
  settings.push_back(fmt::format("parameters.e={}", e));
  settings.emplace_back("scheme.until=1000");
  return read_problem("kepler", settings);
}

struct Ran {
  std::size_t steps = 0, flagged = 0;
  double energy_deviation = 0.0;  ///< max |E_k - E| of the steps not flagged, relative to what is allowed
  double error = 0.0;             ///< largest distance from the orbit at the level's own time, in the last revolution
  bool energy_is_constant = true;
  double last_time = 0.0;
};

/// Where the orbit is at time t, by Newton's iteration on Kepler's equation.
std::array<double, 2> position(double e, double t) {
  const double mean = std::remainder(t, 2.0 * pi);
  double anomaly = std::copysign(pi, mean);
  for (int i = 0; i < 100; ++i) {
    anomaly -= (anomaly - e * std::sin(anomaly) - mean) / (1.0 - e * std::cos(anomaly));
  }
  return {std::cos(anomaly) - e, std::sqrt(1.0 - e * e) * std::sin(anomaly)};
}

Ran run_kepler(double e, double revolutions, const std::vector<std::string>& settings) {
  OrbitIntegrator orbit = make_integrator(kepler(e, settings));
  const bool fictitious = orbit.q().size() == 3;
  const double minus_energy = fictitious ? orbit.p()[2] : 0.0;
  Ran ran;
  while (ran.last_time < 2.0 * pi * revolutions) {
    const StepReport step = orbit.step();
    REQUIRE(step.status == Status::success);
    ran.last_time = fictitious ? orbit.q()[2] : orbit.t();
    ++ran.steps;
    ran.flagged += step.off_law ? 1 : 0;
    if (!step.off_law) {
      // The tolerance of the terms of E_k, or rounding where Ĥ = 0 leaves more of it.
      const TimeLevels& levels = orbit.levels();
      const double allowed = std::max(1e-13 * levels.energy_scale(), 4.0 * levels.energy_rounding());
      ran.energy_deviation = std::max(ran.energy_deviation, std::abs(step.energy - step.target) / allowed);
    }
    ran.energy_is_constant = ran.energy_is_constant && (!fictitious || orbit.p()[2] == minus_energy);
    if (ran.last_time > 2.0 * pi * (revolutions - 1.0)) {
      const auto [x, y] = position(e, ran.last_time);
      ran.error = std::max(ran.error, std::hypot(orbit.q()[0] - x, orbit.q()[1] - y));
    }
  }
  return ran;
}

std::string refusal(const std::vector<std::string>& settings) {
  try {
    static_cast<void>(read_problem("kepler", settings));
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("in fictitious time eccentric orbits meet the law on every step, in fewer steps than the law takes in time") {
  for (const double e : {0.05, 0.6, 0.9, 0.99}) {
    INFO("e = " << e);
    const Ran fictitious = run_kepler(e, 5.0, {kepler_scale, "scheme.step=0.1"});
    CHECK(fictitious.flagged == 0);
    CHECK(fictitious.energy_deviation <= 1.0);
    CHECK(fictitious.energy_is_constant);  // to the last bit: Ĥ does not hold the time
    // The same first step in time: g is (1 - e)^(3/2) at the pericentre.
    const Ran plain =
        run_kepler(e, 5.0, {fmt::format("scheme.step={}", 0.1 * std::pow(1.0 - e, 1.5)), "scheme.on_singular=plain"});
    CHECK(static_cast<double>(fictitious.steps) <= 1.05 * static_cast<double>(plain.steps));
    CHECK(fictitious.error < plain.error);
    CHECK((plain.flagged > 0) == (e > 0.8));  // the twin: the law in time lacks levels beyond e = √(5/8)
  }
}

TEST_CASE("in fictitious time the orbit is that of H at the times that are found, to the order of the scheme") {
  for (const int stages : {1, 2}) {
    const std::vector<std::string> gauss = {kepler_scale, "scheme.lagrangian=gauss",
                                            fmt::format("scheme.stages={}", stages),
                                            "scheme.step_potential={ kappa = 1.2, p = 6 }"};
    const auto error = [&](double step) {
      std::vector<std::string> settings = gauss;
      settings.push_back(fmt::format("scheme.step={}", step));
      return run_kepler(0.9, 3.0, settings).error;
    };
    const double coarse = error(0.1), fine = error(0.05);
    INFO("stages " << stages << ": " << coarse << ", " << fine);
    // Halving the step, and with it f' = η_0 h_0^s (…): 2^(2m), to which higher powers of h add.
    CHECK(std::log2(coarse / fine) == Approx(2.0 * stages).margin(0.5));
  }
}

TEST_CASE("in fictitious time the two-form is preserved with the time and its momentum, and a step potential") {
  // dp∧dq + dw∧dt - dÊ∧ds at the end of a run, as a form of the start and the first step, is dp_0∧dq_0 + dw_0∧dt_0.
  const Problem problem = kepler(0.6, {kepler_scale, "scheme.step=0.1"});
  const Problem same = kepler(0.6, {"scheme.time_scale=(x^2 + y^2)^(3/4)", "scheme.step=0.1"});
  CHECK(same.hamiltonian()->H.text == problem.hamiltonian()->H.text);
  CHECK(same.hamiltonian()->fictitious_time);
  CHECK_FALSE(kepler(0.6, {"scheme.step=0.1"}).hamiltonian()->fictitious_time);
  const Hamiltonian hamiltonian = make_hamiltonian(problem);
  const PhasePoint& start = problem.hamiltonian()->initial;
  const StepPotential f{.strength = -1e-3, .length = 0.12, .exponent = 4.0};
  constexpr std::size_t n = 3, parameters = 2 * n + 1;
  constexpr int steps = 20;
  struct End {
    std::array<double, 2 * n> z{};
    double s = 0.0, E = 0.0, K = 0.0;
  };
  const auto end_of = [&](std::size_t which, double change) {
    InitialState initial{.q = start.q, .p = start.p};
    if (which < n) {
      initial.q[which] += change;
    } else if (which < 2 * n) {
      initial.p[which - n] += change;
    }
    OrbitIntegrator run(hamiltonian, initial,
                        {.step = 0.1 + (which == 2 * n ? change : 0.0),
                         .until = 1e3,
                         .potential = {.kind = StepPotentialChoice::Kind::stated, .potential = f}});
    StepReport first;
    for (int k = 0; k < steps; ++k) {
      const StepReport step = run.step();
      REQUIRE(step.status == Status::success);
      REQUIRE(!step.off_law);
      first = k == 0 ? step : first;
    }
    End end{.z = {}, .s = run.t(), .E = first.energy, .K = first.energy - first.potential};
    std::ranges::copy(run.p(), std::ranges::copy(run.q(), end.z.begin()).out);
    return end;
  };
  constexpr double d = 3e-4;
  std::array<End, parameters> by;
  for (std::size_t i = 0; i < parameters; ++i) {
    const End far = end_of(i, 2.0 * d), more = end_of(i, d), less = end_of(i, -d), back = end_of(i, -2.0 * d);
    const auto rate = [&](const auto& part) {
      return (8.0 * (part(more) - part(less)) - (part(far) - part(back))) / (12.0 * d);
    };
    for (std::size_t j = 0; j < 2 * n; ++j) {
      by[i].z[j] = rate([j](const End& end) { return end.z[j]; });
    }
    by[i].s = rate([](const End& end) { return end.s; });
    by[i].E = rate([](const End& end) { return end.E; });
    by[i].K = rate([](const End& end) { return end.K; });
  }
  double largest = 0.0, wrong = 0.0;
  for (std::size_t i = 0; i < parameters; ++i) {
    for (std::size_t j = i + 1; j < parameters; ++j) {
      const End &a = by[i], &b = by[j];
      const double before = i < n && j == i + n ? -1.0 : 0.0;
      double area = 0.0, size = 1.0 + std::abs(a.E * b.s) + std::abs(a.s * b.E);
      for (std::size_t k = 0; k < n; ++k) {
        area += a.z[n + k] * b.z[k] - a.z[k] * b.z[n + k];
        size += std::abs(a.z[n + k] * b.z[k]) + std::abs(a.z[k] * b.z[n + k]);
      }
      largest = std::max(largest, std::abs(area - (a.E * b.s - a.s * b.E) - before) / size);
      wrong = std::max(wrong, std::abs(area - (a.K * b.s - a.s * b.K) - before) / size);
    }
  }
  // Differences of fourth order are off by d⁴ times fifth derivatives, some 10⁶ beside the pericentre.
  CHECK(largest < 1e-7);
  CHECK(wrong > 50.0 * largest);  // the twin: f' left out of Ê
}

TEST_CASE("a run in fictitious time is recorded, checked, replayed and continued") {
  const Folder folder;
  const std::string straight = folder / "straight.h5", stopped = folder / "stopped.h5";
  const std::vector<std::string> settings = {kepler_scale, "scheme.step=0.1", "parameters.e=0.9"};
  const auto until = [&](const char* end) {
    std::vector<std::string> all = settings;
    all.push_back(fmt::format("scheme.until={}", end));
    return all;
  };
  const Outcome ran = run_problem("kepler", straight, until("20"));
  REQUIRE(ran.status == ExitStatus::done);
  CHECK(ran.statistics.off_law_steps == 0);
  CHECK_THAT(to_table(ran), Contains("step potential"));
  const Outcome checked = check(straight, {.replay = true});
  CHECK(checked.status == ExitStatus::done);
  CHECK(differences(ran, checked) == Names{});
  run_problem("kepler", stopped, until("9"));
  CHECK(resume(stopped, 20.0, {.threads = 1}).status == ExitStatus::done);
  CHECK(different_datasets(straight, stopped) == Names{});
  falsify(straight, "/states/p", 3 * 7 + 2, 1e-9);  // minus_energy at one level
  CHECK(check(straight).status == ExitStatus::contradiction);
}

TEST_CASE("in fictitious time a run says of output times that it did not come to them") {
  const Folder folder;
  const auto beyond = [&](const std::string& until) {
    const Outcome ran = run_problem("kepler", folder / "a.h5",
                                    {kepler_scale, "scheme.step=0.1", until, "output.times=[0.5, 1.0, 60.0, 61.0]"});
    return std::ranges::count_if(ran.warnings, [](const std::string& text) {
      return text.find("2 of 4 output times lie beyond the end of the run at t = ") != std::string::npos;
    });
  };
  CHECK(beyond("scheme.until=20") == 1);
  CHECK(beyond("scheme.until=200") == 0);  // the twin: it comes to all of them
}

TEST_CASE("time scales that cannot be are refused with the place") {
  CHECK(refusal({kepler_scale}).empty());
  CHECK_THAT(refusal({"hamiltonian.time_scale=x - 5"}), Contains("time_scale is") && Contains("positive"));
  CHECK_THAT(refusal({"hamiltonian.time_scale=1/(x - x)"}), Contains("time_scale"));
  CHECK_THAT(refusal({"hamiltonian.time_scale=r^1.5"}), Contains("unknown name 'r'"));
  CHECK_THAT(refusal({"scheme.time_scale=r^1.5"}), Contains("unknown name 'r'"));
  CHECK_THAT(refusal({"hamiltonian.time_scale=x", "scheme.time_scale=x"}), Contains("given twice"));
  CHECK_THAT(refusal({"hamiltonian.time_scale=x", "hamiltonian.q=[\"x\", \"time\"]"}), Contains("time_scale makes"));
  CHECK_THAT(refusal({"hamiltonian.time_scale=x", "exact.x=t"}), Contains("fictitious time"));
  CHECK_THAT(refusal({"hamiltonian.time_scale=x", "initial.next={ t = 0.1, x = 0.4, y = 0.1, u = 0, v = 2 }"}),
             Contains("fictitious time"));
  CHECK_THAT(refusal({"hamiltonian.time_scale=x", "scheme.lagrangian=custom", "scheme.L=x_0"}),
             Contains("not for lagrangian = \"custom\""));
  CHECK_THAT(refusal({kepler_scale, "scheme.step=auto", "scheme.energy_tolerance=1e-3"}),
             Contains("give the first step as a number"));
  CHECK_THAT(refusal({kepler_scale, "scheme.lagrangian=splitting"}), Contains("T(p) + V(q)"));
}
