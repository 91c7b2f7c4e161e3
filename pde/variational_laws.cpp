#include <rubato/pde/variational_laws.hpp>

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/reductions.hpp>

namespace rubato {

namespace {

int square(int n) {
  return n * n;
}

}  // namespace

VariationalLaws::VariationalLaws(LocalLaws& laws, const grids::Grid& grid)
    : laws_(laws),
      grid_(grid),
      names_{"variational_energy"},
      currents_(square(1 + grid.dimensions()), grid.size()),
      scratch_(1, grid.size()),
      density_(1 + grid.dimensions(), grid.size()),
      flux_(density_),
      residual_(density_) {
  for (int a = 0; a < grid.dimensions(); ++a) {
    names_.push_back(grid.dimensions() == 1 ? "variational_momentum"
                                            : fmt::format("variational_momentum_{}", grid.axis(a).name));
  }
}

std::optional<std::vector<LawSize>> VariationalLaws::take(const LatticeLevel& before, const LatticeLevel& after,
                                                          double h) {
  const int n = 1 + grid_.dimensions();
  laws_.cell_currents(before, after, h, currents_.pointers());
  const double volume = grid_.cell_volume();
  const bool corners = laws_.placement() == Placement::corners;
  grids::BoxOperator mean{grids::Along::identity, grids::Along::identity, grids::Along::identity};
  for (int a = 0; a < grid_.dimensions() && !corners; ++a) {
    mean[static_cast<std::size_t>(a)] = grids::Along::average;
  }
  // The node's fluxes are means of the steps before and after; those of a base corner are of the step after alone.
  const double share = corners ? 1.0 : 0.5;
  std::vector<LawSize> sizes;
  for (int nu = 0; nu < n; ++nu) {
    const auto residual = residual_.field(nu);
    const auto density = density_.field(nu);
    const auto flux = flux_.field(nu);
    const auto scratch = scratch_.field(0);
    for (std::size_t i = 0; i < residual.size(); ++i) {
      residual[i] = (1.0 - share) / share * flux[i] - density[i];  // of the last step
    }
    grids::apply_adjoint(grid_, mean, currents_.field(nu * n).data(), density.data());
    for (double& value : density) {
      value *= volume;
    }
    std::ranges::fill(flux, 0.0);
    for (int a = 0; a < grid_.dimensions(); ++a) {
      grids::BoxOperator across = mean;
      across[static_cast<std::size_t>(a)] = grids::Along::difference;
      grids::apply_adjoint(grid_, across, currents_.field(nu * n + 1 + a).data(), scratch.data());
      for (std::size_t i = 0; i < flux.size(); ++i) {
        flux[i] -= share * h * volume * scratch[i];
      }
    }
    for (std::size_t i = 0; i < residual.size(); ++i) {
      residual[i] += density[i] + flux[i];
    }
    LawSize size;
    size.add(grids::max_abs(residual), grids::dot(residual, residual), residual.size());
    sizes.push_back(size);
  }
  if (!std::exchange(started_, true)) {
    return std::nullopt;
  }
  return sizes;
}

}  // namespace rubato
