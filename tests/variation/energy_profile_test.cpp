// The polynomial through energies at eight lengths.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <limits>

#include <rubato/variation/energy_profile.hpp>

using namespace rubato;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

/// Σ c_k x^k with its first two derivatives, c_0 … c_degree from 1 to 2.
EnergyProfile::Point series(double x, int degree) {
  EnergyProfile::Point point;
  for (int k = degree; k >= 0; --k) {
    point.bend = point.bend * x + 2.0 * point.slope;
    point.slope = point.slope * x + point.value;
    point.value = point.value * x + (1.0 + std::abs(std::sin(3.0 * k)));
  }
  return point;
}

EnergyProfile profile_of(int degree) {
  std::array<double, EnergyProfile::count> values{};
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = series(EnergyProfile::places[i], degree).value;
  }
  return EnergyProfile(values);
}

}  // namespace

TEST_CASE("Eight energies tell a polynomial of degree seven, with its derivatives") {
  const EnergyProfile profile = profile_of(7);
  for (double x = -1.0; x <= 1.0; x += 0.0625) {
    const EnergyProfile::Point found = profile.at(x), expected = series(x, 7);
    // Values up to 16, whose roundings Lebesgue's constant of 2.3 multiplies, and the derivatives by 49 and 784 more
    // (the Markovs' inequality).
    CHECK(std::abs(found.value - expected.value) < 2.3 * 16.0 * 4.0 * eps);
    CHECK(std::abs(found.slope - expected.slope) < 49.0 * 2.3 * 16.0 * 4.0 * eps);
    CHECK(std::abs(found.bend - expected.bend) < 784.0 * 2.3 * 16.0 * 4.0 * eps);
  }
}

TEST_CASE("Of degree eight they leave Chebyshev's part of it") {
  const EnergyProfile profile = profile_of(8);
  const double eighth = 1.0 + std::abs(std::sin(24.0));
  double farthest = 0.0;
  for (double x = -1.0; x <= 1.0; x += 0.0625) {
    farthest = std::max(farthest, std::abs(profile.at(x).value - series(x, 8).value));
  }
  CHECK(farthest <= eighth / 128.0 * (1.0 + 1e-10));
  CHECK(farthest > 0.99 * eighth / 128.0);  // at 1, among others
}
