#pragma once

#include <memory>
#include <span>

#include <rubato/grids/fourier.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>

namespace rubato {

/// Derivatives at the nodes in densities and fluxes of local laws, by collocation: ∂ (Collocation::nodes), or the
/// backward difference δ⁻ (Collocation::corners).
///
/// For M z_t + Σ_a (K₊δ_a⁺ - K₊ᵀδ_a⁻) z = ∇S(z) the laws of energy and of a linear symmetry B (with K₊B skew in the
/// sense K₊B = -BᵀK₊) hold exactly at every node while time is continuous, with z⁺ the neighbour along a:
///
///     ∂_t[S + Σ_a (δ_a⁻z)ᵀK₊z] - Σ_a δ_a⁻[z_tᵀK₊z⁺] = 0,      ∂_t[½ zᵀMBz] + Σ_a δ_a⁻[zᵀK₊Bz⁺] = 0.
class NodeDerivative {
public:
  /// \throws std::invalid_argument for Collocation::cells
  NodeDerivative(const grids::Grid& grid, Collocation collocation);

  [[nodiscard]] bool one_sided() const { return spectral_ == nullptr; }
  /// out = D_a in; in and out may be the same.
  void operator()(int axis, const double* in, double* out);
  void operator()(int axis, std::span<const double* const> in, std::span<double* const> out);
  /// out_i = in_{i+1} along the axis; they may not be the same.
  void next(int axis, const double* in, double* out) const;

private:
  grids::Grid grid_;
  std::unique_ptr<grids::SpectralDerivative> spectral_;
  grids::FieldSet scratch_;
};

}  // namespace rubato
