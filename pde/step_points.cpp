#include <limits>

#include <rubato/grids/parallel.hpp>
#include <rubato/pde/stage_source.hpp>

namespace rubato {

StepPoints::StepPoints(const MultisymplecticSystem& system, const grids::Grid& grid,
                       std::shared_ptr<StageSource> stages)
    : at_midpoints_(system.structure().at_midpoints()),
      stages_(std::move(stages)),
      z_(system.field_count(), grid.size()),
      rate_(z_) {}

void StepPoints::take_middle(const grids::FieldSet& before, const grids::FieldSet& after, double h) {
  for (int f = 0; f < z_.fields(); ++f) {
    const double* z_0 = before.field(f).data();
    const double* z_1 = after.field(f).data();
    double* m = z_.field(f).data();
    double* r = rate_.field(f).data();
    const bool midpoint = at_midpoints_[static_cast<std::size_t>(f)];
    grids::for_each_block(z_.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        m[i] = midpoint ? z_1[i] : 0.5 * (z_0[i] + z_1[i]);
        r[i] = midpoint ? 0.0 : (z_1[i] - z_0[i]) / h;
      }
    });
  }
}

bool StepPoints::take(const LatticeLevel& before, const LatticeLevel& after, double h) {
  if (stages_ != nullptr) {
    return stages_->take(before, after, h) == Status::success;
  }
  take_middle(before.fields, after.fields, h);
  return true;
}

/// \return the stage's weight
double StepPoints::place(int stage, bool known) {
  if (stages_ == nullptr) {
    return 1.0;
  }
  if (known) {
    stages_->stage(stage, z_, rate_);
  } else {
    z_.fill(std::numeric_limits<double>::quiet_NaN());
  }
  return stages_->weight(stage);
}

}  // namespace rubato
