#include <rubato/variation/energy_profile.hpp>

namespace rubato {

namespace {

constexpr std::size_t half = EnergyProfile::count / 2;

/// [j][k]: of y^k in Lagrange's polynomial that is 1 at y_j = x_j² and 0 at the others, halved; and divided by x_j.
struct ProfileWeights {
  std::array<std::array<double, half>, half> even{}, odd{};
};
constexpr ProfileWeights of_profile = [] {
  ProfileWeights all;
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
      all.even[j][k] = 0.5 * product[k] / scale;
      all.odd[j][k] = all.even[j][k] / EnergyProfile::places[j];
    }
  }
  return all;
}();

}  // namespace

EnergyProfile::EnergyProfile(std::span<const double, count> values) {
  for (std::size_t j = 0; j < half; ++j) {
    const double sum = values[j] + values[half + j], difference = values[j] - values[half + j];
    for (std::size_t k = 0; k < half; ++k) {
      even_[k] += of_profile.even[j][k] * sum;
      odd_[k] += of_profile.odd[j][k] * difference;
    }
  }
}

}  // namespace rubato
