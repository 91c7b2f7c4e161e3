#include <rubato/variation/energy_profile.hpp>

namespace rubato {

namespace {

constexpr std::size_t half = EnergyProfile::count / 2;

/// [j][k]: of y^k in Lagrange's polynomial that is 1 at y_j = x_j² and 0 at the others.
constexpr auto lagrange = [] {
  std::array<std::array<double, half>, half> all{};
  for (std::size_t j = 0; j < half; ++j) {
    const auto square = [](std::size_t i) { return EnergyProfile::places[i] * EnergyProfile::places[i]; };
    std::array<double, half> product{1.0};
    double scale = 1.0;
    for (std::size_t i = 0; i < half; ++i) {
      if (i == j) {
        continue;
      }
      for (std::size_t k = half; k-- > 0;) {
        product[k] = (k > 0 ? product[k - 1] : 0.0) - square(i) * product[k];
      }
      scale *= square(j) - square(i);
    }
    for (std::size_t k = 0; k < half; ++k) {
      all[j][k] = product[k] / scale;
    }
  }
  return all;
}();

}  // namespace

EnergyProfile::EnergyProfile(std::span<const double, count> values) {
  for (std::size_t j = 0; j < half; ++j) {
    const double mean = 0.5 * (values[j] + values[half + j]);
    const double slope = 0.5 * (values[j] - values[half + j]) / places[j];
    for (std::size_t k = 0; k < half; ++k) {
      even_[k] += lagrange[j][k] * mean;
      odd_[k] += lagrange[j][k] * slope;
    }
  }
}

}  // namespace rubato
