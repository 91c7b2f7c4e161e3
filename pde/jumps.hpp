#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/twists.hpp>
#include <rubato/variation/corner_density.hpp>

namespace rubato {

/// The values of a field at the nodes of a grid.
struct FieldOnGrid {
  std::vector<double> values;
  grids::Grid grid;
};

/// Fields that differ from one period to the next by constants J_a, z(x + L_a e_a) = z(x) + J_a, or turn (Twists), by a
/// change of variables that makes them periodic. Of the constants it is
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
/// With both, z = R(x) z~ + c + Σ_a (x_a - from_a) s_a.
///
/// Hypothesis: S(z + J_a) = S(z). Else S~ is not periodic in x, and the seam is an interface between two media.
class Jumps {
public:
  /// No field jumps or turns.
  Jumps() = default;
  /// \param jumps J_a of all fields, one vector for each axis of the grid; none where no field jumps
  /// \throws std::invalid_argument if a field that jumps, or whose mean slope is another's jump, turns
  Jumps(const MultisymplecticSystem& laboratory, const std::vector<grids::Axis>& axes,
        const std::vector<Eigen::VectorXd>& jumps, Twists twists = {});

  [[nodiscard]] bool any() const { return !slopes_.empty() || twists_.any(); }
  /// True if z_f is not z~_f.
  [[nodiscard]] bool has(int field) const { return has_ramp(field) || twists_.partners(field).size() > 1; }
  /// The fields of z~ that z_f is made of, `field` the first.
  [[nodiscard]] std::vector<int> partners(int field) const { return twists_.partners(field); }

  /// The equation of z~; the same system where no field jumps.
  [[nodiscard]] MultisymplecticSystem seen(const MultisymplecticSystem& laboratory) const;
  /// The density of a custom action, of z, as one of z~.
  [[nodiscard]] CornerDensity seen(CornerDensity density) const;
  /// Formulas of the fields and their derivatives, dx(f), dx(dy(f)), which are of z, as those of z~. \param fields
  /// their names
  [[nodiscard]] std::vector<formula::Expression> seen(const std::vector<formula::Expression>& formulas,
                                                      formula::Graph& graph,
                                                      const std::vector<std::string>& fields) const;

  /// c + Σ_a (x_a - from_a) s_a of a field at the nodes of a grid or of a part of it; empty where it is 0.
  [[nodiscard]] std::vector<double> ramp(int field, const grids::Grid& grid) const;
  [[nodiscard]] const Twists& twists() const { return twists_; }
  /// grids::resampled() of fields z_f.
  /// \throws std::invalid_argument as that, and where a field turns with one that is not given on the same nodes
  [[nodiscard]] std::vector<std::vector<double>> resampled(const std::vector<int>& fields,
                                                           const std::vector<FieldOnGrid>& given,
                                                           const grids::Grid& to) const;

private:
  [[nodiscard]] bool has_ramp(int field) const;
  void find_mean(const MultisymplecticSystem& laboratory);
  [[nodiscard]] formula::Expression ramp(int field, formula::Graph& graph) const;
  [[nodiscard]] formula::Expression whole(int field, const std::string& axes, formula::Graph& graph,
                                          const std::vector<std::string>& fields) const;

  std::vector<grids::Axis> axes_;
  std::vector<Eigen::VectorXd> slopes_;
  Twists twists_;
  Eigen::VectorXd mean_;    ///< c
  Eigen::VectorXd linear_;  ///< Σ K_a s_a where c does not take it away
  double constant_ = 0.0;   ///< what c adds to the energy density
};

/// Fields z of periodic z~ at the nodes of one grid, or of a part of it: R(x) z~ and ramps.
class WholeFields {
public:
  WholeFields() = default;
  WholeFields(const Jumps& jumps, const grids::Grid& grid, int fields);

  /// z_f; \param all z~, one field after the other; part of it where they are the same, else valid until the next call.
  [[nodiscard]] std::span<const double> operator()(int field, std::span<const double> all);
  /// z~ of z in its place. \param is_whole of a field: true if `all` has z_f; else it has z~_f, which stays. Fields
  /// that turn together are alike in that.
  void remove(
      std::span<double> all, const std::function<bool(int)>& is_whole = [](int) { return true; }) const;
  /// The largest that a value of z_f is the sum of, beside that of z~_f itself.
  [[nodiscard]] double largest_addend(int field, std::span<const double> all) const;

private:
  Jumps jumps_;
  std::optional<grids::Grid> grid_;
  std::vector<std::vector<double>> ramps_;
  std::vector<bool> turns_;
  std::vector<double> sum_;
};

}  // namespace rubato
