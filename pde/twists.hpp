#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// exp(dG) of a matrix G whose eigenvalues ±iω are imaginary and have a basis of eigenvectors:
///
///     exp(dG) = P_0 + Σ_ω [cos(ωd) P_ω + sin(ωd)/ω G P_ω],
///
/// P_ω the projection on the eigenvectors of ±iω, a polynomial in G².
class Rotation {
public:
  /// \throws std::invalid_argument if G is no such matrix
  explicit Rotation(const Eigen::MatrixXd& G);

  /// The ω > 0, ascending.
  [[nodiscard]] const std::vector<double>& frequencies() const { return frequencies_; }
  /// exp(dG).
  [[nodiscard]] Eigen::MatrixXd operator()(double d) const;
  /// Row `row` of exp(dG) as formulas of d.
  [[nodiscard]] std::vector<formula::Expression> row(Eigen::Index row, formula::Expression d,
                                                     formula::Graph& graph) const;

private:
  std::vector<double> frequencies_;
  Eigen::MatrixXd still_;                       ///< P_0
  std::vector<Eigen::MatrixXd> cosine_, sine_;  ///< P_ω, GP_ω/ω
};

/// The fields that matrices G_a mix with a field, itself the first.
[[nodiscard]] std::vector<int> mixed_fields(const std::vector<Eigen::MatrixXd>& G, int field);

/// Fields that turn from one period of an axis to the next, z(x + L_a e_a) = exp(L_a G_a) z(x), by a change of
/// variables that makes them periodic (theory, section 11.1):
///
///     z = R(x) z~,  R(x) = exp(Σ_a (x_a - from_a) G_a),
///     M z~_t + Σ_a K_a z~_{x_a} = ∇S~(z~, x),   S~ = S - ½ z~ᵀ Σ_a K_a G_a z~
///
/// Hypotheses: the G_a are multiples of linear symmetries (check_symmetry()) and commute.
class Twists {
public:
  /// No field turns.
  Twists() = default;
  /// \param rates G_a, one for each axis
  /// \throws std::invalid_argument as Rotation
  Twists(std::vector<grids::Axis> axes, std::vector<Eigen::MatrixXd> rates);

  [[nodiscard]] bool any() const { return !rates_.empty(); }
  /// G_a; none where no field turns.
  [[nodiscard]] const std::vector<Eigen::MatrixXd>& rates() const { return rates_; }
  /// The fields of z~ that z_f is made of, `field` the first.
  [[nodiscard]] std::vector<int> partners(int field) const { return mixed_fields(rates_, field); }

  /// ½ zᵀ Σ_a K_a G_a z.
  [[nodiscard]] formula::Expression quadratic(const MultisymplecticSystem& system) const;
  /// exp(Σ_a d_a G_a).
  [[nodiscard]] Eigen::MatrixXd turn(std::span<const double> d) const;
  /// Row `field` of exp(Σ_a d_a G_a) as formulas; d_a = 0 where it is no valid expression.
  [[nodiscard]] std::vector<formula::Expression> row(int field, std::span<const formula::Expression> d,
                                                     formula::Graph& graph) const;
  /// The same of R(x), of the coordinates.
  [[nodiscard]] std::vector<formula::Expression> row(int field, formula::Graph& graph) const;
  /// Row `field` of R(x) z~ at the nodes, or of R(x)⁻¹ z. \param all the fields, one after the other
  void apply(bool inverse, int field, const grids::Grid& grid, std::span<const double> all,
             std::span<double> out) const;

private:
  std::vector<grids::Axis> axes_;
  std::vector<Eigen::MatrixXd> rates_;
  std::vector<Rotation> rotations_;
};

}  // namespace rubato
