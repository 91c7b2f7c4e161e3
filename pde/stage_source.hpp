#pragma once

#include <rubato/base/outcome.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/pde/initial_level.hpp>

namespace rubato {

/// The stages of a step: a quadrature of the slab between two levels, at whose nodes the scheme's equation holds. Laws
/// that integrate fluxes over a step take them there.
class StageSource {
public:
  virtual ~StageSource() = default;

  /// The step from `before` to `after`, h apart; by what a run has just solved, if it is that step, else solved anew.
  [[nodiscard]] virtual Status take(const LatticeLevel& before, const LatticeLevel& after, double h) = 0;
  [[nodiscard]] virtual int count() const = 0;
  [[nodiscard]] virtual double weight(int stage) const = 0;
  /// Z_i and Ż_i; fields without equation of motion have rate 0.
  virtual void stage(int stage, grids::FieldSet& z, grids::FieldSet& rate) = 0;
};

}  // namespace rubato
