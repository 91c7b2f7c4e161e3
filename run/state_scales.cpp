#include <rubato/run/state_scales.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/grids/reductions.hpp>
#include <rubato/run/disagreements.hpp>

namespace rubato {

std::size_t number_in_whole(const grids::Slab* slab, std::size_t node) {
  if (slab == nullptr) {
    return node;
  }
  const grids::Axis& axis = slab->grid().axes().back();
  const std::size_t plane = slab->size() / axis.cells;
  return (axis.first + node / plane) % axis.of * plane + node % plane;
}

void StateScales::see(std::span<const double> z) {
  scales_.resize(z.size() / components_, 0.0);
  for (std::size_t c = 0; c < scales_.size(); ++c) {
    const auto values = z.subspan(c * components_, components_);
    const auto finite = [values](std::size_t i) { return std::isfinite(values[i]) ? values[i] : 0.0; };
    scales_[c] = std::max(scales_[c], grids::max_abs_of(values.size(), finite));
  }
}

std::vector<double> StateScales::displaced(std::span<const double> z, int attempt, int level) const {
  const std::size_t whole = slab_ == nullptr ? components_ : slab_->whole().size();
  std::vector<double> moved(z.begin(), z.end());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const std::size_t component = i / components_, number = component * whole + number_in_whole(slab_, i % components_);
    moved[i] += Rounding::sign(attempt, number, level) * Rounding::displacement * scales_[component];
  }
  return moved;
}

}  // namespace rubato
