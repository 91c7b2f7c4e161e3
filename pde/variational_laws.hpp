#pragma once

#include <optional>
#include <string>
#include <vector>

#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/local_laws.hpp>
#include <rubato/variation/coordinate_variation.hpp>

namespace rubato {

/// The local laws that varying the place of one node gives (theory, section 5, "Local laws"): at every node of a level
/// between two steps, with the currents J^ν_ρ of the action,
///
///     ∂𝕊/∂x^ν(node) = -Σ_ρ D_ρᵀ h ΔV J^ν_ρ,  the sum over both steps:
///
/// ν = t is the law of energy, whose sum over the nodes is E_k - E_{k-1}: [⟨e⟩_k - ⟨e⟩_{k-1}]Δx + ⟨h f⟩_right -
/// ⟨h f⟩_left for the box, ⟨ ⟩ the mean of the cells on that side of the node, and without means for euler-box. ν = x,
/// … are those of momentum, with its source where the action names x. They vanish to truncation error only.
class VariationalLaws {
public:
  /// \throws std::invalid_argument if the dimensions of action and grid differ
  VariationalLaws(LatticeAction action, const MultisymplecticSystem& system, const grids::Grid& grid);

  /// "variational_energy", and "variational_" before each momentum_name().
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }

  /// Takes the next step. Unless it is the first since construction or reset(): the sizes of the residuals at the
  /// level `before`, which residual(law) then holds, one for each node.
  std::optional<std::vector<Spread>> take(const LatticeLevel& before, const LatticeLevel& after, double h);
  [[nodiscard]] std::span<const double> residual(std::size_t law) const {
    return residual_.field(static_cast<int>(law));
  }
  /// The next step does not follow the last one.
  void reset() { started_ = false; }

private:
  CoordinateVariation variation_;
  std::vector<std::string> names_;
  grids::FieldSet residual_;
  bool started_ = false;
};

}  // namespace rubato
