#include <rubato/pde/stated_action.hpp>

#include <algorithm>
#include <array>
#include <utility>

#include <rubato/formula/sum.hpp>
#include <rubato/variation/random_values.hpp>

namespace rubato {

namespace {

using formula::Expression;

bool is_symmetric_in_time(const CornerDensity& density) {
  std::vector<Expression> from = density.corners, to;
  const int half = density.corner_count() / 2;
  for (int f = 0; f < density.fields; ++f) {
    for (int c = 0; c < density.corner_count(); ++c) {
      to.push_back(density.corner(f, (c + half) % density.corner_count()));
    }
  }
  from.push_back(density.spacings.front());
  to.push_back(-density.spacings.front());
  const Expression back = formula::substitute(density.L, from, to);
  return vanishes_at_random(density.L - back, std::array{density.L, back});
}

}  // namespace

bool StatedAction::names(int field) const {
  return std::ranges::find(action.values, field, &LatticeAction::Value::field) != action.values.end();
}

StatedAction state_action(const MultisymplecticSystem& system, CornerDensity density,
                          std::shared_ptr<const WallDrives> drives) {
  const bool is_symmetric = is_symmetric_in_time(density);
  density.L = formula::separate_constant(density.L).rest;
  return {.action = corner_action(density, system.structure().at_midpoints(), system.structure().potential),
          .is_symmetric = is_symmetric,
          .cell_equations = cell_equations(density),
          .drives = std::move(drives)};
}

std::vector<double> typical_values(const LatticeLevel& level) {
  std::vector<double> values;
  for (int f = 0; f < level.fields.fields(); ++f) {
    values.push_back(level.fields.field(f)[level.fields.size() / 3]);
  }
  return values;
}

}  // namespace rubato
