#pragma once

#include <memory>
#include <utility>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// The stages of a step: a quadrature of the slab between two levels, at whose nodes the scheme's equation holds. Laws
/// that integrate fluxes over a step take them there. The levels themselves may be points of it, too.
class StageSource {
public:
  virtual ~StageSource() = default;

  /// The step from `before` to `after`, h apart; by what a run has just solved, if it is that step, else solved anew.
  [[nodiscard]] virtual Status take(const LatticeLevel& before, const LatticeLevel& after, double h) = 0;
  [[nodiscard]] virtual int count() const = 0;
  [[nodiscard]] virtual double weight(int stage) const = 0;
  /// Z_i and Ż_i; fields without equation of motion have rate 0, and so may fields whose rates are not asked for.
  virtual void stage(int stage, grids::FieldSet& z, grids::FieldSet& rate) = 0;

  /// The weight of each of the two levels, and ż at one by the equation; 0: they are none.
  ///@{
  [[nodiscard]] virtual double end_weight() const { return 0.0; }
  virtual void rates_at(const LatticeLevel& /*level*/, grids::FieldSet& /*rate*/) {}
  ///@}

  /// From now on rates of these fields alone are asked for; before, of all.
  virtual void ask_rates_of(const std::vector<bool>& /*fields*/) {}
};

/// Where the fluxes of a step are taken: at its stages, or at its middle.
class StepPoints {
public:
  StepPoints(const MultisymplecticSystem& system, const grids::Grid& grid, std::shared_ptr<StageSource> stages);

  void share(std::shared_ptr<StageSource> stages) {
    stages_ = std::move(stages);
    ask_rates_of(asked_);
  }
  /// See StageSource; the rates of others are then not to be read.
  void ask_rates_of(const std::vector<bool>& fields) {
    asked_ = fields;
    if (stages_ != nullptr && !asked_.empty()) {
      stages_->ask_rates_of(asked_);
    }
  }
  [[nodiscard]] const StageSource* stages() const { return stages_.get(); }

  /// Calls use(weight) for every stage of a step between the levels, with the stage in z() and rate(), or once for its
  /// middle; where the stages cannot be found, z() is not a number, so that no law passes for one that held.
  template <typename Use>
  void for_each(const LatticeLevel& before, const LatticeLevel& after, double h, Use&& use) {
    const bool known = take(before, after, h);
    for (int i = 0; i < (stages_ == nullptr ? 1 : stages_->count()); ++i) {
      use(place(i, known));
    }
  }
  /// z̄ and D_t z of a step at the nodes; fields at midpoints have the value that `after` holds, and no D_t.
  void take_middle(const grids::FieldSet& before, const grids::FieldSet& after, double h);

  [[nodiscard]] double end_weight() const { return stages_ == nullptr ? 0.0 : stages_->end_weight(); }
  /// ż at a level into rate().
  void take_rates(const LatticeLevel& level) { stages_->rates_at(level, rate_); }

  [[nodiscard]] const grids::FieldSet& z() const { return z_; }
  [[nodiscard]] const grids::FieldSet& rate() const { return rate_; }

private:
  [[nodiscard]] bool take(const LatticeLevel& before, const LatticeLevel& after, double h);
  double place(int stage, bool known);

  std::vector<bool> at_midpoints_, asked_;
  std::shared_ptr<StageSource> stages_;
  grids::FieldSet z_, rate_;
};

}  // namespace rubato
