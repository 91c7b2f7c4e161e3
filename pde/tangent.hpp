#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/base/status.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/local_laws.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/space_collocation.hpp>

namespace rubato {

/// Carries solutions of a linearised scheme along a run, at frozen levels.
///
/// As in a level, a field that exists at midpoints only holds its value in the middle of the last step.
class TangentStep {
public:
  virtual ~TangentStep() = default;

  /// Takes U from the level `before` to `after`, h apart.
  [[nodiscard]] virtual Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h,
                                          const grids::FieldSet& u_before, grids::FieldSet& u_after) = 0;
  /// The stages of the step taken last, at the nodes, where the law of two solutions integrates its fluxes over them.
  [[nodiscard]] virtual std::span<const grids::FieldSet> stages() const { return {}; }
  /// True if the local law of two solutions reads the level before the step, too.
  [[nodiscard]] virtual bool law_on_three_levels() const { return false; }
};

/// Of the box: M D_t U + Σ K_a D_a Ū = S''(z̄)Ū in every cell.
[[nodiscard]] std::unique_ptr<TangentStep> make_box_tangents(const MultisymplecticSystem& system,
                                                             const grids::Grid& grid);
/// Where parts of ranks that share a line have to begin for box tangents, as LatticeMethod::parts(): they are solved
/// for all fields, steps for fewer, and the chunks of the elimination are shorter where more than four are solved for.
[[nodiscard]] std::vector<std::size_t> box_tangent_parts(const MultisymplecticSystem& system, const grids::Grid& whole,
                                                         int ranks);
/// Of Gauss collocation on cells: M U̇_i + Σ K_a ∂_a U_i = S''(Z_i)U_i at every point of every stage.
[[nodiscard]] std::unique_ptr<TangentStep> make_gauss_tangents(const MultisymplecticSystem& system,
                                                               const grids::Grid& grid, int stages, SpaceRule space);
/// Of euler-box: the derivative of its map. \throws std::invalid_argument as EulerBoxMap
[[nodiscard]] std::unique_ptr<TangentStep> make_euler_box_tangents(const MultisymplecticSystem& system,
                                                                   const grids::Grid& grid);

/// A smooth random tangent: a few long waves of each field with amplitudes of order 1, each of mean 0 (so that the
/// constraint of a potential can be met).
[[nodiscard]] grids::FieldSet random_tangent(const MultisymplecticSystem& system, const grids::Grid& grid,
                                             std::uint64_t seed);

/// Two random tangent solutions and their multisymplectic residual along a run, in the form that the laws have it.
class TangentPair {
public:
  /// Starts from random_tangent(system, grid, seed) and of seed + 1. Keeps a reference to `laws`; `step` is of the same
  /// scheme.
  TangentPair(LocalLaws& laws, std::unique_ptr<TangentStep> step, const MultisymplecticSystem& system,
              const grids::Grid& grid, std::uint64_t seed);

  /// Takes the step from `before` to `after`, which follows the one taken last. If it fails, nothing has changed.
  [[nodiscard]] Status take(const LatticeLevel& before, const LatticeLevel& after, double h);
  /// The size of the residual over the step taken last; nothing before the first, and where a law reads three
  /// levels, before the second.
  [[nodiscard]] const std::optional<Spread>& residual() const { return residual_; }

  [[nodiscard]] const grids::FieldSet& u() const { return u_.now; }
  [[nodiscard]] const grids::FieldSet& v() const { return v_.now; }

  /// All that continuing bit for bit needs. After restore() residual() is empty until the next step.
  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Tangent {
    grids::FieldSet now, next, earlier;
    std::vector<grids::FieldSet> stages;
  };
  LocalLaws& laws_;
  std::unique_ptr<TangentStep> step_;
  Tangent u_, v_;
  std::uint64_t steps_ = 0;
  std::optional<Spread> residual_;
};

}  // namespace rubato
