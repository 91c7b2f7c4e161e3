// The figure of docs/levels.md: how long the steps of one orbit are with four potentials. example_levels FOLDER writes
// it as SVG; without a folder it only checks what it shows.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/rubato.hpp>

#include "figure.hpp"

namespace {

using Kind = rubato::StepPotentialChoice::Kind;

constexpr double first_step = 0.05, until = 8.2;  // two turns

rubato::Orbit rotation(const rubato::StepPotentialChoice& potential) {
  const rubato::Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
  return rubato::integrate(pendulum, {.q = {0.0}, .p = {2.2}},
                           {.step = first_step, .until = until, .potential = potential});
}

std::size_t flagged(const rubato::Orbit& orbit) {
  return static_cast<std::size_t>(std::accumulate(orbit.off_law.begin(), orbit.off_law.end(), 0));
}

/// Steps at their middles; those that are off the law apart.
void draw(Figure& figure, const rubato::Orbit& orbit, const std::string& colour, double& spread) {
  Points steps, off;
  for (std::size_t k = 0; k < orbit.steps(); ++k) {
    const Point step{orbit.t[k] + 0.5 * orbit.h[k], orbit.h[k]};
    steps.push_back(step);
    if (orbit.off_law[k]) {
      off.push_back(step);
    }
  }
  figure.curve(steps, colour);
  figure.marks(off, colour, 3.5);
  const auto [least, most] = std::ranges::minmax(orbit.h);
  spread = most / least;
}

}  // namespace

int main(int count, char** arguments) {
  struct Line {
    const char* name;
    rubato::StepPotentialChoice potential;
    const char* colour;
    double spread = 0.0;
    std::size_t flagged = 0;
  };
  std::vector<Line> lines = {
      {"none: dots are off the law", {.kind = Kind::none}, grey},
      {"kappa = 3, p = 8", {.kind = Kind::given, .kappa = 3.0, .exponent = 8.0}, red},
      {"auto", {.kind = Kind::automatic}, blue},
      {"kappa = 1, p = 3", {.kind = Kind::given, .kappa = 1.0, .exponent = 3.0}, green},
  };
  Figure figure("Steps of a rotating pendulum, with four potentials", "t", "h", {0, 0}, {8.2, 0.28});
  double y = 0.262;
  for (Line& line : lines) {
    const rubato::Orbit orbit = rotation(line.potential);
    draw(figure, orbit, line.colour, line.spread);
    line.flagged = flagged(orbit);
    figure.note({1.5, y}, line.name, line.colour);
    y -= 0.016;
    fmt::print("{}: {} steps, the longest {:.2f} times the shortest, {} off the law\n", line.name, orbit.steps(),
               line.spread, line.flagged);
  }
  if (count > 1) {
    figure.write(std::filesystem::path(arguments[1]) / "potentials.svg");
  }
  // Without a potential two turns cross Γ = 0 four times, and some steps are off the law; with one no step is off the
  // law, and the stronger it is the less the steps follow the motion.
  const bool as_told = lines[0].flagged >= 4 && lines[1].flagged + lines[2].flagged + lines[3].flagged == 0 &&
                       lines[1].spread > lines[2].spread && lines[2].spread > lines[3].spread;
  return as_told ? 0 : 1;
}
