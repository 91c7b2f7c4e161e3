// What every scheme for lattices has to do, for every one that the registry has: a new one is here by being registered.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/variation/composition.hpp>
#include <rubato/variation/lattice_variation.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

/// A wave equation, which all of them take, on a number of cells that all of them take.
const grids::Grid line({{"x", -8, 8, 45}});

/// A scheme, and whether S names x.
struct Choice {
  LatticeMethodChoice scheme;
  bool medium = false;
};

std::vector<Choice> all_choices() {
  std::vector<LatticeMethodChoice> choices;
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    const std::string name(entry.name);
    for (const int stages : {1, 2, 3}) {
      if (stages == 1 || entry.has_stages) {
        choices.push_back({.name = name, .stages = stages});
      }
    }
    for (const int stages : {1, 2}) {
      if (entry.has_space_stages) {
        choices.push_back({.name = name, .stages = stages, .space_stages = 3});
      }
    }
    for (const Composition& one : compositions()) {
      if (entry.has_compositions && one.name != "golden") {
        choices.push_back({.name = name, .composition = std::string(one.name)});
      }
    }
    if (entry.has_space) {
      choices.push_back({.name = name, .composition = "blanes-moan-4", .space = "differences"});
    }
  }
  std::vector<Choice> all;
  for (const LatticeMethodChoice& choice : choices) {
    for (const bool medium : {false, true}) {
      all.push_back({choice, medium});
    }
  }
  return all;
}

std::string reported(const Choice& choice) {
  return choice.scheme.name + ", stages " + std::to_string(choice.scheme.stages) + ", " + choice.scheme.composition +
         ", " + choice.scheme.space + ", space stages " + std::to_string(choice.scheme.space_stages) +
         (choice.medium ? ", a medium that varies" : "");
}

/// sine-Gordon, or a wave equation with a coefficient and a force that vary along the line.
MultisymplecticSystem system_of(const Choice& choice) {
  return choice.medium ? wave_equation("(1 + 0.4*sin(pi*x/8 + 0.3))*(1 - cos(u)) + 0.2*cos(pi*x/4)*u") : sine_gordon();
}

class Subject {
public:
  explicit Subject(const Choice& choice) : method(make_lattice_method(choice.scheme)), system(system_of(choice)) {
    InitialFields initial(3);
    const auto hump = [](double x) { return std::exp(2 * std::cos(2 * std::numbers::pi * (x - 1) / 16) - 2); };
    initial[0] = sampled(line, hump);
    initial[1] = sampled(line, [&](double x) { return 0.5 * hump(x + 2); });
    first = method->first_level(system, line, initial).level;
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(double h) const { return method->scheme(system, line, first, h); }
  [[nodiscard]] std::vector<double> after(LatticeScheme& scheme, double h, int steps) const {
    for (int k = 0; k < steps; ++k) {
      REQUIRE(scheme.advance(h, 0.0) == Status::success);
      scheme.accept();
    }
    const auto all = scheme.level().fields.all();
    return {all.begin(), all.end()};
  }

  std::unique_ptr<LatticeMethod> method;
  MultisymplecticSystem system;
  LatticeLevel first;
};

}  // namespace

TEST_CASE("every scheme for lattices is found by its name, and no other") {
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    CHECK(&lattice_method_entry(entry.name) == &entry);
    CHECK_FALSE(entry.summary.empty());
  }
  CHECK_THROWS_WITH(make_lattice_method({"boxx"}), Catch::Matchers::Contains("\"boxx\" is no scheme") &&
                                                       Catch::Matchers::Contains("\"box\", \"fourier\""));
}

TEST_CASE("every scheme for lattices continues from a saved state bit by bit, whatever was tried in between") {
  for (const Choice& choice : all_choices()) {
    INFO(reported(choice));
    const Subject subject(choice);
    const auto straight = subject.scheme(0.1);
    static_cast<void>(subject.after(*straight, 0.1, 3));
    StateWriter saved;
    straight->save(saved);
    const auto resumed = subject.scheme(0.1);
    REQUIRE(resumed->advance(0.2, 0.0) == Status::success);
    StateReader reader(saved.values());
    resumed->restore(reader);
    CHECK(reader.done());
    const auto expected = subject.after(*straight, 0.11, 2);
    CHECK(subject.after(*resumed, 0.11, 2) == expected);
    const auto other = subject.scheme(0.1);
    CHECK(subject.after(*other, 0.11, 2) != expected);  // the twin: from another level
  }
}

TEST_CASE("every scheme for lattices is unimpressed by trials that it does not accept") {
  // What is tried before decides where an iteration begins, and so the last digits: rounding of one step.
  for (const Choice& choice : all_choices()) {
    INFO(reported(choice));
    const Subject subject(choice);
    const auto plain = subject.scheme(0.1), tried = subject.scheme(0.1);
    static_cast<void>(tried->advance(0.4, 0.0));
    static_cast<void>(tried->advance(1e200, 0.0));
    static_cast<void>(tried->advance(std::numeric_limits<double>::quiet_NaN(), 0.0));
    static_cast<void>(tried->advance(-0.05, 1e-6));
    const auto expected = subject.after(*plain, 0.1, 1);
    const auto found = subject.after(*tried, 0.1, 1);
    CHECK(largest_difference(found, expected) < 1e-13);
  }
}

TEST_CASE("every scheme for lattices has the order that it says") {
  // z_h - z_{h/2} at the same time on the same grid; the next term is smaller by less than h = 0.1 for odd ones, h² for
  // the others.
  for (const Choice& choice : all_choices()) {
    INFO(reported(choice));
    const Subject subject(choice);
    const int order = subject.method->order();
    // Several stages in space make waves of κ up to 110 here, of what is nonlinear; steps have to resolve them.
    const bool fast = choice.scheme.space_stages > 1;
    const double until = fast ? 0.4 : order > 4 ? 1.6 : 0.8;
    std::vector<std::vector<double>> levels;
    for (const int steps : fast        ? std::vector{128, 256, 512}
                           : order > 4 ? std::vector{4, 8, 16}
                                       : std::vector{8, 16, 32}) {
      const auto scheme = subject.scheme(until / steps);
      levels.push_back(subject.after(*scheme, until / steps, steps));
    }
    const double coarse = largest_difference(levels[0], levels[1]), fine = largest_difference(levels[1], levels[2]);
    INFO(coarse << " " << fine);
    if (fine < 1e-12) {
      CHECK(order >= 8);  // rounding is reached before a slope is seen
      continue;
    }
    CHECK(std::log2(coarse / fine) == Approx(order).margin(0.1 * order + 0.1));
  }
}

TEST_CASE("every scheme for lattices tells the slope of its discrete energy, to leading order at least") {
  for (const Choice& choice : all_choices()) {
    const Subject subject(choice);
    if (!subject.method->fixed_levels_only().empty()) {
      continue;
    }
    INFO(reported(choice));
    const double h = subject.method->order() > 4 ? 0.4 : 0.2, change = 1e-3 * h;
    const auto energy_at = [&](double length) {
      const auto scheme = subject.scheme(h);
      REQUIRE(scheme->advance(length, 0.0) == Status::success);
      return scheme->discrete_energy();
    };
    const auto scheme = subject.scheme(h);
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    const double difference = (energy_at(h + change) - energy_at(h - change)) / (2 * change);
    // Off by a factor 1 + O(h), or by what rounding of E ~ 3 leaves of the difference.
    CHECK(scheme->discrete_energy_slope() == Approx(difference).epsilon(0.5).margin(1e-14 / change));
    if (!scheme->slope_to_leading_order()) {
      CHECK(scheme->discrete_energy_slope() == Approx(difference).epsilon(1e-4).margin(1e-14 / change));
    }
  }
}

TEST_CASE("every scheme for lattices finds its own steps to solve its equation, and others not") {
  for (const Choice& choice : all_choices()) {
    INFO(reported(choice));
    const Subject subject(choice);
    const double h = 0.1;
    const auto scheme = subject.scheme(h);
    static_cast<void>(subject.after(*scheme, h, 1));
    const LatticeLevel before = scheme->level();
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    const double energy = scheme->discrete_energy();
    scheme->accept();
    LatticeLevel after = scheme->level();
    const auto equation = subject.method->equation(subject.system, line, subject.first, h);
    const StepLaw law = equation->measure(before, after, h);
    // ε |z|/h and ε |z|/Δx, times a few.
    CHECK(law.residual.largest() < 1e-12);
    CHECK(law.energy == Approx(energy).epsilon(1e-13));
    after.fields.field(0)[7] += 1e-6;
    CHECK(equation->measure(before, after, h).residual.largest() > 1e-7);
  }
}

TEST_CASE("every scheme for lattices that states an action has the energy of that action") {
  for (const Choice& choice : all_choices()) {
    const Subject subject(choice);
    const auto action = subject.method->action(subject.system);
    if (!action) {
      CHECK_FALSE(subject.method->has_variational_laws());
      continue;
    }
    INFO(reported(choice));
    const double h = 0.1;
    const auto scheme = subject.scheme(h);
    const LatticeLevel before = scheme->level();
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    const double energy = scheme->discrete_energy();
    scheme->accept();
    LatticeVariation variation(*action, line);
    variation.take(before.fields, scheme->level().fields, h, before.slopes);
    CHECK(variation.energy() == Approx(energy).epsilon(1e-12));
    variation.take(scheme->level().fields, scheme->level().fields, h, before.slopes);
    CHECK(std::abs(variation.energy() - energy) > 1e-6);  // the twin: another step
  }
}

TEST_CASE("every scheme for lattices that states an action makes it stationary at a level between two steps") {
  for (const Choice& choice : all_choices()) {
    const Subject subject(choice);
    const auto action = subject.method->action(subject.system);
    if (!action) {
      continue;
    }
    INFO(reported(choice));
    const double h = 0.1;
    const auto scheme = subject.scheme(h);
    std::vector<grids::FieldSet> levels = {scheme->level().fields};
    for (int k = 0; k < 2; ++k) {
      static_cast<void>(subject.after(*scheme, h, 1));
      levels.push_back(scheme->level().fields);
    }
    LatticeVariation variation(*action, line);
    LatticeVariation::Parts into(subject.system.field_count(), line.size()), from(into);
    const auto variation_at_the_middle = [&] {
      variation.take(levels[0], levels[1], h);
      variation.values(into);
      variation.take(levels[1], levels[2], h);
      variation.values(from);
      return largest_difference(into.after.all(), [&] {
        for (double& value : from.before.all()) {
          value = -value;
        }
        return std::as_const(from.before).all();
      }());
    };
    CHECK(variation_at_the_middle() < 1e-13);  // ΔV z ε, times a few
    for (int f = 0; f < levels[2].fields(); ++f) {
      levels[2].field(f)[7] += 1e-6;
    }
    CHECK(variation_at_the_middle() > 1e-10);
  }
}

TEST_CASE("every scheme for lattices has local laws, small on its steps and large on others") {
  for (const Choice& choice : all_choices()) {
    INFO(reported(choice));
    const Subject subject(choice);
    LocalLaws laws = make_local_laws(*subject.method, subject.system, line);
    REQUIRE(laws.names().front() == "energy");
    const double h = 0.02;
    const auto scheme = subject.scheme(h);
    static_cast<void>(subject.after(*scheme, h, 2));
    const LatticeLevel before = scheme->level();
    static_cast<void>(subject.after(*scheme, h, 1));
    LatticeLevel after = scheme->level();
    const double sound = laws.residuals(before, after, h).front().largest();
    CHECK(std::isfinite(sound));
    for (double& value : after.fields.field(1)) {
      value += 0.05;
    }
    CHECK(laws.residuals(before, after, h).front().largest() > 3.0 * sound);
  }
}

TEST_CASE("every scheme for lattices has the level before, after a step that fails, too") {
  // u_tt - u_xx = 1/(2 - u), which drives u to 2, where S ends.
  const MultisymplecticSystem system = wave_equation("log(2 - u)");
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    INFO(entry.name);
    LatticeIntegrator lattice(
        system, line,
        {sampled(line, [](double x) { return 1.0 + 0.3 * std::cos(std::numbers::pi * x / 8); }),
         sampled(line, [](double) { return 0.5; }), std::nullopt},
        {.lagrangian = std::string(entry.name), .step = 0.1, .until = 100.0, .levels = Levels::fixed});
    const auto equal = [](const LatticeLevel& a, const LatticeLevel& b) {
      return std::ranges::equal(a.fields.all(), b.fields.all());
    };
    LatticeLevel before = lattice.level(), earlier = before;
    int steps = 0;
    for (; steps < 100 && lattice.step().status == Status::success; ++steps) {
      CHECK(equal(lattice.previous(), before));
      earlier = before;
      before = lattice.level();
      CHECK_FALSE(equal(lattice.previous(), before));  // the twin
    }
    CHECK(steps > 3);
    CHECK(steps < 100);
    CHECK(equal(lattice.level(), before));
    CHECK(equal(lattice.previous(), earlier));
  }
}
