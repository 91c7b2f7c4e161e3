// Periodic orbits and their second variation: families and figures with known numbers, an integration with 30 digits
// (made with mpmath by Taylor series of order 36), and closed forms.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include <rubato/ode/boundary_value.hpp>
#include <rubato/ode/darboux.hpp>
#include <rubato/ode/second_variation.hpp>

using namespace rubato;

namespace {

constexpr double pi = std::numbers::pi;

const Hamiltonian& henon_heiles() {
  static const Hamiltonian H({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3");
  return H;
}

BoundaryValueSolution periodic(const Hamiltonian& H, const SegmentLagrangian& lagrangian,
                               const std::vector<double>& z_0, double period, std::size_t steps,
                               std::optional<double> energy, Levels levels = Levels::fixed) {
  const NodesOfOrbit guess = guess_by_integrating(H, lagrangian, z_0, period / static_cast<double>(steps), steps);
  return solve_boundary_value(H, EndConditions::periodic(H), guess,
                              {.lagrangian = lagrangian,
                               .levels = levels,
                               .duration = energy ? std::nullopt : std::optional(period),
                               .energy = energy});
}

SecondVariation variation_of(const Hamiltonian& H, const SegmentLagrangian& lagrangian,
                             const BoundaryValueSolution& solution) {
  return {*make_segment_equation(H, lagrangian), solution.orbit};
}

/// How far an orbit is from closed when it is integrated anew, by another scheme and with half the step.
double closure(const Hamiltonian& H, const BoundaryValueSolution& solution) {
  const std::size_t steps = 2 * solution.orbit.segments();
  const NodesOfOrbit again = guess_by_integrating(H, Gauss{8}, solution.orbit.node(0),
                                                  solution.orbit.duration() / static_cast<double>(steps), steps);
  double largest = 0.0;
  for (std::size_t i = 0; i < again.dimension; ++i) {
    largest = std::max(largest, std::abs(again.node(steps)[i] - again.node(0)[i]));
  }
  return largest;
}

/// z turned by the angle in the plane of (x, y), and in that of (u, v).
std::vector<double> turned(const std::vector<double>& z, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * z[0] - s * z[1], s * z[0] + c * z[1], c * z[2] - s * z[3], s * z[2] + c * z[3]};
}

}  // namespace

TEST_CASE("periodic orbits: the eight families of Henon and Heiles") {
  // At E = 1/12: three straight lines on the axes of symmetry, three curves across them, and two that go round.
  constexpr double E = 1.0 / 12.0;
  const double speed = std::sqrt(2.0 * E);
  const std::vector<double> line = {0.0, 0.0, 0.0, speed}, across = {0.0, -0.05, 0.97 * speed, 0.0},
                            round = {0.0, 0.25, 0.33, 0.0};
  std::vector<double> periods;
  for (const auto& [start, count, mirrored] :
       {std::tuple(line, 3, false), std::tuple(across, 3, false), std::tuple(round, 2, true)}) {
    for (int i = 0; i < count; ++i) {
      std::vector<double> z = mirrored ? start : turned(start, 2.0 * pi * i / 3.0);
      z[2] *= mirrored && i == 1 ? -1.0 : 1.0;
      const BoundaryValueSolution found = periodic(henon_heiles(), Gauss{6}, z, 2.0 * pi, 60, E);
      CAPTURE(count, i, found.message);
      REQUIRE(found.found());
      CHECK(std::abs(found.mean_energy - E) < 1e-14);
      CHECK(closure(henon_heiles(), found) < 1e-12);
      periods.push_back(found.orbit.duration());
      const auto multipliers = variation_of(henon_heiles(), Gauss{6}, found).multipliers();
      // Two are 1, of the phase and the energy, found to the root of rounding.
      int ones = 0;
      for (const auto& multiplier : multipliers) {
        ones += std::abs(multiplier - 1.0) < 1e-6 ? 1 : 0;
      }
      CHECK(ones == 2);
    }
  }
  // Those of a family are images of each other; families differ.
  for (const auto& [first, last] : {std::pair(0, 2), std::pair(3, 5), std::pair(6, 7)}) {
    for (int i = first; i <= last; ++i) {
      CHECK(std::abs(periods[i] - periods[first]) < 1e-12);
    }
  }
  CHECK(std::abs(periods[0] - periods[3]) > 1e-3);
  CHECK(std::abs(periods[3] - periods[6]) > 1e-3);
  // On the line x = 0: v² = 2E - y² + 2y³/3 = 2/3 (y - a)(y - b)(y - c), a < b < c, with the period
  // 2 ∫_a^b dy/v = 2 √6 K(k)/√(c - a), k² = (b - a)/(c - a).
  std::vector<double> roots;
  for (const double guess : {-0.35, 0.5, 1.3}) {
    double y = guess;
    for (int i = 0; i < 50; ++i) {
      y -= (2.0 * E - y * y + 2.0 * y * y * y / 3.0) / (-2.0 * y + 2.0 * y * y);
    }
    roots.push_back(y);
  }
  const double width = roots[2] - roots[0], k = std::sqrt((roots[1] - roots[0]) / width);
  CHECK(std::abs(periods[0] - 2.0 * std::sqrt(6.0) * std::comp_ellint_1(k) / std::sqrt(width)) < 1e-12);
}

TEST_CASE("periodic orbits: levels of the total variation, with the discrete energy on every step") {
  const BoundaryValueSolution found =
      periodic(henon_heiles(), Midpoint{}, {0.0, 0.25, 0.33, 0.0}, 2.0 * pi, 100, 1.0 / 12.0, Levels::variable);
  REQUIRE(found.found());
  CHECK_FALSE(found.potential.active());
  double most = 0.0, least = 1e9;
  for (std::size_t k = 0; k < found.orbit.segments(); ++k) {
    CHECK(std::abs(found.energy[k] - found.conserved) < 1e-15);
    most = std::max(most, found.orbit.h[k]);
    least = std::min(least, found.orbit.h[k]);
  }
  CHECK(most > 1.02 * least);  // twin: they are no equal steps
}

TEST_CASE("periodic orbits: the figure eight of three bodies") {
  const Hamiltonian bodies(
      {"a", "b", "c", "d", "e", "f"}, {"pa", "pb", "pc", "pd", "pe", "pf"},
      "(pa^2 + pb^2 + pc^2 + pd^2 + pe^2 + pf^2)/2 - 1/norm(a - b, d - e) - 1/norm(b - c, e - f) - "
      "1/norm(c - a, f - d)");
  // Coordinates x of the three bodies, then y; the guess has three digits.
  const std::vector<double> z = {0.97, -0.97, 0.0, -0.243, 0.243, 0.0, 0.466, 0.466, -0.932, 0.432, 0.432, -0.864};
  constexpr double T = 6.32591398;  // Simo's, to the digits that are published
  constexpr std::size_t steps = 126;
  const BoundaryValueSolution found = periodic(bodies, Gauss{6}, z, T, steps, std::nullopt);
  REQUIRE(found.found());
  CHECK(found.residual < 1e-14);
  CHECK(closure(bodies, found) < 1e-11);  // errors grow with t in the phase
  CHECK(std::abs(found.mean_energy - -1.287142) < 1e-6);
  // It is a choreography: a third of a period later every body is where another one was. No symmetry was imposed.
  double largest = 0.0, twin = 0.0;
  for (std::size_t k = 0; k + steps / 3 <= steps; ++k) {
    const std::span<const double> now = found.orbit.node(k), later = found.orbit.node(k + steps / 3);
    double nearest = 1e9, other = 0.0;
    for (const int shift : {1, 2}) {
      double distance = 0.0;
      for (std::size_t body = 0; body < 3; ++body) {
        const std::size_t next = (body + static_cast<std::size_t>(shift)) % 3;
        distance = std::max({distance, std::abs(later[body] - now[next]), std::abs(later[3 + body] - now[3 + next])});
      }
      nearest = std::min(nearest, distance);
      other = std::max(other, distance);
    }
    largest = std::max(largest, nearest);
    twin = std::max(twin, other);
  }
  CHECK(largest < 1e-12);
  CHECK(twin > 0.1);
  // Linearly stable (C. Simo, in: Celestial Mechanics, Contemporary Mathematics 292, 2002): the two pairs off 1 turn by
  // 0.00842272 and 0.29809253 of a circle.
  const auto multipliers = variation_of(bodies, Gauss{6}, found).multipliers();
  std::vector<double> angles;
  for (const auto& multiplier : multipliers) {
    CHECK(std::abs(multiplier) == Approx(1.0).margin(1e-5));
    if (multiplier.imag() > 1e-3) {
      angles.push_back(std::arg(multiplier) / (2.0 * pi));
    }
  }
  std::ranges::sort(angles);
  REQUIRE(angles.size() == 2);
  CHECK(angles[0] == Approx(0.00842272).margin(5e-8));
  CHECK(angles[1] == Approx(0.29809253).margin(5e-8));
}

TEST_CASE("periodic orbits: a Lyapunov orbit at L1 and its Floquet multipliers against 30 digits") {
  const Hamiltonian H({"x", "y"}, {"px", "py"},
                      "(px^2 + py^2)/2 + y*px - x*py - (1 - mu)/norm(x + mu, y) - mu/norm(x - 1 + mu, y)",
                      {{"mu", 0.012150585609624}});
  // Half of the orbit, from one crossing of the axis to the next.
  const std::vector<std::string> ends = {"y_0 = 0", "px_0 = 0", "y_1 = 0", "px_1 = 0"};
  constexpr std::size_t steps = 70;
  const NodesOfOrbit guess =
      guess_by_integrating(H, Gauss{6}, std::vector<double>{0.812, 0.0, 0.0, 1.06}, 2.75 / 2 / steps, steps);
  const BoundaryValueSolution half =
      solve_boundary_value(H, {H, ends}, guess, {.lagrangian = Gauss{6}, .levels = Levels::fixed, .energy = -1.59});
  REQUIRE(half.found());
  CHECK(std::abs(half.orbit.node(0)[0] - 0.82617852850499975492759436715338) < 1e-14);
  CHECK(std::abs(half.orbit.node(0)[3] - 0.92412660754929077700208378123902) < 1e-14);
  CHECK(std::abs(2.0 * half.orbit.duration() - 2.7216785894875200429030816631765) < 1e-13);
  const BoundaryValueSolution whole = periodic(H, Gauss{6}, {half.orbit.node(0).begin(), half.orbit.node(0).end()},
                                               2.0 * half.orbit.duration(), 2 * steps, -1.59);
  REQUIRE(whole.found());
  const auto multipliers = variation_of(H, Gauss{6}, whole).multipliers();
  // The large one to rounding times the length of the product; the small one, its inverse, to 1e-16 times the large.
  CHECK(std::abs(multipliers[0] - 2484.7072633634373757052170238469) < 1e-11 * 2484.7);
  CHECK(std::abs(multipliers[3] - 0.00040246189752202221664422053863046) < 1e-12);
  CHECK(std::abs(multipliers[1] - 1.0) < 1e-5);
  // Twin: at another energy they are others.
  const BoundaryValueSolution other = periodic(H, Gauss{6}, {half.orbit.node(0).begin(), half.orbit.node(0).end()},
                                               2.0 * half.orbit.duration(), 2 * steps, -1.5900001);
  REQUIRE(other.found());
  CHECK(std::abs(variation_of(H, Gauss{6}, other).multipliers()[0] - multipliers[0]) > 1e-4);
}

TEST_CASE("second variation: conjugate points and Morse's index of oscillators") {
  // Two oscillators of frequencies 1 and 2: variations that vanish at 0 vanish again at the multiples of pi and pi/2.
  const Hamiltonian H({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + 4*y^2)/2");
  for (const double T : {1.0, 2.0, 3.0, 4.0, 5.0, 7.0}) {
    constexpr std::size_t steps = 200;
    const NodesOfOrbit orbit =
        guess_by_integrating(H, Gauss{4}, std::vector<double>{0.1, 0.2, 0.3, 0.4}, T / steps, steps);
    const SecondVariation variation(*make_segment_equation(H, Gauss{4}), orbit);
    CHECK(variation.is_legendre());
    const auto expected = static_cast<std::size_t>(std::floor(T / pi) + std::floor(T / (pi / 2.0)));
    CHECK(variation.index_of_fixed_ends() == expected);  // Morse's theorem, with multiplicities
    // det = sin t · sin 2t/2: simple zeros at odd multiples of pi/2, double ones, without a change of sign, at pi.
    const std::vector<double> points = variation.conjugate_points();
    REQUIRE(points.size() == static_cast<std::size_t>(std::floor(T / pi + 0.5)));
    for (std::size_t i = 0; i < points.size(); ++i) {
      CHECK(std::abs(points[i] - (static_cast<double>(i) + 0.5) * pi) < 1e-6);  // O(h⁴), h = 0.035
    }
  }
  // A hill has no conjugate points. With a negative mass there is no Legendre condition, and nothing is said.
  for (const bool is_hill : {true, false}) {
    const Hamiltonian one({"q"}, {"p"}, is_hill ? "p^2/2 - q^2/2" : "-p^2/2 - q^2/2");
    const NodesOfOrbit orbit = guess_by_integrating(one, Gauss{2}, std::vector<double>{0.1, 0.2}, 0.1, 100);
    const SecondVariation variation(*make_segment_equation(one, Gauss{2}), orbit);
    CHECK(variation.is_legendre() == is_hill);
    CHECK(variation.index_of_fixed_ends() == (is_hill ? std::optional<std::size_t>(0) : std::nullopt));
    CHECK(variation.conjugate_points().empty());
  }
}

TEST_CASE("second variation: the monodromy matrix is symplectic, and that of an action that is no map is refused") {
  const BoundaryValueSolution found =
      periodic(henon_heiles(), Gauss{3}, {0.0, 0.25, 0.33, 0.0}, 2.0 * pi, 60, 1.0 / 12.0);
  Eigen::MatrixXd M = variation_of(henon_heiles(), Gauss{3}, found).monodromy();
  CHECK(is_symplectic(M, 1e-13));
  M(0, 1) += 1e-9;
  CHECK_FALSE(is_symplectic(M, 1e-13));  // twin
  const auto forward = make_segment_equation(henon_heiles(), Forward{});
  CHECK_THROWS_WITH(SecondVariation(*forward, found.orbit), Catch::Contains("no"));
}
