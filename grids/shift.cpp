#include <rubato/grids/shift.hpp>

#include <cmath>
#include <complex>
#include <cstdlib>
#include <numbers>

#include <rubato/grids/whole.hpp>

namespace rubato::grids {

Shift::Shift(const Grid& grid, int fields) : transform_(grid, fields) {
  const Grid& whole = whole_of(grid);
  for (int a = 0; a < whole.dimensions(); ++a) {
    lengths_[static_cast<std::size_t>(a)] = whole.axis(a).length();
    cells_[static_cast<std::size_t>(a)] = whole.cells(a);
  }
}

void Shift::operator()(std::span<const double* const> in, std::span<double* const> out,
                       const std::array<double, 3>& by) {
  transform_.forward(in);
  for (std::size_t mode = 0; mode < transform_.modes(); ++mode) {
    const auto wave = transform_.wave(mode);
    std::complex<double> factor = 1.0;
    for (std::size_t a = 0; a < wave.size(); ++a) {
      if (cells_[a] == 0) {
        continue;
      }
      const double angle = 2.0 * std::numbers::pi * static_cast<double>(wave[a]) * (by[a] / lengths_[a]);
      const bool nyquist = 2 * static_cast<std::size_t>(std::abs(wave[a])) == cells_[a];
      factor *= nyquist ? std::complex<double>(std::cos(angle)) : std::polar(1.0, -angle);
    }
    for (std::size_t f = 0; f < in.size(); ++f) {
      transform_.at(static_cast<int>(f), mode) *= factor;
    }
  }
  transform_.inverse(out);
}

}  // namespace rubato::grids
