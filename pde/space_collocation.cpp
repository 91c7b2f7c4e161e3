#include <rubato/pde/space_collocation.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/pde/wave_loops.hpp>

namespace rubato {

namespace {

/// tan and cos of kΔx/2 = πw/n; near π/2 by the complement, so that neither loses digits.
struct HalfAngle {
  double sin, cos;
  HalfAngle(std::ptrdiff_t w, std::size_t n) {
    const double size = static_cast<double>(std::abs(w)), cells = static_cast<double>(n);
    const bool steep = 4.0 * size > cells;
    const double angle = std::numbers::pi / (2.0 * cells) * (steep ? cells - 2.0 * size : 2.0 * size);
    sin = steep ? std::cos(angle) : std::sin(angle);
    cos = steep ? std::sin(angle) : std::cos(angle);
    sin = w < 0 ? -sin : sin;
  }
};

}  // namespace

SpaceCollocation::SpaceCollocation(const grids::Grid& grid, SpaceRule rule) : rule_(rule) {
  if (rule.stages < 0 || rule.stages > 1) {
    throw std::invalid_argument(fmt::format("collocation in space with {} stages", rule.stages));
  }
  const grids::Fourier fourier(grid, 1);
  const std::size_t waves = fourier.modes();
  derivatives_.assign(static_cast<std::size_t>(grid.dimensions()), std::vector<double>(waves));
  if (!spectral()) {
    factor_ = WaveRows(1, waves);
    inverse_ = WaveRows(1, waves);
  }
  for (int a = 0; a < grid.dimensions(); ++a) {
    if (!spectral() && grid.cells(a) % 2 == 0) {
      throw std::invalid_argument(
          fmt::format("{} has {} cells, and collocation on cells needs an odd number: averaging annihilates the "
                      "sawtooth of an even "
                      "one",
                      grid.axis(a).name, grid.cells(a)));
    }
  }
  for (std::size_t w = 0; w < waves; ++w) {
    const auto wave = fourier.wave(w);
    std::complex<double> factor = 1.0, inverse = 1.0;
    for (int a = 0; a < grid.dimensions(); ++a) {
      const auto axis = static_cast<std::size_t>(a);
      if (spectral()) {
        derivatives_[axis][w] = grids::derivative_symbol(wave[axis], grid.axis(a)).imag();
        continue;
      }
      const HalfAngle half(wave[axis], grid.cells(a));
      derivatives_[axis][w] = 2.0 / grid.spacing(a) * (half.sin / half.cos);
      const std::complex<double> phase(half.cos, half.sin);
      factor *= half.cos * phase;
      inverse *= std::conj(phase) / half.cos;
    }
    if (!spectral()) {
      factor_.re.field(0)[w] = factor.real();
      factor_.im.field(0)[w] = factor.imag();
      inverse_.re.field(0)[w] = inverse.real();
      inverse_.im.field(0)[w] = inverse.imag();
    }
  }
}

namespace {

void multiply_rows(const WaveRows& factor, WaveRows& rows) {
  for_each_wave_block(rows.waves(), [&](std::size_t begin, std::size_t end) {
    for (int f = 0; f < rows.rows(); ++f) {
      multiply(factor.re.field(0).data() + begin, factor.im.field(0).data() + begin, end - begin,
               rows.re.pointers()[static_cast<std::size_t>(f)] + begin,
               rows.im.pointers()[static_cast<std::size_t>(f)] + begin);
    }
  });
}

}  // namespace

void SpaceCollocation::from_nodes(WaveRows& rows) const {
  if (!spectral()) {
    multiply_rows(factor_, rows);
  }
}

void SpaceCollocation::to_nodes(WaveRows& rows) const {
  if (!spectral()) {
    multiply_rows(inverse_, rows);
  }
}

PlacedCoordinates SpaceCollocation::places(const MultisymplecticSystem& system, const grids::Grid& grid) const {
  return PlacedCoordinates(system, grid, spectral() ? Within::node : Within::centre);
}

}  // namespace rubato
