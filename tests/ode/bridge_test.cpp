#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>

// Crossing the singular set Γ = 0 (theory, section 3.1).

using namespace rubato;

namespace {

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
const Hamiltonian double_well({"q"}, {"p"}, "p^2/2 + (q^4 - q^2)/2");
const Hamiltonian kepler({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");
const Hamiltonian henon_heiles({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3");

/// What a run with bridges is judged by.
struct Judged {
  Status status = Status::success;
  std::size_t steps = 0;
  std::size_t crossings = 0;
  std::size_t bridge_steps = 0;
  double energy_deviation = 0.0;         ///< max |E_k - E| off bridges
  double node_deviation = 0.0;           ///< max |H(z_k) - E|
  std::array<double, 8> eighth_means{};  ///< of H(z_k) - E over eighths of the run, by time

  [[nodiscard]] double steps_per_crossing() const {
    return static_cast<double>(bridge_steps) / static_cast<double>(std::max<std::size_t>(crossings, 1));
  }
  /// (max - min)/|mean| of the eighth-means: a drift of the amplitude of H - E shows here.
  [[nodiscard]] double drift() const {
    const auto [low, high] = std::ranges::minmax(eighth_means);
    double mean = 0.0;
    for (const double value : eighth_means) {
      mean += value / 8.0;
    }
    return (high - low) / std::abs(mean);
  }
};

Judged judge(const Hamiltonian& hamiltonian, const InitialState& initial, double step, double until,
             OnSingular on_singular = OnSingular::bridge, Levels levels = Levels::variable) {
  OrbitIntegrator integrator(hamiltonian, initial,
                             {.step = step, .until = until, .levels = levels, .on_singular = on_singular});
  Judged judged;
  std::array<double, 8> durations{};
  while (!integrator.finished()) {
    const StepReport report = integrator.step();
    if (report.status != Status::success) {
      judged.status = report.status;
      return judged;
    }
    ++judged.steps;
    judged.crossings += report.crossing ? 1 : 0;
    judged.bridge_steps += report.bridged ? 1 : 0;
    if (!report.bridged) {
      judged.energy_deviation = std::max(judged.energy_deviation, std::abs(report.energy - report.target));
    }
    const double excess = integrator.node().energy - integrator.levels().energy();
    judged.node_deviation = std::max(judged.node_deviation, std::abs(excess));
    const auto eighth = std::min<std::size_t>(7, static_cast<std::size_t>(8.0 * integrator.t() / until));
    judged.eighth_means[eighth] += excess * report.h;
    durations[eighth] += report.h;
  }
  for (std::size_t i = 0; i < 8; ++i) {
    judged.eighth_means[i] /= durations[i];
  }
  return judged;
}

InitialState kepler_pericentre(double e) {
  return {.q = {1.0 - e, 0.0}, .p = {0.0, std::sqrt((1.0 + e) / (1.0 - e))}};
}
double kepler_step(double e, double factor) {
  return factor * std::pow(1.0 - e, 1.5);
}
const double orbit = 2.0 * std::acos(-1.0);

/// The pendulum turns over, so that |q| grows like the time and H is evaluated at a q rounded to ε|q|: E deviates by
/// ε|q||sin q|.
double rotation_rounding(double until) {
  return 4.0 * 2.2e-16 * 2.0 * until;
}

}  // namespace

TEST_CASE("a rotating pendulum crosses the zeros of Gamma with one bridging step each and without drift") {
  // 47 crossings in 100 time units. The node energy strays by O(h²): halving the step divides it by 4 (by 3 at least,
  // at steps where the fourth order is seen).
  double coarser = 0.0;
  for (const double step : {0.1, 0.05, 0.025}) {
    const Judged run = judge(pendulum, {.q = {0.0}, .p = {2.2}}, step, 400.0);
    INFO("step " << step);
    REQUIRE(run.status == Status::success);
    CHECK(run.crossings >= 180);
    CHECK(run.steps_per_crossing() <= 1.1);
    CHECK(run.energy_deviation <= 1e-13 + rotation_rounding(400.0));
    if (coarser != 0.0) {
      CHECK(run.node_deviation < coarser / 3.0);
    }
    coarser = run.node_deviation;
  }
  // The twins: without bridges the run stops at the first zero; with fixed levels the discrete energy is not constant.
  CHECK(judge(pendulum, {.q = {0.0}, .p = {2.2}}, 0.05, 400.0, OnSingular::stop).status == Status::singular);
  CHECK(judge(pendulum, {.q = {0.0}, .p = {2.2}}, 0.05, 400.0, OnSingular::bridge, Levels::fixed).energy_deviation >
        1e-6);
}

TEST_CASE("the rotating pendulum to t = 3000: eighth-means of H - E agree", "[long]") {
  for (const double step : {0.1, 0.05, 0.025}) {
    const Judged run = judge(pendulum, {.q = {0.0}, .p = {2.2}}, step, 3000.0);
    INFO("step " << step << " drift " << run.drift() << " steps per crossing " << run.steps_per_crossing());
    REQUIRE(run.status == Status::success);
    CHECK(run.crossings >= 1410);
    CHECK(run.steps_per_crossing() <= 1.1);
    // The phase of the levels at a crossing is as good as random: each segment between crossings has an amplitude c
    // that is off by a few per cent, and an eighth holds 177 of them. At the coarsest step that noise is the largest.
    CHECK(run.drift() <= (step == 0.1 ? 0.08 : 0.05));
  }
}

TEST_CASE("the rotating pendulum to t = 10^6 does not drift", "[long]") {
  const Judged run = judge(pendulum, {.q = {0.0}, .p = {2.2}}, 0.05, 1e6);
  REQUIRE(run.status == Status::success);
  CHECK(run.drift() <= 0.01);
}

TEST_CASE("every eccentricity is crossed, fine and coarse, tangency included") {
  for (const double factor : {0.02, 0.05}) {
    for (double e = 0.70; e < 0.995; e += 0.01) {
      const Judged run = judge(kepler, kepler_pericentre(e), kepler_step(e, factor), 5.0 * orbit);
      INFO("e " << e << " factor " << factor);
      REQUIRE(run.status == Status::success);
      // |E| = 1/2, but p²/2 and 1/r are 1/(1-e) at the pericentre: rounding in H is ε times that.
      CHECK(run.energy_deviation <= 1e-14 + 8.0 * 2.2e-16 / (1.0 - e));
      if (e > 0.80 && factor == 0.02) {
        CHECK(run.steps_per_crossing() <= 1.3);
      }
    }
  }
}

TEST_CASE("Kepler orbits of high eccentricity keep their node energy over 100 revolutions", "[long]") {
  for (const double e : {0.8, 0.9, 0.95, 0.99}) {
    const Judged run = judge(kepler, kepler_pericentre(e),
                             kepler_step(e, e < 0.94   ? 0.02
                                            : e < 0.98 ? 0.03
                                                       : 0.05),
                             100.0 * orbit);
    INFO("e " << e << ", levels per orbit " << static_cast<double>(run.steps) / 100.0 << ", eighths differ by "
              << (*std::ranges::max_element(run.eighth_means) - *std::ranges::min_element(run.eighth_means)));
    REQUIRE(run.status == Status::success);
    CHECK(run.steps <= 100 * 400);
    // No drift: the eighth-means differ by less than a hundredth of the largest excursion of H.
    const auto [low, high] = std::ranges::minmax(run.eighth_means);
    CHECK(high - low <= 0.01 * run.node_deviation);
  }
}

TEST_CASE("a ball over the ridge of a double well crosses four times a period") {
  const Judged run = judge(double_well, {.q = {1.02}, .p = {0.0}}, 0.05, 300.0);
  REQUIRE(run.status == Status::success);
  CHECK(run.crossings >= 100);
  CHECK(run.steps_per_crossing() <= 1.1);
  CHECK(run.energy_deviation <= 1e-15);
}

TEST_CASE("Hénon-Heiles from random starts completes with its discrete energy exact") {
  std::mt19937 random(7);  // any seed
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const double energy : {1.0 / 12.0, 1.0 / 6.0}) {
    for (int found = 0; found < 25;) {
      const double x = 0.5 * uniform(random);
      const double y = 0.5 * uniform(random);
      const double potential = (x * x + y * y) / 2.0 + x * x * y - y * y * y / 3.0;
      if (potential >= energy) {
        continue;
      }
      ++found;
      const double angle = std::acos(-1.0) * uniform(random);
      const double p = std::sqrt(2.0 * (energy - potential));
      const Judged run =
          judge(henon_heiles, {.q = {x, y}, .p = {p * std::cos(angle), p * std::sin(angle)}}, 0.1, 100.0);
      INFO("x " << x << " y " << y << " angle " << angle);
      REQUIRE(run.status == Status::success);
      CHECK(run.energy_deviation <= 1e-13 * energy);
    }
  }
}

TEST_CASE("a start on or near a zero of Gamma waits, with flagged plain steps, until the law can be set") {
  // Γ = cos²q + 2E cos q + 1 vanishes at cos q = -E + √(E²-1).
  const double energy = 1.42;
  const double zero = std::acos(-energy + std::sqrt(energy * energy - 1.0));
  for (const double offset : {0.0, 0.01, -0.01, 0.1, -0.1}) {
    for (const OnSingular way : {OnSingular::bridge, OnSingular::fixed}) {
      const double q = zero + offset;
      const Judged run = judge(pendulum, {.q = {q}, .p = {std::sqrt(2.0 * (energy + std::cos(q)))}}, 0.05, 100.0, way);
      INFO("offset " << offset);
      REQUIRE(run.status == Status::success);
      CHECK(run.energy_deviation <= 1e-13 + rotation_rounding(100.0));
      CHECK(run.node_deviation <= 2e-3);
    }
  }
}

TEST_CASE("a free particle has no energy law: every step is a plain one, and flagged") {
  const Orbit free =
      integrate(Hamiltonian({"q"}, {"p"}, "p^2/2"), {.q = {0.0}, .p = {1.0}}, {.step = 0.1, .until = 1.0});
  REQUIRE(free.status == Status::success);
  CHECK(std::ranges::all_of(free.bridged, [](unsigned char flag) { return flag == 1; }));
  // The twin: an oscillator has one.
  const Orbit bound =
      integrate(Hamiltonian({"q"}, {"p"}, "p^2/2 + q^2/2"), {.q = {0.0}, .p = {1.0}}, {.step = 0.1, .until = 1.0});
  CHECK(std::ranges::none_of(bound.bridged, [](unsigned char flag) { return flag == 1; }));
}

TEST_CASE("bridges work backward in time") {
  const Judged run = judge(kepler, kepler_pericentre(0.9), -kepler_step(0.9, 0.02), -3.0 * orbit);
  REQUIRE(run.status == Status::success);
  CHECK(run.crossings >= 10);
  CHECK(run.steps_per_crossing() <= 1.1);
}
