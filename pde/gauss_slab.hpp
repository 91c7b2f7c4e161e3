#pragma once

#include <complex>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/outcome.hpp>
#include <rubato/base/state.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/pde/stage_loops.hpp>
#include <rubato/pde/stage_source.hpp>
#include <rubato/pde/wave_resolvent.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// One step of Gauss collocation in time (theory, sections 8.1 and 8.3), and in space spectral or collocated, too
/// (SpaceCollocation): with the stages Z_i = z_k + Y_i, Y_i = h Σ_j a_ij Ż_j,
///
///     M Ż_i + Σ_a K_a ∂_a Z_i = ∇S(Z_i)  at every point,      E_k = Σ_i b_i Σ ΔV [S(Z_i) + Σ_a (∂_a Z_i)ᵀK₊Z_i].
///
/// Levels and stages are given and told at the nodes; within, rows of waves are of the values at the points.
/// A field in ker M has stage values alone, and so have constraints: they hold at the stages. S is taken apart into a
/// quadratic part with constant coefficients L (where S'' varies, its mean at the first level counts) and the rest N,
/// a function of the fields F that S'' varies with. Then
///
///     (A⁻¹/h ⊗ M + I ⊗ (Σ ik_a K_a - L)) Ŷ = [L - Σ ik_a K_a] ẑ_k + N̂'(Z_F)
///
/// is solved exactly on every wave, A⁻¹ brought to its eigenvalues, and iterated on N' alone: a fixed point whose
/// contraction does not depend on Δx, and which costs one transform there and one back of each field of F at each
/// stage, whatever the number of fields.
class GaussSlab final : public StageSource {
public:
  /// `first`: a level of the run, for the mean of S''. \throws std::invalid_argument if stages are not 1 … 8, or as
  /// SpaceCollocation
  GaussSlab(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, const LatticeLevel& first,
            SpaceRule space = {});

  /// The level z = high + low that steps are taken from; fields at midpoints count as 0. `low` may be null.
  void stand(const grids::FieldSet& high, const grids::FieldSet* low, const PotentialSlopes& slopes);
  /// Changes with every stand().
  [[nodiscard]] std::uint64_t stamp() const { return stamp_; }

  /// From now on steps are those of tangent solutions at a fixed h, S'' taken at the stages of the step that `about`,
  /// made of the same arguments, has just solved. Energies are then none.
  void linearise(const GaussSlab& about);

  /// Where the iteration begins: with N' of the level at all stages, or with N' of another step's stages, continued as
  /// a polynomial to a step `ratio` times as long, which begins where that one begins or ends.
  ///@{
  void begin_at_level();
  void continue_from(const WaveRows& rests, double ratio, bool at_its_end);
  ///@}
  /// `largest`: the largest increment of each field so far, beside which corrections are judged. `steady`: whether
  /// steps of this length are to be expected, so that matrices for them are made and kept where they are small.
  [[nodiscard]] Status solve(double h, double accuracy, std::span<const double> largest, bool steady = false);
  [[nodiscard]] int iterations() const { return iterations_; }  ///< since construction

  /// Of the step solved last.
  ///@{
  [[nodiscard]] double energy();           ///< E_k
  [[nodiscard]] double energy_at_end();    ///< 𝓔 of the level it leads to
  void increment(grids::FieldSet& delta);  ///< z_{k+1} - z_k; of fields at midpoints twice their value there
  [[nodiscard]] const WaveRows& rests() const { return rest_; }  ///< N̂', row f·m + i
  ///@}

  [[nodiscard]] Status take(const LatticeLevel& before, const LatticeLevel& after, double h) override;
  [[nodiscard]] int count() const override { return m_; }
  [[nodiscard]] double weight(int stage) const override { return tableau_.b[stage]; }
  void stage(int stage, grids::FieldSet& z, grids::FieldSet& rate) override;

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  void find_varying_fields();
  void set_mean(const LatticeLevel& first);
  void compile();
  void add_slopes(const PotentialSlopes& slopes);
  [[nodiscard]] bool prepare(double h);
  void invert(double h);
  void make_maps();
  [[nodiscard]] bool by_maps() const { return steady_ && !base_map_.empty(); }
  struct Correction {
    double size = 0.0;      ///< relative to the increments
    double rounding = 0.0;  ///< the size that rounding explains
  };
  void iterate_waves();
  [[nodiscard]] Correction place_stages(std::span<const double> largest);
  void evaluate_rests();
  void multiply_by_curvature();
  void complete();
  void end_rows();
  [[nodiscard]] double wave_energy(const WaveRows& rows, int stride, int offset) const;
  [[nodiscard]] double rest_energy(std::span<const double* const> fields);
  [[nodiscard]] int varying(int f, int i) const { return f * m_ + i; }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  GaussTableau tableau_;
  int m_, d_;
  std::vector<bool> at_midpoints_;
  std::vector<int> F_;  ///< fields that S'' varies with, or whose ∂S/∂z_f names a coordinate
  Eigen::MatrixXd L_;
  Eigen::VectorXd linear_;  ///< of S in the other fields
  MatrixTerms L_terms_;
  std::vector<MatrixTerms> K_, K_plus_;  ///< per axis
  formula::BatchEvaluator rest_gradient_, rest_value_;
  SpaceCollocation space_;
  PlacedCoordinates places_;
  bool tangent_ = false;
  grids::FieldSet curvature_;  ///< of tangents: N'' at the stages, row (f·|F| + g)·m + i
  std::vector<double> parseval_;

  Eigen::VectorXcd eigenvalues_;  ///< of A⁻¹ = V Λ V⁻¹
  Eigen::MatrixXcd V_, V_inverse_;
  Eigen::VectorXcd ones_;  ///< V⁻¹ (1, …, 1)
  Eigen::VectorXd of_stages_, at_middle_;
  Eigen::MatrixXd a_inverse_;

  std::optional<WaveResolvent> resolvent_;
  double radius_ = 0.0;

  std::uint64_t stamp_ = 0;
  grids::FieldSet high_;     ///< the level
  grids::FieldSet level_F_;  ///< its varying fields, and what they have beyond double precision
  grids::FieldSet low_F_;
  std::vector<double> level_sizes_;  ///< max |z| of level_F_
  WaveRows level_;                   ///< ẑ_k, as all rows at the points
  WaveRows slopes_;                  ///< of potentials, in their own rows; none if there are none
  WaveRows base_;                    ///< b of P Y = b + N'

  double h_ = 0.0;
  std::vector<WaveRows> inverse_;  ///< 1/D of each eigenvalue
  WaveRows base_F_;                ///< what b makes of Y_F, row f·m + i
  PackedMatrices transfer_;        ///< N' ↦ Y_F
  bool steady_ = false;
  double maps_h_ = 0.0;
  PackedMatrices base_map_, rest_map_;  ///< b ↦ Y and N' ↦ Y, for steps of length maps_h_; empty on many waves
  WaveRows rest_, Y_F_, Y_, end_, scratch_;
  std::vector<const double*> inputs_;  ///< of the rest
  grids::FieldSet y_, y_last_, point_, rest_grid_, work_, end_F_;
  PointTransform points_F_;
  std::vector<double> weights_;  ///< of a continuation
  grids::Fourier fourier_all_;   ///< of nodes
  std::vector<int> all_, rows_F_;
  bool solved_ = false, complete_ = false, end_known_ = false;
  int iterations_ = 0;
};

/// Stages solved anew, for laws that no run shares its own with.
[[nodiscard]] std::shared_ptr<StageSource> make_gauss_stages(const MultisymplecticSystem& system,
                                                             const grids::Grid& grid, int stages, SpaceRule space = {});

}  // namespace rubato
