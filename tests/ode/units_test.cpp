// A system of units that differs by powers of two changes exponents and nothing else: every threshold is relative.

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/first_step.hpp>
#include <rubato/ode/orbit_methods.hpp>
#include <rubato/variation/composition.hpp>

using namespace rubato;

namespace {

/// Units of mass, length and time, as powers of two.
struct Units {
  int mass = 0, length = 0, time = 0;
};

/// A quantity and its dimensions.
struct Quantity {
  const char* name;
  double value;
  Units dimensions;

  [[nodiscard]] double in(const Units& units) const {
    return std::ldexp(value,
                      units.mass * dimensions.mass + units.length * dimensions.length + units.time * dimensions.time);
  }
};

constexpr Units none{}, mass{1, 0, 0}, length{0, 1, 0}, momentum{1, 1, -1}, stiffness{1, 0, -2}, action{1, 2, -1},
    inertia{1, 2, 0}, energy{1, 2, -2};

struct Problem {
  const char* name;
  std::vector<Quantity> q, p, parameters;
  const char* H;
  double step, until;
  bool is_sum;  ///< T(p) + V(q)
};

/// No two parameters are equal, none is 1: formulas are simplified there.
std::vector<Problem> problems() {
  return {{"pendulum",
           {{"q", 0.0, none}},
           {{"p", 1.9, action}},
           {{"I", 1.1, inertia}, {"w", 0.9, energy}},
           "p^2/(2*I) - w*cos(q)",
           0.1,
           12.0,
           true},
          {"Kepler",
           {{"x", 0.4, length}, {"y", 0.0, length}},
           {{"u", 0.0, momentum}, {"v", 2.0, momentum}},
           {{"m", 1.3, mass}, {"k", 0.9, {1, 3, -2}}},
           "(u^2 + v^2)/(2*m) - k/sqrt(x^2 + y^2)",
           0.02,
           3.0,
           true},
          {"Henon-Heiles",
           {{"x", 0.0, length}, {"y", 0.1, length}},
           {{"u", 0.39, momentum}, {"v", 0.1, momentum}},
           {{"m", 1.3, mass}, {"k", 0.9, stiffness}, {"c", 0.7, {1, -1, -2}}},
           "(u^2 + v^2)/(2*m) + k*(x^2 + y^2)/2 + c*(x^2*y - y^3/3)",
           0.1,
           12.0,
           true},
          {"double well",
           {{"q", 0.9, length}},
           {{"p", 0.3, momentum}},
           {{"m", 1.3, mass}, {"k", 0.9, stiffness}, {"c", 0.7, {1, -2, -2}}},
           "p^2/(2*m) + (c*q^4 - k*q^2)/2",
           0.1,
           12.0,
           true},
          {"chain",
           {{"a", 0.5, length}, {"b", 0.0, length}, {"c", -0.2, length}},
           {{"u", 0.0, momentum}, {"v", 0.3, momentum}, {"w", 0.1, momentum}},
           {{"m", 1.3, mass}, {"k", 0.9, stiffness}, {"f", 0.6, {1, -2, -2}}},
           "(u^2 + v^2 + w^2)/(2*m) + k*(a^2 + (b-a)^2 + (c-b)^2 + c^2)/2 + f*((b-a)^4 + (c-b)^4)/4",
           0.1,
           12.0,
           true},
          {"no sum",
           {{"q", 1.0, length}},
           {{"p", 0.0, momentum}},
           {{"l", 1.1, length}, {"P", 0.9, momentum}, {"m", 1.3, mass}},
           "(q^2/l^2 + 1)*(p^2 + P^2)/(2*m)",
           0.1,
           6.0,
           false}};
}

struct Level {
  double t;
  std::vector<double> z;
};

enum class Kind { fixed, variable, automatic };

/// The levels of a run in these units, reported in the first ones.
std::vector<Level> run(const Problem& problem, const SegmentLagrangian& scheme, Kind kind, const Units& units) {
  std::vector<std::string> q, p;
  std::vector<double> q_0, p_0;
  std::vector<int> exponents;
  const auto take = [&](const std::vector<Quantity>& from, std::vector<std::string>& names, std::vector<double>& at) {
    for (const Quantity& one : from) {
      names.emplace_back(one.name);
      at.push_back(one.in(units));
      exponents.push_back(std::ilogb(Quantity{"", 1.0, one.dimensions}.in(units)));
    }
  };
  take(problem.q, q, q_0);
  take(problem.p, p, p_0);
  Hamiltonian::Parameters parameters;
  for (const Quantity& one : problem.parameters) {
    parameters[one.name] = one.in(units);
  }
  const Hamiltonian hamiltonian(q, p, problem.H, parameters);
  IntegrationOptions options{.lagrangian = scheme,
                             .step = std::ldexp(problem.step, units.time),
                             .until = std::ldexp(problem.until, units.time),
                             .levels = kind == Kind::fixed ? Levels::fixed : Levels::variable};
  const InitialState initial{.q = q_0, .p = p_0};
  if (kind == Kind::automatic) {
    options.step = choose_first_step(hamiltonian, initial, options, 1e-3);
  }
  OrbitIntegrator integrator(hamiltonian, initial, options);
  std::vector<Level> levels;
  for (int k = 0; k < 400 && !integrator.finished(); ++k) {
    if (integrator.step().status != Status::success) {
      break;
    }
    Level level{std::ldexp(integrator.t(), -units.time), {}};
    for (const std::span<const double> part : {integrator.q(), integrator.p()}) {
      for (const double x : part) {
        level.z.push_back(std::ldexp(x, -exponents[level.z.size()]));
      }
    }
    levels.push_back(std::move(level));
  }
  return levels;
}

std::vector<std::pair<std::string, SegmentLagrangian>> schemes(bool all) {
  std::vector<std::pair<std::string, SegmentLagrangian>> list = {{"midpoint", Midpoint{}},
                                                                 {"generating 2", Generating{.order = 2}},
                                                                 {"generating 4", Generating{.order = 4}},
                                                                 {"gauss 2", Gauss{2}},
                                                                 {"golden", Splitting{"golden"}}};
  if (all) {
    list.emplace_back("generating 6", Generating{.order = 6});
    list.emplace_back("euler a", Generating{.order = 1, .darboux = DarbouxType::euler_a});
    for (const int stages : {1, 3, 4}) {
      list.emplace_back("gauss " + std::to_string(stages), Gauss{stages});
    }
    for (const Composition& one : compositions()) {
      list.emplace_back(std::string(one.name), Splitting{std::string(one.name)});
    }
  }
  return list;
}

std::vector<Units> systems_of_units(int count) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> exponent(-40, 40);
  std::vector<Units> all;
  for (int i = 0; i < count; ++i) {
    const int of_mass = exponent(random), of_length = exponent(random), of_time = exponent(random);
    all.push_back({of_mass, of_length, of_time});
  }
  return all;
}

/// Where the levels of two runs first differ by more than `tolerance` of the time, or of the largest value.
double difference(const std::vector<Level>& a, const std::vector<Level>& b) {
  if (a.size() != b.size()) {
    return std::numeric_limits<double>::infinity();
  }
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    largest = std::max(largest, std::abs(a[k].t - b[k].t) / std::abs(a[k].t));
    for (std::size_t i = 0; i < a[k].z.size(); ++i) {
      largest = std::max(largest, std::abs(a[k].z[i] - b[k].z[i]));
    }
  }
  return largest;
}

void check(bool all, int units) {
  for (const Problem& problem : problems()) {
    for (const auto& [name, scheme] : schemes(all)) {
      if (std::holds_alternative<Splitting>(scheme) && !problem.is_sum) {
        continue;
      }
      for (const Kind kind : {Kind::fixed, Kind::variable, Kind::automatic}) {
        INFO(problem.name << ", " << name << ", " << static_cast<int>(kind));
        const std::vector<Level> plain = run(problem, scheme, kind, {});
        CHECK(plain.size() > 3);
        for (const Units& one : systems_of_units(units)) {
          INFO("2^" << one.mass << " of mass, 2^" << one.length << " of length, 2^" << one.time << " of time");
          const double found = difference(plain, run(problem, scheme, kind, one));
          INFO("off by " << found);
          CHECK(found <= (kind == Kind::fixed ? 0.0 : 1e-12));
        }
      }
    }
  }
}

}  // namespace

TEST_CASE("units that differ by powers of two change nothing but exponents") {
  check(false, 2);
}

TEST_CASE("units that differ by powers of two change nothing but exponents, for every scheme", "[long]") {
  check(true, 5);
}

TEST_CASE("units: the twin, a step that is a thousandth longer, is seen") {
  const std::vector<Problem> all = problems();
  Problem longer = all.front();
  longer.step *= 1.001;
  CHECK(difference(run(all.front(), Midpoint{}, Kind::variable, {}), run(longer, Midpoint{}, Kind::variable, {})) >
        1e-12);
}
