// Orbits from many initial states, side by side or not: each is the orbit that it is alone, bit for bit.

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/base/interrupt.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/splitting_lanes.hpp>

#include "systems.hpp"

using namespace rubato;
using Catch::Contains;

namespace {

Hamiltonian henon_heiles_with(const std::string& constant) {
  return {{"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3" + constant};
}

/// Around a state, no two alike.
std::vector<InitialState> around(const InitialState& state, std::size_t count, double size) {
  std::vector<InitialState> states(count, state);
  for (std::size_t m = 0; m < count; ++m) {
    const auto shift = [&](double by) { return size * std::sin(by * static_cast<double>(m + 1)); };
    for (std::size_t i = 0; i < state.q.size(); ++i) {
      states[m].q[i] += shift(1.3 + static_cast<double>(i));
      states[m].p[i] += shift(2.7 + static_cast<double>(i));
    }
  }
  return states;
}

bool same(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) || (std::isnan(a) && std::isnan(b));
}

/// How many numbers are not those of the orbit alone.
std::size_t differences(const OrbitEnd& end, const Orbit& alone) {
  std::size_t count = end.steps == alone.steps() && end.status == alone.status && end.message == alone.message ? 0 : 1;
  const auto compare = [&](double a, double b) { count += same(a, b) ? 0 : 1; };
  const std::size_t last = alone.t.size() - 1;
  compare(end.t, alone.t[last]);
  for (std::size_t i = 0; i < end.q.size(); ++i) {
    compare(end.q[i], alone.q_at(last)[i]);
    compare(end.p[i], alone.p_at(last)[i]);
  }
  compare(end.discrete_energy, alone.steps() > 0 ? alone.energy.front() : 0.0);
  compare(end.discrete_energy_deviation, alone.discrete_energy_deviation());
  compare(end.node_energy_deviation, alone.node_energy_deviation());
  return count;
}

std::size_t differences(const Hamiltonian& hamiltonian, const std::vector<InitialState>& states,
                        const IntegrationOptions& options) {
  const std::vector<OrbitEnd> ends = integrate(hamiltonian, states, options);
  std::size_t count = ends.size() == states.size() ? 0 : 1;
  for (std::size_t m = 0; m < ends.size(); ++m) {
    count += differences(ends[m], integrate(hamiltonian, states[m], options));
  }
  return count;
}

}  // namespace

TEST_CASE("each of many orbits is the orbit that it is alone") {
  struct Case {
    std::string name;
    Hamiltonian hamiltonian;
    InitialState initial;
    double step;
  };
  const std::vector<Case> cases = {
      {"Henon-Heiles", henon_heiles_with(""), systems::henon_heiles().initial, 0.1},
      {"and a constant", henon_heiles_with(" + 7.3"), systems::henon_heiles().initial, -0.1},
      {"pendulum", systems::pendulum().hamiltonian, systems::pendulum().initial, 0.1},
      {"Kepler", systems::kepler(0.3).hamiltonian, systems::kepler(0.3).initial, 0.05},
      {"powers and functions",
       {{"q"}, {"p"}, "cosh(p) + sin(q)*exp(-q^2) + log(2 + q^2)^1.7"},
       {.q = {0.2}, .p = {0.5}},
       0.1}};
  for (const Case& one : cases) {
    for (const std::string composition : {"golden", "verlet", "kahan-li-8"}) {
      for (const Levels levels : {Levels::fixed, Levels::variable}) {
        INFO(one.name << ", " << composition << (levels == Levels::fixed ? ", fixed" : ", variable"));
        const IntegrationOptions options{.lagrangian = Splitting{composition},
                                         .step = one.step,
                                         .until = one.step > 0.0 ? 5.0 : -5.0,
                                         .levels = levels};
        CHECK(differences(one.hamiltonian, around(one.initial, levels == Levels::fixed ? 19 : 3, 0.05), options) == 0);
      }
    }
  }
  CHECK(differences(systems::pendulum().hamiltonian, around(systems::pendulum().initial, 5, 0.1),
                    {.lagrangian = Gauss{}, .step = 0.1, .until = 5.0}) == 0);
}

TEST_CASE("a Hamiltonian is used by several threads at once") {
  const auto all_of = [](const Hamiltonian& H, const InitialState& initial) {
    std::vector<double> numbers;
    for (const SegmentLagrangian& scheme :
         std::vector<SegmentLagrangian>{Splitting{}, Gauss{}, Midpoint{}, Generating{.order = 4}}) {
      const Orbit orbit = integrate(H, initial, {.lagrangian = scheme, .step = 0.1, .until = 1.0});
      numbers.insert(numbers.end(), orbit.q.begin(), orbit.q.end());
    }
    const Hamiltonian own = H.with_own_graph();
    const formula::Bytecode gamma(std::array{own.gamma()}, own.variables());
    std::vector<double> z = initial.q;
    z.insert(z.end(), initial.p.begin(), initial.p.end());
    numbers.push_back(formula::ScalarEvaluator(gamma).at(z.data())[0]);
    numbers.push_back(formula::ScalarEvaluator(H.gamma_code()).at(z.data())[1]);
    return numbers;
  };
  const InitialState initial = systems::henon_heiles().initial;
  const std::vector<double> alone = all_of(henon_heiles_with(" + 7.3"), initial);
  CHECK(alone.back() == Approx(alone[alone.size() - 2]).epsilon(1e-14));
  const Hamiltonian shared = henon_heiles_with(" + 7.3");  // of which nobody has asked for derivatives yet
  std::vector<std::vector<double>> found(8);
  std::vector<std::thread> threads;
  for (std::vector<double>& numbers : found) {
    threads.emplace_back([&] { numbers = all_of(shared, initial); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (const std::vector<double>& numbers : found) {
    CHECK(numbers == alone);
  }
  CHECK(all_of(henon_heiles_with(" + 7.3 + 1e-9*x"), initial) != alone);  // a twin
}

TEST_CASE("a difference in the last places is seen") {
  const systems::System system = systems::henon_heiles();
  const IntegrationOptions options{.lagrangian = Splitting{}, .step = 0.1, .until = 5.0, .levels = Levels::fixed};
  std::vector<InitialState> states = around(system.initial, 9, 0.05);
  const std::vector<OrbitEnd> ends = integrate(system.hamiltonian, states, options);
  states[4].q[1] *= 1.0 + 16.0 * std::numeric_limits<double>::epsilon();
  CHECK(differences(ends[3], integrate(system.hamiltonian, states[3], options)) == 0);
  CHECK(differences(ends[4], integrate(system.hamiltonian, states[4], options)) > 0);
}

TEST_CASE("orbits side by side have starts and ends of their own, and some break down") {
  const Hamiltonian hamiltonian = henon_heiles_with("");
  std::vector<InitialState> states = around(systems::henon_heiles().initial, 300, 0.05);
  for (std::size_t m = 0; m < states.size(); ++m) {
    states[m].t = 0.37 * static_cast<double>(m % 20);
  }
  states[5].q[1] = 7.0;  // runs away, beyond all numbers
  states[7].t = 11.95;   // at its end after one
  const IntegrationOptions options{.lagrangian = Splitting{"blanes-moan-4"},
                                   .step = 0.1,
                                   .until = 12.0,
                                   .levels = Levels::fixed,
                                   .max_steps = 119};  // those that begin at 0 need one more
  const std::vector<OrbitEnd> ends = integrate(hamiltonian, states, options);
  CHECK(ends[5].status == Status::undefined);
  CHECK(ends[7].steps == 1);
  CHECK_THAT(ends[0].message, Contains("max_steps"));
  CHECK(ends[1].status == Status::success);
  std::size_t count = 0;
  for (std::size_t m = 0; m < states.size(); ++m) {
    count += differences(ends[m], integrate(hamiltonian, states[m], options));
  }
  CHECK(count == 0);
}

TEST_CASE("orbits that are interrupted end where they are") {
  // Side by side, and one after the other: far too many steps to come to the end of.
  const bool side_by_side = GENERATE(true, false);
  const Hamiltonian H = henon_heiles_with("");
  const std::vector<InitialState> states = around({.q = {0.1, 0.0}, .p = {0.0, 0.2}}, 300, 1e-3);
  IntegrationOptions options{
      .lagrangian = side_by_side ? SegmentLagrangian(Splitting{}) : SegmentLagrangian(Midpoint{}),
      .step = 0.1,
      .until = 1e12,
      .levels = Levels::fixed,
      .max_steps = 100'000'000'000'000};
  std::vector<OrbitEnd> ends;
  auto begun = ends.end();
  for (std::chrono::milliseconds wait(50); begun == ends.end(); wait *= 2) {  // until some have begun by then
    std::atomic<bool> asked = false;
    const Interruptible here(&asked);
    std::thread press([&] {
      std::this_thread::sleep_for(wait);
      asked = true;
    });
    ends = integrate(H, states, options);
    press.join();
    begun = std::ranges::find_if(ends, [](const OrbitEnd& end) { return end.steps > 0; });
  }
  CHECK(std::ranges::all_of(ends, [](const OrbitEnd& end) { return end.interrupted; }));
  // What was computed is what the orbit alone has there.
  const auto number = static_cast<std::size_t>(begun - ends.begin());
  options.until = begun->t;
  options.max_steps = begun->steps;
  const OrbitEnd alone = integrate(H, std::span(states).subspan(number, 1), options).front();
  CHECK_FALSE(alone.interrupted);  // the twin: nobody asked
  CHECK(alone.steps == begun->steps);
  CHECK(alone.t == begun->t);
  CHECK(alone.q == begun->q);
  CHECK(alone.p == begun->p);
}

TEST_CASE("many orbits have their events, and what is wrong with one is told") {
  const systems::System system = systems::pendulum();
  IntegrationOptions options{.lagrangian = Splitting{}, .step = 0.1, .until = 40.0, .levels = Levels::fixed};
  options.events = {{.name = "down", .crossing = "q", .direction = Direction::down, .stop_after = 2}};
  std::vector<InitialState> states = around(system.initial, 4, 0.1);
  const std::vector<OrbitEnd> ends = integrate(system.hamiltonian, states, options);
  for (std::size_t m = 0; m < states.size(); ++m) {
    const Orbit alone = integrate(system.hamiltonian, states[m], options);
    CHECK(differences(ends[m], alone) == 0);
    CHECK(ends[m].events.front().t == alone.events.front().t);
    CHECK(ends[m].events.front().stopped);
  }
  options.events.clear();
  states[2].p = {1.0, 2.0};
  CHECK_THROWS_WITH(integrate(system.hamiltonian, states, options), Contains("2 momenta"));
  CHECK(integrate(system.hamiltonian, std::vector<InitialState>{}, options).empty());
}

TEST_CASE("orbits go side by side where a step is one short formula") {
  const auto side_by_side = [](const Hamiltonian& H) {
    return SplittingLanes::make(H, composition("verlet"), {}, 8) != nullptr;
  };
  CHECK(side_by_side({{"q"}, {"p"}, "p^2/2 - cos(q)"}));
  CHECK(side_by_side({{"q"}, {"p"}, "p^2/2"}));
  CHECK_THROWS_WITH(side_by_side({{"q"}, {"p"}, "p^2*q"}), Contains("depends on both"));
  const auto springs = [](std::size_t n) {
    return Hamiltonian(n, [n](auto q, auto p) {
      auto H = p[0] * p[0] / 2 + pow(q[0], 4);
      for (std::size_t i = 1; i < n; ++i) {
        H = H + p[i] * p[i] / 2 + pow(q[i] - q[i - 1], 4);
      }
      return H;
    });
  };
  CHECK(side_by_side(springs(8)));
  CHECK_FALSE(side_by_side(springs(400)));
}
