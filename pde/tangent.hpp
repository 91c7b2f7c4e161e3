#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include <rubato/base/outcome.hpp>
#include <rubato/base/state.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/local_laws.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// Carries solutions of a linearised scheme along a run, at frozen levels: for the box M D_t U + Σ K_a D_a Ū = S''(z̄)Ū
/// in every cell, for euler-box (Placement::corners) the derivative of its map.
///
/// As in a level, a field that exists at midpoints only holds its value in the middle of the last step.
class TangentStep {
public:
  /// \throws std::invalid_argument for Placement::nodes (Fourier has no law of two tangents that is local); what
  /// EulerBoxMap refuses
  TangentStep(const MultisymplecticSystem& system, const grids::Grid& grid, Placement placement = Placement::cells);
  ~TangentStep();
  TangentStep(TangentStep&&) noexcept;
  TangentStep& operator=(TangentStep&&) noexcept;

  /// Takes U from the level `before` to `after`, h apart.
  [[nodiscard]] Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h,
                                  const grids::FieldSet& u_before, grids::FieldSet& u_after);

private:
  struct Storage;
  struct Box;
  struct EulerBox;
  std::unique_ptr<Storage> storage_;
};

/// A smooth random tangent: a few long waves of each field with amplitudes of order 1, each of mean 0 (so that the
/// constraint of a potential can be met).
[[nodiscard]] grids::FieldSet random_tangent(const MultisymplecticSystem& system, const grids::Grid& grid,
                                             std::uint64_t seed);

/// Two random tangent solutions and their multisymplectic residual along a run, in the form that belongs to the laws'
/// placement.
class TangentPair {
public:
  /// Starts from random_tangent(system, grid, seed) and of seed + 1. Keeps a reference to `laws`.
  /// \throws std::invalid_argument as TangentStep
  TangentPair(LocalLaws& laws, const MultisymplecticSystem& system, const grids::Grid& grid, std::uint64_t seed);

  /// Takes the step from `before` to `after`, which follows the one taken last. If it fails, nothing has changed.
  [[nodiscard]] Status take(const LatticeLevel& before, const LatticeLevel& after, double h);
  /// The size of the residual over the step taken last; nothing before the first, and for euler-box, whose law at a
  /// node needs three levels, before the second.
  [[nodiscard]] const std::optional<Spread>& residual() const { return residual_; }

  [[nodiscard]] const grids::FieldSet& u() const { return u_.now; }
  [[nodiscard]] const grids::FieldSet& v() const { return v_.now; }

  /// All that continuing bit for bit needs. After restore() residual() is empty until the next step.
  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Tangent {
    grids::FieldSet now, next, earlier;
  };
  LocalLaws& laws_;
  TangentStep step_;
  Tangent u_, v_;
  std::uint64_t steps_ = 0;
  std::optional<Spread> residual_;
};

}  // namespace rubato
