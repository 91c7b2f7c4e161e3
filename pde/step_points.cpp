#include <algorithm>
#include <limits>

#include <rubato/grids/arrays.hpp>
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
    const auto z_0 = before.field(f), z_1 = after.field(f);
    if (at_midpoints_[static_cast<std::size_t>(f)]) {
      std::copy_n(z_1.data(), z_1.size(), z_.field(f).data());
      std::ranges::fill(rate_.field(f), 0.0);
    } else {
      grids::combine(0.5, z_0, 1.0, z_1, z_.field(f));
      grids::difference_quotient(z_1, z_0, h, rate_.field(f));
    }
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
