#include <rubato/pde/lattice_between.hpp>

#include <cmath>
#include <limits>
#include <utility>

#include <rubato/grids/reductions.hpp>

namespace rubato {

LatticeBetween::LatticeBetween(const LatticeMethod& method, const MultisymplecticSystem& system,
                               const grids::Grid& grid, const LatticeLevel& first, double first_step)
    : scheme_(method.scheme(system.without_constant(), grid, first, first_step)), result_(first) {}

Status LatticeBetween::take(const LatticeLevel& level, const LatticeLevel& next, double t, double h, double fraction) {
  if (fraction == 0.0 || fraction == 1.0) {
    result_.fields.copy_from(fraction == 0.0 ? level.fields : next.fields);
    return Status::success;
  }
  scheme_->stand(level, next, h);
  scheme_->set_time(t);
  Status status = scheme_->advance(fraction * h, 0.0);
  if (status == Status::success) {
    scheme_->accept();
    result_.fields.copy_from(scheme_->level().fields);
    status = std::isfinite(grids::max_abs(std::as_const(result_.fields).all())) ? status : Status::undefined;
  }
  if (status != Status::success) {
    result_.fields.fill(std::numeric_limits<double>::quiet_NaN());
  }
  return status;
}

}  // namespace rubato
