#include <rubato/pde/variational_laws.hpp>

#include <algorithm>
#include <utility>

#include <rubato/grids/arrays.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/law_evaluator.hpp>

namespace rubato {

VariationalLaws::VariationalLaws(LatticeAction action, const grids::Grid& grid)
    : variation_(std::move(action), grid),
      names_{"variational_energy"},
      parts_(1 + grid.dimensions(), grid.size()),
      residual_(parts_.after) {
  for (int a = 0; a < grid.dimensions(); ++a) {
    const bool balance = std::ranges::find(variation_.action().places, a, &LatticeAction::Place::axis) !=
                         variation_.action().places.end();
    names_.push_back("variational_" + momentum_name(balance, grid, a));
  }
}

std::optional<std::vector<Spread>> VariationalLaws::take(const LatticeLevel& before, const LatticeLevel& after,
                                                         double h, LatticeVariation* taken) {
  residual_.copy_from(parts_.after);  // of the last step
  if (taken == nullptr) {
    taken = &variation_;
    taken->take(before.fields, after.fields, h, after.slopes);
  }
  taken->coordinates(parts_);
  for (int nu = 0; nu < residual_.fields(); ++nu) {
    grids::add(1.0, std::as_const(parts_.before).field(nu), residual_.field(nu));
  }
  std::vector<Spread> sizes = grids::magnitudes(residual_);
  if (!std::exchange(started_, true)) {
    return std::nullopt;
  }
  return sizes;
}

}  // namespace rubato
