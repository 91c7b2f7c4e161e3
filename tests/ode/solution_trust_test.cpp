// What a solution of a boundary-value problem is worth: its error by half the step, against closed forms, and the
// directions that its conditions leave open.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <rubato/ode/open_directions.hpp>
#include <rubato/ode/step_error.hpp>

using namespace rubato;

namespace {

struct Posed {
  Hamiltonian H;
  EndConditions ends;
  BoundaryValueOptions options;
  BoundaryValueSolution solution;

  Posed(const Hamiltonian& hamiltonian, const EndConditions& conditions, const std::vector<double>& start,
        double duration, std::size_t steps, const BoundaryValueOptions& with)
      : H(hamiltonian),
        ends(conditions),
        options(with),
        solution(solve_boundary_value(
            H, ends, guess_by_integrating(H, with.lagrangian, start, duration / static_cast<double>(steps), steps),
            options)) {
    REQUIRE(solution.found());
  }
  [[nodiscard]] StepError error() const { return step_error(H, ends, solution.orbit, options); }
  [[nodiscard]] OpenDirections open(OpenAlong which = OpenAlong::any) const {
    const StepError halved = error();
    REQUIRE(halved.halved.found());
    return open_directions(H, ends, solution.orbit, halved.halved.orbit, options, which);
  }
};

const Hamiltonian& pendulum() {
  static const Hamiltonian H({"q"}, {"p"}, "p^2/2 - cos(q)");
  return H;
}
const Hamiltonian& oscillator() {
  static const Hamiltonian H({"q"}, {"p"}, "(p^2 + q^2)/2");
  return H;
}

EndConditions conditions(const Hamiltonian& H, const std::vector<std::string>& texts) {
  return {H, texts};
}

}  // namespace

TEST_CASE("step error: half the step finds the error of a period, of any scheme and levels") {
  // 4 K(sin²(q/2)) of the orbit with cos q = 1/2.
  const double period = 4.0 * std::comp_ellint_1(0.5);
  const auto swing = [&](const SegmentLagrangian& lagrangian, Levels levels, std::size_t steps) {
    return Posed(pendulum(), EndConditions::periodic(pendulum()), {1.0, 0.0}, 6.7, steps,
                 {.lagrangian = lagrangian, .levels = levels, .energy = -0.5});
  };
  const SegmentLagrangian schemes[] = {Midpoint{}, Gauss{2}};
  for (const SegmentLagrangian& lagrangian : schemes) {
    for (const Levels levels : {Levels::fixed, Levels::variable}) {
      const Posed posed = swing(lagrangian, levels, 24);
      const StepError error = posed.error();
      REQUIRE(error.halved.found());
      // The next term of the error has 1/4 of (h ω)² beside the first, h ω = 0.28.
      CHECK(error.duration == Approx(std::abs(posed.solution.orbit.duration() - period)).epsilon(0.05));
      CHECK(error.energy == 0.0);
      CHECK(error.relative < 0.01);
      // Twin: an orbit of one of its nodes moved has the error of that.
      NodesOfOrbit moved = posed.solution.orbit;
      moved.z[11] += 0.3;
      CHECK(step_error(posed.H, posed.ends, moved, posed.options).relative > 0.1);
    }
  }
  // A solution of the discrete equations alone, twelve steps of the midpoint rule near the unstable equilibrium.
  const Posed alone = Posed(pendulum(), EndConditions::periodic(pendulum()), {3.0, 0.0}, 20.0, 12,
                            {.lagrangian = Midpoint{}, .levels = Levels::fixed, .duration = 20.0});
  CHECK(alone.error().relative > 0.5);
}

TEST_CASE("open directions: of dependent conditions, of an open period or energy, and of none") {
  const BoundaryValueOptions in_time{.lagrangian = Gauss{2}, .levels = Levels::fixed, .duration = 3.0};
  const auto pendulum_with = [&](const std::vector<std::string>& ends, const BoundaryValueOptions& options) {
    return Posed(pendulum(), conditions(pendulum(), ends), {0.0, 1.0}, 3.0, 20, options);
  };
  const OpenDirections twice = pendulum_with({"q_0 = 0", "3*q_0 = 0"}, in_time).open();
  CHECK(twice.count == 1);
  CHECK(twice.energy);
  CHECK_FALSE(twice.duration);
  REQUIRE(twice.dependent.size() == 2);
  CHECK(twice.dependent[1] == "the end condition 3*q_0 = 0");
  CHECK(pendulum_with({"q_0 = 0", "3*q_1 = 0.3"}, in_time).open().count == 0);  // twin
  // An energy that the start has already leaves the time open.
  const BoundaryValueOptions at_energy{.lagrangian = Gauss{4}, .levels = Levels::fixed, .energy = -0.5};
  const OpenDirections fixed = pendulum_with({"q_0 = 0", "p_0 = 1"}, at_energy).open();
  CHECK(fixed.count == 1);
  CHECK(fixed.duration);
  CHECK(std::ranges::find(fixed.dependent, "the energy") != fixed.dependent.end());
  CHECK(pendulum_with({"q_0 = 0", "q_1 = 0.2"}, at_energy).open().count == 0);  // twin
}

TEST_CASE("open directions: what truncation errors alone determine is open, too") {
  // From 0 to 1 in half a period of the oscillator there is no orbit, and the midpoint rule finds one that grows like
  // 1/h²; a twelfth before it there is one.
  const auto between = [&](double time) {
    return Posed(oscillator(), conditions(oscillator(), {"q_0 = 0", "q_1 = 1"}), {0.0, 1.0}, time, 24,
                 {.lagrangian = Midpoint{}, .levels = Levels::fixed, .duration = time});
  };
  const Posed none = between(std::numbers::pi), some = between(std::numbers::pi * 11.0 / 12.0);
  CHECK(none.open().count == 1);
  CHECK(none.error().relative > 0.5);
  CHECK(some.open().count == 0);  // twin
  CHECK(some.error().relative < 0.1);
}

TEST_CASE("open directions: a phase is none of a closed orbit, and its energy is where all have one period") {
  const auto closed = [](const Hamiltonian& H, const BoundaryValueOptions& options, double guess) {
    return Posed(H, EndConditions::periodic(H), {1.0, 0.0}, guess, 40, options).open(OpenAlong::duration_or_energy);
  };
  const BoundaryValueOptions energy{.lagrangian = Gauss{4}, .levels = Levels::fixed, .energy = 0.5};
  const BoundaryValueOptions period{
      .lagrangian = Gauss{4}, .levels = Levels::fixed, .duration = 2.0 * std::numbers::pi};
  CHECK(closed(oscillator(), energy, 6.2).count == 0);
  const OpenDirections open = closed(oscillator(), period, *period.duration);
  CHECK(open.count == 1);
  CHECK(open.energy);
  CHECK_FALSE(open.duration);
  // Twin: periods of the pendulum depend on the energy.
  for (const SegmentLagrangian& lagrangian : {SegmentLagrangian(Midpoint{}), SegmentLagrangian(Gauss{4})}) {
    const BoundaryValueOptions of_energy{.lagrangian = lagrangian, .levels = Levels::fixed, .energy = -0.5};
    const BoundaryValueOptions of_period{.lagrangian = lagrangian, .levels = Levels::fixed, .duration = 6.8};
    CHECK(closed(pendulum(), of_energy, 6.7).count == 0);
    CHECK(closed(pendulum(), of_period, 6.8).count == 0);
  }
}
