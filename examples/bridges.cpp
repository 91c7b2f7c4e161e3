// The figures of docs/bridges.md: the law of the steps, the singular set, a bridge, and what its end forgets.
// example_bridges FOLDER writes them as SVG; without a folder it only checks what they show.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/rubato.hpp>

#include "figure.hpp"

namespace {

const rubato::Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");

rubato::Orbit rotation(double step, double until, rubato::BridgeRule rule = rubato::BridgeRule::anchored) {
  return rubato::integrate(pendulum, {.q = {0.0}, .p = {2.2}}, {.step = step, .until = until, .bridge = rule});
}

/// h against Γ at the middle of the step, both as logarithms: -1/3 is the slope of the law.
Figure draw_law(double& slope) {
  Figure figure("Step law: h³Γ is constant along an orbit", "log10 |Γ|", "log10 h", {-0.8, -1.1}, {0.8, -0.5});
  for (const double p : {1.9, 2.2}) {
    const rubato::Orbit orbit = rubato::integrate(pendulum, {.q = {0.0}, .p = {p}}, {.step = 0.1, .until = 20.0});
    Points ordinary, bridges;
    for (std::size_t k = 0; k < orbit.steps(); ++k) {
      const double gamma = 0.5 * (orbit.gamma[k] + orbit.gamma[k + 1]);
      (orbit.bridged[k] ? bridges : ordinary).push_back({std::log10(std::abs(gamma)), std::log10(orbit.h[k])});
    }
    figure.marks(ordinary, p < 2 ? blue : red, 2.0);
    if (p < 2) {
      const auto [low, high] = std::ranges::minmax_element(ordinary, {}, &Point::x);
      slope = (high->y - low->y) / (high->x - low->x);
      figure.curve({{-0.8, low->y + (low->x + 0.8) / 3}, {0.8, low->y + (low->x - 0.8) / 3}}, grey, true);
    }
  }
  figure.note({0.1, -0.56}, "slope -1/3", grey);
  figure.note({0.1, -0.60}, "from (0, 1.9), librating", blue);
  figure.note({0.1, -0.64}, "from (0, 2.2), turning over", red);
  return figure;
}

/// Γ = (sin q)² + p² cos q vanishes on p² = -sin² q / cos q: orbits outside the separatrix meet it, those inside not.
Figure draw_singular_set() {
  constexpr double pi = std::numbers::pi;
  Figure figure("Phase plane of the pendulum, and where Γ = 0", "q", "p", {-pi, -2.8}, {pi, 2.8});
  for (const double side : {-1.0, 1.0}) {
    for (const double turn : {-1.0, 1.0}) {
      Points zero;
      for (double q = pi / 2 + 0.02; q <= pi; q += 0.02) {
        zero.push_back({turn * q, side * std::sin(q) / std::sqrt(-std::cos(q))});
      }
      figure.curve(zero, red);
    }
    for (const double energy : {-0.5, 0.0, 0.5, 1.0, 1.42, 2.2}) {
      Points orbit;
      const double farthest = energy < 1 ? std::acos(-energy) : pi;
      for (double angle = -pi / 2; angle <= pi / 2 + 1e-9; angle += pi / 100) {
        const double q = farthest * std::sin(angle);
        orbit.push_back({q, side * std::sqrt(std::max(0.0, 2 * (energy + std::cos(q))))});
      }
      figure.curve(orbit, energy < 1 ? blue : grey, energy == 1.0);
    }
  }
  figure.note({1.2, 2.45}, "Γ = 0", red);
  return figure;
}

/// H(z_k) - E at the levels of a rotating pendulum, and the node law.
Figure draw_bridge(std::size_t& bridges) {
  Figure figure("Node law and bridges: pendulum from (0, 2.2), first step 0.05", "t", "H(z) - E", {0, -2e-3},
                {8, 2e-3});
  const rubato::Orbit orbit = rotation(0.05, 8.0);
  const double E = orbit.energy.front();
  const double c = std::pow(std::pow(orbit.h[0], 3) * orbit.gamma[0], 2.0 / 3.0) / 8;
  Points law, levels;
  std::vector<Points> steps;
  for (std::size_t k = 0; k < orbit.t.size(); ++k) {
    levels.push_back({orbit.t[k], orbit.node_energy[k] - E});
    if (k < orbit.steps() && orbit.bridged[k]) {
      steps.push_back({{orbit.t[k], orbit.node_energy[k] - E}, {orbit.t[k + 1], orbit.node_energy[k + 1] - E}});
    }
  }
  // The law in between, along a fine orbit of fixed levels.
  const rubato::Orbit fine = rubato::integrate(pendulum, {.q = {0.0}, .p = {2.2}},
                                               {.step = 0.02, .until = 8.0, .levels = rubato::Levels::fixed});
  for (std::size_t k = 0; k < fine.t.size(); ++k) {
    law.push_back({fine.t[k], c * std::cbrt(fine.gamma[k])});
  }
  figure.curve(law, grey);
  for (const Points& step : steps) {
    figure.curve(step, red);
  }
  figure.marks(levels, blue);
  figure.note({0.2, -1.7e-3}, "c cbrt(Γ)", grey);
  figure.note({1.6, -1.7e-3}, "levels", blue);
  figure.note({2.6, -1.7e-3}, "bridges", red);
  bridges = steps.size();
  return figure;
}

/// The amplitude c after every bridge, two levels later, relative to the first.
Points amplitudes(rubato::BridgeRule rule, double until) {
  const rubato::Orbit orbit = rotation(0.05, until, rule);
  const double E = orbit.energy.front();
  Points points;
  double first = 0.0;
  for (std::size_t k = 0; k + 5 < orbit.steps(); ++k) {
    if (orbit.bridged[k]) {
      const double c = (orbit.node_energy[k + 4] - E) / std::cbrt(orbit.gamma[k + 4]);
      first = first == 0.0 ? c : first;
      points.push_back({static_cast<double>(points.size()), c / first});
    }
  }
  return points;
}

Figure draw_amplitude(double& anchored_spread, double& reversible_spread) {
  Figure figure("Amplitude of H - E after each bridge", "bridge", "c, relative to the first", {0, 0.95}, {500, 1.03});
  const auto spread = [](const Points& points) {
    const auto [low, high] = std::ranges::minmax(points, {}, &Point::y);
    return high.y - low.y;
  };
  const Points anchored = amplitudes(rubato::BridgeRule::anchored, 1060.0);
  const Points reversible = amplitudes(rubato::BridgeRule::reversible, 1060.0);
  figure.curve(reversible, red);
  figure.curve(anchored, blue);
  figure.note({20, 1.020}, "anchored", blue);
  figure.note({20, 1.014}, "reversible", red);
  anchored_spread = spread(anchored);
  reversible_spread = spread(reversible);
  return figure;
}

}  // namespace

int main(int count, char** arguments) {
  double slope = 0.0;
  double anchored = 0.0;
  double reversible = 0.0;
  std::size_t bridges = 0;
  const std::array<std::pair<const char*, Figure>, 4> figures = {
      {{"law.svg", draw_law(slope)},
       {"singular-set.svg", draw_singular_set()},
       {"bridge.svg", draw_bridge(bridges)},
       {"amplitude.svg", draw_amplitude(anchored, reversible)}}};
  if (count > 1) {
    for (const auto& [name, figure] : figures) {
      figure.write(std::filesystem::path(arguments[1]) / name);
    }
  }
  fmt::print(
      "slope of log h over log Gamma: {:.4f}; bridges in 8 time units: {}; spread of the amplitude over 500 "
      "bridges: {:.4f} anchored, {:.4f} reversible\n",
      slope, bridges, anchored, reversible);
  // The law has a relative error of h²: 1 % of the exponent. Two turns of about 4.1 cross four zeros. One bridge leaves
  // the amplitude uncertain by a thousandth or so, and only the reversible rule lets that add up.
  const bool as_told = std::abs(slope + 1.0 / 3.0) < 0.003 && bridges == 4 && anchored < 0.01 && reversible > anchored;
  return as_told ? 0 : 1;
}
