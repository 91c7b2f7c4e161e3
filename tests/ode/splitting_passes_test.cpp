// Steps of a splitting in passes, beside those part by part.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/ode/splitting_passes.hpp>

using namespace rubato;

namespace {

constexpr std::size_t n = 37;

/// A chain in a valley, `light`: the first mass moves by the theory of relativity.
Hamiltonian chain(bool light) {
  return Hamiltonian(n, [light](auto q, auto p) {
    auto H = pow(q[0], 2) / 2 + (light ? sqrt(1.0 + pow(p[0], 2)) : pow(p[0], 2) / 2);
    for (std::size_t i = 1; i < n; ++i) {
      H = H + pow(p[i], 2) / 2 + pow(q[i] - q[i - 1], 2) / 2 + pow(q[i] - q[i - 1], 3) / 12 - cos(q[i]) / 3.0;
    }
    return H;
  });
}

std::vector<double> some_state() {
  std::vector<double> z(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    z[i] = 0.4 * std::sin(7.0 * static_cast<double>(i));
    z[n + i] = 0.3 * std::cos(5.0 * static_cast<double>(i));
  }
  return z;
}

/// Part after part, each number by itself.
class PartByPart {
public:
  PartByPart(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition)
      : composition_(composition), T_(T.code, formula::Engine::interpreter), V_(V.code, formula::Engine::interpreter) {}

  /// \return E; the numbers stand as those of a SplittingState.
  double operator()(double h, std::span<double> numbers) {
    double energy = 0.0;
    for (const Composition::Part& part : composition_.parts) {
      formula::ScalarEvaluator& half = part.drift ? T_ : V_;
      std::ranges::copy(numbers.subspan(part.drift ? 2 * n : n, n), half.inputs().begin());
      half.run();
      energy += part.length * half.output(0);
      const std::span<double> moved = numbers.subspan(part.drift ? n : 2 * n, n);
      const std::span<double> low = numbers.subspan(part.drift ? 0 : 3 * n, n);
      const double length = (part.drift ? part.length : -part.length) * h;
      for (std::size_t i = 0; i < n; ++i) {
        const double change = low[i] + length * half.output(1 + i);
        const double sum = moved[i] + change;
        low[i] = change - (sum - moved[i]);
        moved[i] = sum;
      }
    }
    return energy;
  }

private:
  const Composition& composition_;
  formula::ScalarEvaluator T_, V_;
};

bool same(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}
bool same(const std::vector<double>& a, std::span<const double> b) {
  return std::ranges::equal(a, b, [](double x, double y) { return same(x, y); });
}

struct Beside {
  explicit Beside(const Composition& composition, bool light = false)
      : halves(separate(keep(light))),
        T(halves.T, std::span(hamiltonian->variables()).subspan(n)),
        V(halves.V, std::span(hamiltonian->variables()).first(n)),
        passes(T, V, composition),
        parts(T, V, composition),
        levels(passes.levels()),
        numbers(4 * n, 0.0) {
    std::ranges::copy(some_state(), numbers.begin() + n);
    std::ranges::copy(numbers, levels[0].begin());
  }
  const Hamiltonian& keep(bool light) { return *(hamiltonian = chain(light)); }

  /// A step from level to level by both. \return whether they are the same
  bool step(double h) {
    const double energy = passes(h, levels[here].data(), levels[1 - here].data());
    here = 1 - here;
    const double expected = parts(h, numbers);
    return same(numbers, levels[here]) && same(energy, expected);
  }

  std::optional<Hamiltonian> hamiltonian;
  Separation halves;
  SplittingHalf T, V;
  SplittingPasses passes;
  PartByPart parts;
  std::array<std::span<double>, 2> levels;
  std::size_t here = 0;
  std::vector<double> numbers;  ///< by parts
};

}  // namespace

TEST_CASE("a step in passes is one part after the other, bit for bit") {
  for (const Composition& composition : compositions()) {
    for (const bool light : {false, true}) {
      if (light && composition.of_quadratic_kinetic_energy) {
        continue;
      }
      INFO(composition.name << " " << light);
      Beside both(composition, light);
      for (const double h : {0.1, 0.13, -0.07, 0.2, 0.1}) {
        CHECK(both.step(h));
      }
      // A trial that is not taken leaves the level as it is.
      (void)both.passes(0.3, both.levels[both.here].data(), both.levels[1 - both.here].data());
      CHECK(both.step(0.1));
    }
  }
}

TEST_CASE("passes take up what is changed between steps if they are told") {
  for (const bool reported : {true, false}) {
    for (const char* const name : {"verlet", "kahan-li-6"}) {
      INFO(name << " " << reported);
      Beside both(composition(name));
      REQUIRE(both.step(0.1));
      both.numbers[n + 3] += 0.01;
      both.levels[both.here][n + 3] = both.numbers[n + 3];
      if (reported) {
        both.passes.forget();
      }
      CHECK(both.step(0.1) == reported);
    }
  }
}
