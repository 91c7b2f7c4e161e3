// Steps that were taken without meeting their equations, claims about why that were false, and energies near 0.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using rubato::defect_tests::defect_file;

namespace {

/// A run of a defective file, and what its record shows.
class Run {
public:
  explicit Run(const std::string& name, const std::vector<std::string>& settings = {}) {
    const tests::Folder folder;
    const std::string file = folder / "record.h5";
    outcome = run(read_problem(defect_file(name + ".toml"), settings), {.output = file, .threads = 1});
    const record::Reader reader(file);
    t = reader.read("/levels/t");
    h = reader.read("/levels/h");
    energy = reader.read("/levels/energy");
    condition = reader.read("/levels/step_condition");
    gamma = reader.read("/levels/gamma");
    off_law = reader.read("/levels/off_law");
    if (reader.has("/states/q")) {
      q = reader.read("/states/q");
      p = reader.read("/states/p");
    }
  }

  /// E, as the first step that is not flagged has it.
  [[nodiscard]] double law() const {
    const auto first = std::ranges::find(off_law, 0.0);
    return first == off_law.end() ? std::nan("") : energy[static_cast<std::size_t>(first - off_law.begin())];
  }

  /// max |E_k - E| over the steps that are flagged, or are not.
  [[nodiscard]] double deviation(bool flagged) const {
    double result = 0.0;
    for (std::size_t k = 0; k < energy.size(); ++k) {
      if ((off_law[k] != 0.0) == flagged) {
        result = std::max(result, std::abs(energy[k] - law()));
      }
    }
    return result;
  }

  /// What is reported in sentences.
  [[nodiscard]] std::string reported() const {
    std::string text = outcome.message;
    for (const std::string& warning : outcome.warnings) {
      text += "\n" + warning;
    }
    return text;
  }
  [[nodiscard]] bool tells(const std::string& part) const { return reported().find(part) != std::string::npos; }

  Outcome outcome;
  std::vector<double> t, h, energy, condition, gamma, off_law, q, p;
};

using Point = std::vector<long double>;
using Function = std::function<long double(const Point&)>;

/// How far the steps of a run are from the midpoint rule, and those not flagged from E, by an evaluation of H in long
/// double and central differences of it: max over steps of |δ - hJ∇H(z̄)| / max |δ| and of |H(z̄) - E|.
struct Misses {
  double equation = 0.0;
  double law = 0.0;
};

Misses misses_of_midpoint(const Run& run, std::size_t n, const Function& H) {
  // With a fourth-order difference of width d the error is d⁴ of the fifth derivative, and 1e-19/d of rounding.
  constexpr long double d = 1e-4L;
  Misses worst;
  for (std::size_t k = 0; k < run.h.size(); ++k) {
    Point middle(2 * n), delta(2 * n);
    for (std::size_t i = 0; i < n; ++i) {
      const long double q_0 = run.q[k * n + i], q_1 = run.q[(k + 1) * n + i];
      const long double p_0 = run.p[k * n + i], p_1 = run.p[(k + 1) * n + i];
      middle[i] = (q_0 + q_1) / 2;
      middle[n + i] = (p_0 + p_1) / 2;
      delta[i] = q_1 - q_0;
      delta[n + i] = p_1 - p_0;
    }
    const auto slope = [&](std::size_t i) {
      const auto at = [&](long double shift) {
        Point z = middle;
        z[i] += shift;
        return H(z);
      };
      return (8 * (at(d) - at(-d)) - (at(2 * d) - at(-2 * d))) / (12 * d);
    };
    long double size = 0.0, off = 0.0;
    for (std::size_t i = 0; i < 2 * n; ++i) {
      const long double f = i < n ? slope(n + i) : -slope(i - n);
      size = std::max(size, std::abs(delta[i]));
      off = std::max(off, std::abs(delta[i] - run.h[k] * f));
    }
    worst.equation = std::max(worst.equation, static_cast<double>(off / size));
    if (run.off_law[k] == 0.0) {
      worst.law = std::max(worst.law, static_cast<double>(std::abs(H(middle) - run.law())));
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("a step that is not flagged meets the energy law, also where steps are so coarse that Γ all but vanishes") {
  const Run run("unflagged-138", {"scheme.on_singular=plain"});
  const auto H = [](const Point& z) {
    const long double x = z[0], u = z[1];
    return u * u * 0.786 + x * x * -0.071 + x * x * x * x * 0.114 + 0.031 * x * u + 0.628 * std::cos(x + u);
  };
  CHECK(run.outcome.complete);
  const Misses misses = misses_of_midpoint(run, 1, H);
  CHECK(misses.law <= 1e-13);
  // The twin: states off by a thousandth do not.
  Run moved("unflagged-138", {"scheme.until=-8", "scheme.on_singular=plain"});
  for (double& q : moved.q) {
    q *= 1.001;
  }
  CHECK(misses_of_midpoint(moved, 1, H).law > 1e-6);
}

TEST_CASE("levels of a coarse orbit meet the law to the tolerance") {
  const Run run("level-miss-orbit");
  REQUIRE(run.outcome.status == ExitStatus::done);
  CHECK(run.deviation(false) <= 1e-13 * std::abs(run.law()));
}

TEST_CASE("levels of a lattice meet the law to the tolerance") {
  const Run run("level-miss-nls");
  REQUIRE(run.outcome.status == ExitStatus::done);
  CHECK(run.deviation(false) <= 1e-13 * std::abs(run.law()));
}

TEST_CASE("plain steps off the law solve their equation to rounding") {
  const Run run("unconverged-26", {"scheme.on_singular=plain"});
  const auto H = [](const Point& z) {
    const long double x = z[0], y = z[1], u = z[2], v = z[3];
    return u * u * 1.536 + v * v * 0.462 + x * x * 0.826 + y * y * -0.072 + x * x * x * x * 0.738 +
           y * y * y * y * 0.502 - 0.031 * x * y * v - 0.272 * x * x * u + 0.251 * v * u * x;
  };
  REQUIRE(std::ranges::count(run.off_law, 1.0) > 0);
  const Misses misses = misses_of_midpoint(run, 2, H);
  // Stored states are rounded: ε|z| beside increments a fifth of that. The differences of H are good to 1e-15.
  CHECK(misses.equation <= 2e-14);
  CHECK(misses.law <= 1e-13 * std::abs(run.law()));
}

TEST_CASE("E is the law's, and a first step that is too long to set it is told so") {
  const Run run("start-plain-90", {"scheme.until=4", "scheme.on_singular=plain"});
  CHECK(run.law() == Approx(0.544861547298797).epsilon(1e-11));  // of the second step
  CHECK(run.off_law[0] == 1.0);
  CHECK(run.deviation(false) <= 1e-13);
  CHECK(run.tells("the first step is too long"));
  CHECK_FALSE(run.tells("rounding"));
}

TEST_CASE("with a step potential coarse steps meet their law, and are told to be too long where it has to be large") {
  for (const auto& [name, too_long] : {std::pair{"start-plain-90", true},
                                       {"unconverged-26", true},
                                       {"unflagged-138", true},
                                       {"level-miss-nls", false}}) {
    INFO(name);
    const Run run(name);
    CHECK(run.outcome.complete);
    CHECK(std::ranges::count(run.off_law, 1.0) == 0);
    CHECK(run.deviation(false) <= 1e-13 * std::abs(run.law()));
    CHECK(run.tells("the first step is too long") == too_long);
  }
}

TEST_CASE("what another scheme has as Γ is not told as that of a discrete Lagrangian of the user's") {
  const Run run("custom-trapezoid", {"scheme.on_singular=stop"});
  CHECK(run.outcome.status == ExitStatus::singular);
  CHECK_FALSE(run.tells("Gamma"));
  CHECK(run.tells("dE/dh nears 0"));
  CHECK(to_json(run.outcome).find("\"gamma\"") == std::string::npos);
  CHECK(to_table(run.outcome).find("Gamma") == std::string::npos);
  CHECK(std::ranges::all_of(run.gamma, [](double value) { return std::isnan(value); }));
}

TEST_CASE("Γ is said to be 0 to rounding only where it is, and a motion that blows up is told as that") {
  for (const char* const name : {"every-step-off-law", "over"}) {
    INFO(name);
    const Run run(name);
    CHECK(run.outcome.status == ExitStatus::failed);
    CHECK_FALSE(run.tells("rounding"));
    CHECK(run.tells("too long for a motion that speeds up"));
  }
}

TEST_CASE("a Γ that is not finite at the start is refused with the place and the reason") {
  CHECK_THROWS_WITH(Run("gamma-not-finite"), Catch::Contains("initial state (0, 1)") && Catch::Contains("Gamma"));
}

TEST_CASE("H has no preferred zero: at E = 0 the double pendulum steps as with H + 3, bit by bit") {
  for (const char* const order : {"scheme.order=8", "scheme.order=4", "scheme.order=2"}) {
    INFO(order);
    const std::vector<std::string> settings = {"scheme.lagrangian=generating", order, "scheme.step=0.1",
                                               "scheme.until=3"};
    std::vector<std::string> raised_settings = settings;
    raised_settings.emplace_back(
        "hamiltonian.H=(u^2 + 2*v^2 - 2*u*v*cos(a-b))/(2*(1+sin(a-b)^2)) - 2*cos(a) - cos(b) + 3");
    const Run at_zero("double-pendulum-at-zero-energy", settings);
    const Run raised("double-pendulum-at-zero-energy", raised_settings);
    REQUIRE(at_zero.outcome.status == ExitStatus::done);
    CHECK(at_zero.h == raised.h);
    CHECK(at_zero.q == raised.q);
    CHECK(at_zero.condition == raised.condition);
    CHECK(at_zero.off_law == raised.off_law);
    for (std::size_t k = 0; k < at_zero.energy.size(); ++k) {
      REQUIRE(std::abs(raised.energy[k] - at_zero.energy[k] - 3.0) <= 1e-15);
    }
    if (std::string(order) != "scheme.order=8") {  // there the law is rounding at first: plain steps
      CHECK(std::ranges::count(at_zero.off_law, 0.0) > 0);
    }
  }
  // The twin: a constant that is not added to H but made of its variables is felt, as rounding.
  const Run hidden("double-pendulum-at-zero-energy",
                   {"scheme.step=0.1", "scheme.until=3",
                    "hamiltonian.H=(u^2 + 2*v^2 - 2*u*v*cos(a-b))/(2*(1+sin(a-b)^2)) - 2*cos(a) - cos(b) + "
                    "3000*(sin(a)^2 + cos(a)^2)"});
  const Run plain("double-pendulum-at-zero-energy", {"scheme.step=0.1", "scheme.until=3"});
  CHECK(hidden.h != plain.h);
}

TEST_CASE("H has no preferred zero: the double pendulum at E = 0, order 8, to the end of its run", "[long]") {
  const Run run("double-pendulum-at-zero-energy", {"scheme.lagrangian=generating", "scheme.order=8"});
  CHECK(run.outcome.status == ExitStatus::done);
  // Steps of 0.01 are so short for order 8 that E hardly depends on h: that is what is reported, and nothing else is
  // tried.
  CHECK(run.h.size() < 11000);
}

TEST_CASE("a step potential that holds an eccentric orbit at the steps of its pericentre says so, and what to do") {
  const Run held("eccentric");
  CHECK(held.tells("times as many as the law would without it"));
  CHECK(held.tells("time_scale"));
  // The twins: the same with another potential, in another time, and an orbit that is nearly a circle.
  CHECK_FALSE(Run("eccentric", {"scheme.step_potential=none"}).tells("times as many"));
  CHECK_FALSE(Run("eccentric", {"hamiltonian.time_scale=(x^2 + y^2)^(3/4)", "scheme.step=0.1"}).tells("times as many"));
  CHECK_FALSE(Run("eccentric", {"parameters.e=0.3"}).tells("times as many"));
}
