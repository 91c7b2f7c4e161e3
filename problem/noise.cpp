#include <rubato/problem/noise.hpp>

#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/draws.hpp>

namespace rubato {

namespace {

constexpr std::int64_t most_waves = 5000;
using WaveVector = std::array<std::int64_t, 3>;

/// One of each pair k, -k, all but 0: those whose last number that is not 0 is positive.
std::vector<WaveVector> wave_vectors(std::size_t dimensions, std::int64_t waves) {
  std::vector<WaveVector> all;
  const std::int64_t ky = dimensions > 1 ? waves : 0, kz = dimensions > 2 ? waves : 0;
  for (std::int64_t z = 0; z <= kz; ++z) {
    for (std::int64_t y = z > 0 ? -ky : 0; y <= ky; ++y) {
      for (std::int64_t x = z > 0 || y > 0 ? -waves : 1; x <= waves; ++x) {
        all.push_back({x, y, z});
      }
    }
  }
  return all;
}

}  // namespace

formula::Expression random_waves(formula::Graph& graph, std::span<const GridAxis> axes, std::int64_t seed,
                                 std::int64_t waves) {
  const double count = (std::pow(2.0 * static_cast<double>(waves) + 1.0, static_cast<double>(axes.size())) - 1.0) / 2.0;
  if (waves < 1) {
    throw std::invalid_argument(
        fmt::format("the number of waves of noise(seed, waves) goes from 1 on, and is {}", waves));
  }
  if (count > static_cast<double>(most_waves)) {
    throw std::invalid_argument(
        fmt::format("noise(seed, waves) sums all waves with up to so many periods along each axis, at most {} of them; "
                    "with {} there would be {:.0f}",
                    most_waves, waves, count));
  }
  const Draws draws(static_cast<std::uint64_t>(seed));
  const std::vector<WaveVector> vectors = wave_vectors(axes.size(), waves);
  const double scale = 1.0 / std::sqrt(static_cast<double>(vectors.size()));
  formula::Expression sum = graph.constant(0.0);
  for (const WaveVector& k : vectors) {
    formula::Expression phase = graph.constant(0.0);
    std::uint64_t row = 0;
    for (std::size_t a = 0; a < axes.size(); ++a) {
      row = (row << 20U) + static_cast<std::uint64_t>(k[a] + (1 << 16));
      if (k[a] != 0) {
        const double turn = 2.0 * std::numbers::pi * static_cast<double>(k[a]) / (axes[a].to - axes[a].from);
        phase += turn * (graph.variable(axes[a].name) - axes[a].from);
      }
    }
    sum += (scale * draws.normal(row, 0)) * cos(phase) + (scale * draws.normal(row, 1)) * sin(phase);
  }
  return sum;
}

}  // namespace rubato
