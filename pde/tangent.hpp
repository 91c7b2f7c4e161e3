#pragma once

#include <cstdint>
#include <memory>

#include <rubato/base/outcome.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// Carries solutions of the linearised box scheme along a run, at frozen levels: in every cell
/// M D_t U + Σ K_a D_a Ū = S''(z̄)Ū. Two of them make the multisymplectic residual, LocalLaws::multisymplectic_residual.
///
/// As in a level, a field that exists at midpoints only holds its value in the middle of the last step.
class TangentStep {
public:
  TangentStep(const MultisymplecticSystem& system, const grids::Grid& grid);
  ~TangentStep();
  TangentStep(TangentStep&&) noexcept;
  TangentStep& operator=(TangentStep&&) noexcept;

  /// Takes U from the level `before` to `after`, h apart.
  [[nodiscard]] Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h,
                                  const grids::FieldSet& u_before, grids::FieldSet& u_after);

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

/// A smooth random tangent: a few long waves of each field with amplitudes of order 1, each of mean 0 (so that the
/// constraint of a potential can be met).
[[nodiscard]] grids::FieldSet random_tangent(const MultisymplecticSystem& system, const grids::Grid& grid,
                                             std::uint64_t seed);

}  // namespace rubato
