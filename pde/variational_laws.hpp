#pragma once

#include <optional>
#include <string>
#include <vector>

#include <rubato/pde/local_laws.hpp>

namespace rubato {

/// The local laws that varying the place of one node gives (theory, section 5, "Local laws"): at every node of a level
/// between two steps,
///
///     [⟨J^ν_t⟩_k - ⟨J^ν_t⟩_{k-1}] ΔV + Σ_a (⟨h J^ν_a⟩_right - ⟨h J^ν_a⟩_left) ΔV/Δx_a,
///
/// ⟨ ⟩ the mean of the cells on that side of the node: ν = t is the law of energy, whose sum over the nodes is
/// E_k - E_{k-1}; ν = x, … are those of momentum. They vanish to truncation error only.
///
/// For euler-box (Placement::corners) the currents of a cell belong to its base corner, and the laws are its node laws,
/// with e, f, m, g of theory: [e_k - e_{k-1}] ΔV + h Σ_a (f_i - f_{i-1}) ΔV/Δx_a, and so for momentum.
class VariationalLaws {
public:
  VariationalLaws(LocalLaws& laws, const grids::Grid& grid);

  /// "variational_energy", "variational_momentum" (in more dimensions "variational_momentum_x", …).
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }

  /// Takes the next step. Unless it is the first since construction or reset(): the sizes of the residuals at the
  /// level `before`, which residual(law) then holds, one for each node.
  std::optional<std::vector<LawSize>> take(const LatticeLevel& before, const LatticeLevel& after, double h);
  [[nodiscard]] std::span<const double> residual(std::size_t law) const {
    return residual_.field(static_cast<int>(law));
  }
  /// The next step does not follow the last one.
  void reset() { started_ = false; }

private:
  LocalLaws& laws_;
  grids::Grid grid_;
  std::vector<std::string> names_;
  grids::FieldSet currents_, scratch_;
  grids::FieldSet density_, flux_;  ///< of the last step at nodes, ΔV⟨J_t⟩ and its share of the differences of fluxes
  grids::FieldSet residual_;
  bool started_ = false;
};

}  // namespace rubato
