#include <rubato/pde/variational_laws.hpp>

#include <utility>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>

namespace rubato {

VariationalLaws::VariationalLaws(LatticeAction action, const grids::Grid& grid)
    : variation_(std::move(action), grid),
      names_{"variational_energy"},
      upper_(1 + grid.dimensions(), grid.size()),
      residual_(upper_) {
  for (const grids::Axis& axis : grid.axes()) {
    names_.push_back(grid.dimensions() == 1 ? "variational_momentum"
                                            : fmt::format("variational_momentum_{}", axis.name));
  }
}

std::optional<std::vector<LawSize>> VariationalLaws::take(const LatticeLevel& before, const LatticeLevel& after,
                                                          double h) {
  variation_.take(before.fields, after.fields, h, after.slopes);
  variation_.coordinates(LatticeVariation::Side::before, residual_);
  std::vector<LawSize> sizes;
  for (int nu = 0; nu < residual_.fields(); ++nu) {
    const auto residual = residual_.field(nu);
    const auto last = std::as_const(upper_).field(nu);
    for (std::size_t i = 0; i < residual.size(); ++i) {
      residual[i] += last[i];
    }
    sizes.emplace_back().add(grids::max_abs(residual), grids::dot(residual, residual), residual.size());
  }
  variation_.coordinates(LatticeVariation::Side::after, upper_);
  if (!std::exchange(started_, true)) {
    return std::nullopt;
  }
  return sizes;
}

}  // namespace rubato
