#include <rubato/pde/variational_laws.hpp>

#include <algorithm>
#include <utility>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/law_evaluator.hpp>

namespace rubato {

VariationalLaws::VariationalLaws(LatticeAction action, const MultisymplecticSystem& system, const grids::Grid& grid)
    : variation_(std::move(action), grid), names_{"variational_energy"}, residual_(1 + grid.dimensions(), grid.size()) {
  for (int a = 0; a < grid.dimensions(); ++a) {
    names_.push_back("variational_" + momentum_name(system.has_source(a), grid, a));
  }
}

std::optional<std::vector<Spread>> VariationalLaws::take(const LatticeLevel& before, const LatticeLevel& after,
                                                         double h) {
  const bool follows = std::exchange(started_, true);
  variation_.take(before.fields, after.fields, h, after.slopes, follows);
  if (!follows) {
    return std::nullopt;
  }
  variation_.between(residual_);
  return grids::magnitudes(residual_);
}

}  // namespace rubato
