#include <rubato/pde/variational_laws.hpp>

#include <utility>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>

namespace rubato {

VariationalLaws::VariationalLaws(LatticeAction action, const grids::Grid& grid)
    : variation_(std::move(action), grid),
      names_{"variational_energy"},
      parts_(1 + grid.dimensions(), grid.size()),
      residual_(parts_.after) {
  for (const grids::Axis& axis : grid.axes()) {
    names_.push_back(grid.dimensions() == 1 ? "variational_momentum"
                                            : fmt::format("variational_momentum_{}", axis.name));
  }
}

std::optional<std::vector<Spread>> VariationalLaws::take(const LatticeLevel& before, const LatticeLevel& after,
                                                         double h) {
  residual_.copy_from(parts_.after);  // of the last step
  variation_.take(before.fields, after.fields, h, after.slopes);
  variation_.coordinates(parts_);
  std::vector<Spread> sizes;
  for (int nu = 0; nu < residual_.fields(); ++nu) {
    const auto residual = residual_.field(nu);
    const auto next = std::as_const(parts_.before).field(nu);
    for (std::size_t i = 0; i < residual.size(); ++i) {
      residual[i] += next[i];
    }
    sizes.push_back(grids::magnitudes(residual));
  }
  if (!std::exchange(started_, true)) {
    return std::nullopt;
  }
  return sizes;
}

}  // namespace rubato
