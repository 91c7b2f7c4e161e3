#include <algorithm>
#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>

// Running back through bridges: docs/bridges.md.

using namespace rubato;

namespace {

using State = std::vector<double>;

struct Run {
  std::vector<State> levels;
  std::size_t bridges = 0;
  double amplitude = 1.0;  ///< farthest the amplitude c of H - E went from its first value, as a factor
  double t = 0.0;
  double h = 0.0;  ///< of the last step
};

/// At least `steps` steps, up to an ordinary one that follows five others, or exactly as many.
Run follow(const Hamiltonian& hamiltonian, const State& start, double t, double step, std::size_t steps, bool exactly,
           BridgeRule rule) {
  const auto n = static_cast<std::ptrdiff_t>(start.size() / 2);
  OrbitIntegrator integrator(hamiltonian,
                             {.q = {start.begin(), start.begin() + n}, .p = {start.begin() + n, start.end()}, .t = t},
                             {.step = step, .until = std::copysign(1e9, step), .bridge = rule});
  Run run;
  run.levels.push_back(start);
  double first = 0.0;
  for (int ordinary = 0; run.levels.size() <= steps || (!exactly && ordinary < 6);) {
    const StepReport report = integrator.step();
    REQUIRE(report.status == Status::success);
    const auto z = integrator.scheme().state();
    run.levels.emplace_back(z.begin(), z.end());
    run.bridges += report.crossing ? 1 : 0;
    run.h = report.h;
    ordinary = report.bridged ? 0 : ordinary + 1;
    const double c = integrator.levels().law_constant();
    first = first == 0.0 ? c : first;
    run.amplitude = std::max({run.amplitude, c / first, first / c});
  }
  run.t = integrator.t();
  return run;
}

double distance(const State& a, const State& b) {
  double result = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    result = std::max(result, std::abs(a[i] - b[i]));
  }
  return result;
}

/// Forward, and back again from the end.
struct Return {
  double miss = 0.0;       ///< distance of the state that should be the start from it
  double condition = 0.0;  ///< how much the way back enlarges a distance of 1e-9 at its beginning
  std::size_t bridges = 0;
  bool same_count = false;
};

Return there_and_back(const Hamiltonian& hamiltonian, const State& start, double step, std::size_t steps,
                      BridgeRule rule) {
  const Run forward = follow(hamiltonian, start, 0.0, step, steps, false, rule);
  const std::size_t count = forward.levels.size() - 1;
  const State& end = forward.levels.back();
  const Run back = follow(hamiltonian, end, forward.t, -forward.h, count, true, rule);
  constexpr double nudge = 1e-9;
  State beside = end;
  beside[0] += nudge;
  const Run neighbour = follow(hamiltonian, beside, forward.t, -forward.h, count, true, rule);
  Return result;
  result.miss = distance(back.levels.back(), start);
  for (std::size_t k = 0; k <= count; ++k) {
    result.condition = std::max(result.condition, distance(back.levels[k], neighbour.levels[k]) / nudge);
  }
  result.bridges = forward.bridges;
  result.same_count = back.bridges == forward.bridges;
  return result;
}

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
const Hamiltonian double_well({"q"}, {"p"}, "p^2/2 + (q^4 - q^2)/2");
const Hamiltonian kepler({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");

State pericentre(double e) {
  return {1.0 - e, 0.0, 0.0, std::sqrt((1.0 + e) / (1.0 - e))};
}

}  // namespace

// The level equation is solved to 1e-14|E|, which makes h uncertain by 4e-14|E|/(h²|Γ|), relatively: 1e-10 at most in
// these runs. The way back adds up a few hundred of such errors, each enlarged by `condition` at most.
constexpr double accuracy = 1e-9;

TEST_CASE("a run with reversible bridges returns to its start; with anchored ones it comes back only nearby") {
  struct Case {
    const char* name;
    const Hamiltonian& hamiltonian;
    State start;
    double step;
    std::size_t steps, bridges;
  };
  for (const Case& c :
       {Case{"pendulum", pendulum, {0.0, 2.2}, 0.05, 1000, 39}, Case{"pendulum", pendulum, {0.0, 2.2}, 0.025, 2000, 38},
        Case{"double well", double_well, {1.02, 0.0}, 0.02, 2000, 25},
        Case{"Kepler", kepler, pericentre(0.9), 0.02 * std::pow(0.1, 1.5), 2000, 24},
        Case{"Kepler", kepler, pericentre(0.95), 0.02 * std::pow(0.05, 1.5), 2000, 19}}) {
    INFO(c.name << ", step " << c.step);
    const Return reversible = there_and_back(c.hamiltonian, c.start, c.step, c.steps, BridgeRule::reversible);
    CHECK(reversible.bridges >= c.bridges - 1);
    CHECK(reversible.same_count);
    CHECK(reversible.miss <= accuracy * reversible.condition);
    const Return anchored = there_and_back(c.hamiltonian, c.start, c.step, c.steps, BridgeRule::anchored);
    CHECK(anchored.miss > accuracy * anchored.condition);
    CHECK(anchored.miss > 0.01);
  }
}

TEST_CASE("a run that begins backward in time returns forward") {
  const Run back = follow(pendulum, {0.0, 2.2}, 0.0, -0.05, 500, false, BridgeRule::reversible);
  CHECK(back.bridges >= 15);
  const Run forward =
      follow(pendulum, back.levels.back(), back.t, -back.h, back.levels.size() - 1, true, BridgeRule::reversible);
  CHECK(distance(forward.levels.back(), {0.0, 2.2}) < 1e-6);
}

TEST_CASE("the amplitude of the node energy wanders with reversible bridges and not with anchored ones") {
  // Each crossing makes an error of a thousandth in c: a random walk of 500 of them strays by 2 %, and may by thrice
  // that.
  const Run reversible = follow(pendulum, {0.0, 2.2}, 0.0, 0.05, 13000, true, BridgeRule::reversible);
  CHECK(reversible.bridges >= 450);
  CHECK(reversible.amplitude > 1.001);
  CHECK(reversible.amplitude < 1.07);
  CHECK(follow(pendulum, {0.0, 2.2}, 0.0, 0.05, 13000, true, BridgeRule::anchored).amplitude == 1.0);
}
