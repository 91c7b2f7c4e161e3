#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/corner_density.hpp>

namespace rubato {

/// Fields that differ by constants J_a from one period to the next, z(x + L_a e_a) = z(x) + J_a, by a change of
/// variables that makes them periodic:
///
///     z = z~ + c + Σ_a (x_a - from_a) s_a,   s_a = J_a/L_a,
///     M z~_t + Σ_a K_a z~_{x_a} = ∇S~(z~, x),   S~ = S(z) - z~ᵀ Σ_a K_a s_a
///
/// Differences and the spectral derivative of a ramp are its slope to rounding, and so are means of it; so each scheme
/// makes of z~ what it would make of z with the jump put in at the seam. The constant c is of algebraic fields, the
/// mean slopes of others (w = u_x): with it S~ has no linear term where S is quadratic in these, and waves stay waves.
/// Energy and its density are those of z. The laws of momentum are those of z, too (MultisymplecticSystem::Ramps), and
/// so is the momentum, P~ - Σ ΔV s_aᵀM z~.
///
/// Hypothesis: S(z + J_a) = S(z). Else S~ is not periodic in x, and the seam is an interface between two media.
class Jumps {
public:
  /// No field jumps.
  Jumps() = default;
  /// \param jumps J_a of all fields, one vector for each axis of the grid
  Jumps(const MultisymplecticSystem& laboratory, const std::vector<grids::Axis>& axes,
        const std::vector<Eigen::VectorXd>& jumps);

  [[nodiscard]] bool any() const { return !slopes_.empty(); }
  /// Whether z_f is not z~_f.
  [[nodiscard]] bool has(int field) const;

  /// The equation of z~; the same system where no field jumps.
  [[nodiscard]] MultisymplecticSystem seen(const MultisymplecticSystem& laboratory) const;
  /// The density of a custom action, of z, as one of z~.
  [[nodiscard]] CornerDensity seen(CornerDensity density) const;
  /// Formulas of the fields and their first derivatives, dx(f), which are of z, as those of z~. \param fields their
  /// names
  [[nodiscard]] std::vector<formula::Expression> seen(const std::vector<formula::Expression>& formulas,
                                                      formula::Graph& graph,
                                                      const std::vector<std::string>& fields) const;

  /// z_f - z~_f at the nodes of a grid or of a part of it; empty where has() is false.
  [[nodiscard]] std::vector<double> ramp(int field, const grids::Grid& grid) const;
  /// z~_f into z_f, and back.
  ///@{
  void add(int field, const grids::Grid& grid, std::span<double> values) const;
  void subtract(int field, const grids::Grid& grid, std::span<double> values) const;
  ///@}
  /// grids::resampled() of z_f. \throws std::invalid_argument as that
  [[nodiscard]] std::vector<double> resampled(int field, std::vector<double> values, const grids::Grid& from,
                                              const grids::Grid& to) const;

private:
  [[nodiscard]] formula::Expression ramp(int field, formula::Graph& graph) const;

  std::vector<grids::Axis> axes_;
  std::vector<Eigen::VectorXd> slopes_;
  Eigen::VectorXd mean_;    ///< c
  Eigen::VectorXd linear_;  ///< Σ K_a s_a where c does not take it away
  double constant_ = 0.0;   ///< what c adds to the energy density
};

/// Fields at the nodes of one grid, or of a part of it, with the ramps that levels are without.
class WithRamps {
public:
  WithRamps() = default;
  WithRamps(const Jumps& jumps, const grids::Grid& grid, int fields);

  /// z_f of z~_f; `values` itself where the field does not jump, else valid until the next call.
  [[nodiscard]] std::span<const double> operator()(int field, std::span<const double> values);
  /// z~_f of z_f.
  void remove(int field, std::span<double> values) const;
  /// z_f - z~_f; empty where the field does not jump.
  [[nodiscard]] std::span<const double> ramp(int field) const { return ramps_[static_cast<std::size_t>(field)]; }

private:
  std::vector<std::vector<double>> ramps_;
  std::vector<double> sum_;
};

}  // namespace rubato
