// The pure law (step_potential = "none") along orbits on which Γ changes its sign (theory, section 3): plain steps
// where it has no solution, flagged, and the law on all others.

#include <algorithm>
#include <cmath>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>

using namespace rubato;

namespace {

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
const Hamiltonian kepler({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");

InitialState pericentre(double e) {
  return {.q = {1.0 - e, 0.0}, .p = {0.0, std::sqrt((1.0 + e) / (1.0 - e))}};
}

struct Judged {
  Status status = Status::success;
  std::size_t on_law = 0, off_law = 0;
  double law_miss = 0.0, plain_miss = 0.0;  ///< max |E_k - E| over either
  double node_deviation = 0.0;              ///< max |H(z_k) - H(z_0)|
};

Judged judge(const Hamiltonian& hamiltonian, const InitialState& initial, const IntegrationOptions& options) {
  OrbitIntegrator integrator(hamiltonian, initial, options);
  const double start = integrator.node().energy;
  Judged judged;
  while (!integrator.finished()) {
    const StepReport report = integrator.step();
    if (report.status != Status::success) {
      judged.status = report.status;
      return judged;
    }
    const double miss = std::isnan(report.target) ? 0.0 : std::abs(report.energy - report.target);
    (report.off_law ? judged.off_law : judged.on_law) += 1;
    double& largest = report.off_law ? judged.plain_miss : judged.law_miss;
    largest = std::max(largest, miss);
    judged.node_deviation = std::max(judged.node_deviation, std::abs(integrator.node().energy - start));
  }
  return judged;
}

IntegrationOptions pure_law(double step, double until, OnSingular on_singular = OnSingular::plain) {
  return {.step = step, .until = until, .on_singular = on_singular};
}

/// Where a pendulum turns over |q| grows like the time, and H is evaluated at a q rounded to ε|q|.
double rotation_rounding(double until) {
  return 4.0 * 2.2e-16 * 2.0 * until;
}

}  // namespace

TEST_CASE("the pure law goes on with plain steps where it has no solution, and is exact on all others") {
  const InitialState over{.q = {0.0}, .p = {2.2}};
  double coarser = 0.0;
  for (const double step : {0.1, 0.05, 0.025}) {
    INFO("step " << step);
    const Judged run = judge(pendulum, over, pure_law(step, 100.0));
    REQUIRE(run.status == Status::success);
    CHECK(run.on_law > 0);
    CHECK(run.off_law > 0);
    CHECK(run.law_miss <= 1e-13 + rotation_rounding(100.0));
    CHECK(run.plain_miss > 1e3 * run.law_miss);  // the twin: plain steps do not meet it
    // By h²; by a third at least, as the phase at which the law is lost and found again differs.
    CHECK((coarser == 0.0 || run.node_deviation < coarser / 3.0));
    coarser = run.node_deviation;
  }
  // The twins: the run ends where the law does; with a step potential no step is off it.
  CHECK(judge(pendulum, over, pure_law(0.05, 100.0, OnSingular::stop)).status == Status::singular);
  CHECK(judge(pendulum, over, {.step = 0.05, .until = 100.0}).off_law == 0);
}

TEST_CASE("the pure law goes on past the zeros of Gamma of eccentric orbits, backward in time too") {
  for (const double e : {0.80, 0.85, 0.9}) {
    for (const double direction : {1.0, -1.0}) {
      INFO("e = " << e << ", direction " << direction);
      const Judged run =
          judge(kepler, pericentre(e), pure_law(direction * 0.02 * std::pow(1.0 - e, 1.5), direction * 10.0));
      REQUIRE(run.status == Status::success);
      CHECK(run.off_law > 0);
      CHECK(run.on_law > 0);
      // |E| = 1/2, but p²/2 and 1/r are 1/(1-e) at the pericentre: rounding in H is ε times that.
      CHECK(run.law_miss <= 1e-14 + 8.0 * 2.2e-16 / (1.0 - e));
    }
  }
}

TEST_CASE("a start on or near a zero of Gamma waits, with plain steps, until the law can be set") {
  // Γ = cos²q + 2E cos q + 1 vanishes at cos q = -E + √(E²-1).
  const double energy = 1.42;
  const double zero = std::acos(-energy + std::sqrt(energy * energy - 1.0));
  for (const double offset : {0.0, 0.01, -0.01, 0.1, -0.1}) {
    INFO("offset " << offset);
    const double q = zero + offset;
    const InitialState start{.q = {q}, .p = {std::sqrt(2.0 * (energy + std::cos(q)))}};
    OrbitIntegrator integrator(pendulum, start, pure_law(0.05, 100.0));
    CHECK((integrator.step().off_law || std::abs(offset) > 0.05));
    const Judged run = judge(pendulum, start, pure_law(0.05, 100.0));
    REQUIRE(run.status == Status::success);
    CHECK(run.on_law > 0);
    CHECK(run.law_miss <= 1e-13 + rotation_rounding(100.0));
  }
  // The twin: far from it the first step sets the law.
  OrbitIntegrator far(pendulum, {.q = {0.0}, .p = {2.2}}, pure_law(0.05, 100.0));
  CHECK_FALSE(far.step().off_law);
}

TEST_CASE("a free particle has no energy law: every step is a plain one") {
  const auto run = [](const char* H) {
    return judge(Hamiltonian({"q"}, {"p"}, H), {.q = {0.0}, .p = {1.0}}, pure_law(0.1, 1.0));
  };
  CHECK(run("p^2/2").on_law == 0);
  CHECK(run("p^2/2").off_law == 10);
  CHECK(run("p^2/2 + q^2/2").off_law == 0);  // the twin: an oscillator has one
}
