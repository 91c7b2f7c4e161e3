// Energies of steps of several lengths side by side.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <fmt/format.h>

#include <rubato/ode/splitting_energies.hpp>
#include <rubato/ode/splitting_scheme.hpp>

#include "systems.hpp"

using namespace rubato;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

std::vector<double> state_of(const InitialState& initial) {
  std::vector<double> z = initial.q;
  z.insert(z.end(), initial.p.begin(), initial.p.end());
  return z;
}

/// n masses, every two of which attract each other: as many terms as no step is one formula with.
Hamiltonian attracting(std::size_t n) {
  return Hamiltonian(n, [n](auto q, auto p) {
    auto H = p[0] * p[0] / 2;
    for (std::size_t i = 0; i < n; ++i) {
      H = i > 0 ? H + p[i] * p[i] / (2.0 + static_cast<double>(i)) : H;
      for (std::size_t j = 0; j < i; ++j) {
        H = H - 1.0 / sqrt(1.0 + pow(q[i] - q[j], 2));
      }
    }
    return H;
  });
}
std::vector<double> apart(std::size_t n) {
  std::vector<double> z(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    z[i] = std::sin(7.0 * static_cast<double>(i));
    z[n + i] = 0.3 * std::cos(5.0 * static_cast<double>(i));
  }
  return z;
}

/// The largest difference of an energy side by side from that of a step alone, relative to the terms.
double farthest(SegmentScheme& scheme, double h, double scale) {
  REQUIRE(std::isfinite(scheme.prepare_abreast()));
  std::array<double, LevelScheme::abreast> lengths{}, energies{};
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    lengths[i] = h * (1.0 + 0.05 * (static_cast<double>(i) - 3.0));
  }
  scheme.energies_abreast(lengths, energies);
  double difference = 0.0;
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    REQUIRE(scheme.advance(lengths[i] * scale, 0.0) == Status::success);
    difference = std::max(difference, std::abs(scheme.discrete_energy() - energies[i]) / scheme.energy_size().rounding);
  }
  return difference;
}

}  // namespace

TEST_CASE("Energies of steps side by side are those of single steps, to rounding") {
  for (const systems::System& system : {systems::pendulum(), systems::kepler(0.6), systems::henon_heiles()}) {
    for (const char* const name : {"golden", "blanes-moan-rkn-6", "kahan-li-8"}) {
      INFO(system.name << " " << name);
      const auto scheme = make_splitting_scheme(system.hamiltonian, composition(name), state_of(system.initial));
      const double h = 10.0 * system.step;  // so that energies tell lengths apart
      // Both are off by the bound of rounding at most.
      CHECK(farthest(*scheme, h, 1.0) <= 2.0);
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      scheme->accept();  // a state in two parts
      CHECK(farthest(*scheme, -h, 1.0) <= 2.0);
      CHECK(farthest(*scheme, h, 1.2) > 100.0);  // the twin: of other lengths
    }
  }
}

TEST_CASE("So they are of a step that is long as one formula") {
  const std::size_t n = 7;
  const auto scheme = make_splitting_scheme(attracting(n), composition("blanes-moan-rkn-6"), apart(n));
  CHECK(farthest(*scheme, 0.3, 1.0) <= 2.0);
  CHECK(farthest(*scheme, 0.3, 1.2) > 100.0);
}

TEST_CASE("What goes in vectors by itself is not taken side by side") {
  const std::size_t n = 60;
  const Hamiltonian chain(n, [](auto q, auto p) {
    auto H = p[0] * p[0] / 2 + pow(q[0], 2) / 2;
    for (std::size_t i = 1; i < n; ++i) {
      H = H + p[i] * p[i] / 2 + pow(q[i] - q[i - 1], 2) / 2 + pow(q[i] - q[i - 1], 4) / 4;
    }
    return H;
  });
  const auto scheme = make_splitting_scheme(chain, composition("golden"), apart(n));
  CHECK(std::isinf(scheme->prepare_abreast()));
}
