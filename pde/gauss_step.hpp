#pragma once

#include <cmath>
#include <complex>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/state.hpp>
#include <rubato/base/status.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/rest_forecast.hpp>
#include <rubato/pde/row_rounding.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/pde/stage_loops.hpp>
#include <rubato/pde/stage_source.hpp>
#include <rubato/pde/wave_resolvent.hpp>
#include <rubato/solve/gmres.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// One step of Gauss collocation in time (theory, sections 8.1 and 8.3), and in space spectral or collocated, too
/// (SpaceCollocation): with the stages Z_i = z_k + Y_i, Y_i = h Σ_j a_ij Ż_j,
///
///     M Ż_i + Σ_a K_a ∂_a Z_i = ∇S(Z_i)  at every point,      E_k = Σ_i b_i Σ ΔV [S(Z_i) + Σ_a (∂_a Z_i)ᵀK₊Z_i].
///
/// Levels and stages are given and reported at the nodes; within, rows of waves are of the values at the points.
/// A field in ker M has stage values alone, and so have constraints: they hold at the stages. S is taken apart into a
/// quadratic part with constant coefficients L and the rest N, a function of the fields F that S'' varies with; L̄ is
/// a middle of the values of N'' at the first level (middle_hessian). Then
///
///     (A⁻¹/h ⊗ M + I ⊗ (Σ ik_a K_a - L - L̄)) Ŷ = [L - Σ ik_a K_a] ẑ_k + R̂,    R = N'(Z_F) - L̄ Y_F
///
/// is solved exactly on every wave, A⁻¹ brought to its eigenvalues, and iterated on R alone: a fixed point whose
/// contraction does not depend on Δx, and which costs one transform there and one back of each field of F at each
/// stage, whatever the number of fields. (L̄ multiplies increments, not fields: what is large and cancels is not
/// computed.) Where it does not contract, in steps of more than about 1/|N'' - L̄|, Newton's method solves the same
/// equation Y_F = T(b + R), its corrections by GMRES,
///
///     (I - T (N''(Z_F) - L̄)) δ = T(b + R) - Y_F:
///
/// T, which inverts the linear part, is the preconditioner already.
///
/// Fields that follow from the others at every stage and level, a = Σ_a (K_a)_ac ∂_a z_c/L_aa, have no rows of waves:
/// these are taken where they are read.
///
/// A⁻¹ = VΛV⁻¹ holds to cond(V) ε only, 1e-12 with eight stages, and a scheme whose A is off is off its symplecticity
/// in every step by the same, which shows as a drift. So once in each step, when the stages are known well enough,
/// their equation's residual is taken with A⁻¹ in two parts, and what mends it is added from then on.
class GaussStep final : public StageSource {
public:
  /// `first`: a level of the run, for the middle of S''. \throws std::invalid_argument if stages are not 1 … 8, or as
  /// SpaceCollocation
  GaussStep(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, const LatticeLevel& first,
            SpaceRule space = {});

  /// The level z = high + low that steps are taken from; fields at midpoints count as 0. `low` may be null.
  void stand(const grids::FieldSet& high, const grids::FieldSet* low, const PotentialSlopes& slopes);
  /// The fields that a step gives. The others follow: write_derived() writes those of a level.
  ///@{
  [[nodiscard]] const std::vector<int>& kept() const { return kept_; }
  void write_derived(grids::FieldSet& level);
  ///@}
  /// No stages are taken from now on: the level that they add to need not be kept.
  void take_no_stages() { keeps_level_ = false; }
  /// Discards what the steps solved so far left: the next one depends on its level and h alone.
  void forget_steps();
  /// Changes with every stand().
  [[nodiscard]] std::uint64_t stamp() const { return stamp_; }

  /// From now on steps are those of tangent solutions at a fixed h, S'' taken at the stages of the step that `about`,
  /// made of the same arguments, has just solved. Energies are then none.
  void linearise(const GaussStep& about);

  /// Where the iteration begins: with R of the level at all stages, with R of the stages solved last, for a step
  /// `ratio` times as long from the same level, or with what is foreseen from the steps that led here. Newton's method
  /// begins with the stages of the step solved or kept last, continued as a polynomial; at a level, with steps that
  /// grow to h.
  ///@{
  void begin_at_level();
  /// The nearest of these for a step of length h, `trial` that of the stages solved last from this level; 0: none were.
  /// \return false if it is the level
  bool begin(RestForecast& forecast, double h, double trial);
  void continue_trial(double ratio);
  void continue_from(RestForecast& forecast, double h);
  /// The stages solved last are those of a step of the run.
  void keep(RestForecast& forecast);
  [[nodiscard]] RestForecast make_forecast() const;
  ///@}
  /// `largest`: the largest increment of each field so far, beside which corrections are judged. `steady`: whether
  /// steps of about this length are to be expected, so that matrices for them are made and kept where they are small.
  [[nodiscard]] Status solve(double h, double accuracy, std::span<const double> largest, bool steady = false);
  /// True if matrices of steps of the one length serve for those of the other.
  [[nodiscard]] static bool are_near(double h, double other);
  [[nodiscard]] int iterations() const { return iterations_; }  ///< since construction

  /// Of the step solved last.
  ///@{
  [[nodiscard]] bool solved_by_newton() const { return since_fixed_point_ > 0; }
  [[nodiscard]] double energy();         ///< E_k
  [[nodiscard]] double energy_at_end();  ///< 𝓔 of the level it leads to
  /// Calls use(f, δ_f) for these fields: δ = z_{k+1} - z_k, of fields at midpoints twice their value there.
  void increments(std::span<const int> fields, const std::function<void(int, std::span<double>)>& use);
  void increments(const std::function<void(int, std::span<double>)>& use) { increments(all_, use); }
  ///@}

  [[nodiscard]] Status take(const LatticeLevel& before, const LatticeLevel& after, double h) override;
  [[nodiscard]] int count() const override { return m_; }
  [[nodiscard]] double weight(int stage) const override { return tableau_.b[stage]; }
  void stage(int stage, grids::FieldSet& z, grids::FieldSet& rate) override;
  void ask_rates_of(const std::vector<bool>& fields) override { asked_ = fields; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);
  /// For a checkpoint.
  ///@{
  void save(StateWriter& state, const RestForecast& forecast) const { forecast.save(state, fourier_all_); }
  void restore(StateReader& state, RestForecast& forecast) const { forecast.restore(state, fourier_all_); }
  ///@}

private:
  [[nodiscard]] bool has_mean() const;
  [[nodiscard]] double sum_of_waves(double here) const;
  void find_varying_fields();
  void find_derived_fields();
  void set_middle(const LatticeLevel& first);
  void compile_curvature();
  void evaluate_curvature(const grids::FieldSet& stages);
  void compile();
  void add_slopes(const PotentialSlopes& slopes);
  [[nodiscard]] bool prepare(double h);
  [[nodiscard]] bool has_resolvent() const;
  void take_last_resolvent();
  void invert(double h);
  template <typename Use>
  void for_each_entry(std::span<const int> fields, const Use& use);
  void make_maps();
  void make_transfer();
  [[nodiscard]] bool by_maps() const { return steady_ && !base_map_.empty(); }
  struct Correction {
    double size = 0.0;      ///< relative to the increments
    double rounding = 0.0;  ///< the size that rounding explains
  };
  void iterate_waves();
  void measure_noise();
  [[nodiscard]] Correction place_stages(std::span<const double> largest);
  void evaluate_rests();
  void multiply_by_curvature(std::span<const double* const> of);
  [[nodiscard]] Status iterate_to_fixed_point(std::span<const double> largest);
  [[nodiscard]] Status solve_by_newton(double h, double accuracy, std::span<const double> largest);
  [[nodiscard]] Status iterate_by_newton(double accuracy, std::span<const double> largest);
  [[nodiscard]] bool needs_newton() const { return std::isfinite(fixed_point_fails_at_); }
  void make_newton();
  void continue_stages(const grids::FieldSet& from, double ratio, bool at_its_end, grids::FieldSet& to);
  void continue_rests(double ratio);
  void add_middle_of_level(double factor, WaveRows& rests) const;
  [[nodiscard]] double evaluate_residual();
  void apply_newton_matrix(const double* in, double* out);
  void complete();
  void stages_of_rests();
  /// Stages as good as this, relative, show what mends them to next to nothing.
  static constexpr double refined_at = 1e-6;
  void refine();
  void evaluate_left(std::size_t begin, std::size_t count);
  void add_left_to_base();
  void take_base_of_varying();
  void add_base(int e, int c, std::size_t begin, std::size_t count, WaveBlock& right) const;
  void add_stages(int e, const WaveRows& rows, int first, std::size_t begin, std::size_t count, WaveBlock& right) const;
  template <typename AddRight>
  void solve_on_waves(const AddRight& add_right, std::span<const int> fields, WaveRows& x);
  /// Of a field on the waves [begin, begin + count).
  ///@{
  using OfWaves = std::function<void(int field, std::size_t begin, std::size_t count, double* re, double* im)>;
  void add_level(double value, int field, std::size_t begin, std::size_t count, double* re, double* im) const;
  void add_stage(double value, int field, int stage, std::size_t begin, std::size_t count, double* re,
                 double* im) const;
  template <typename Add>
  void add_derived(double value, int field, const Add& add_term) const;
  void write_base(int field, std::size_t begin, std::size_t count, double* re, double* im) const;
  void write_change(int field, std::size_t begin, std::size_t count, double* re, double* im) const;
  ///@}
  void to_nodes(std::span<const int> fields, const OfWaves& write, std::span<double* const> values);
  [[nodiscard]] double wave_energy(std::span<const double> weights, bool at_end) const;
  void subtract_middle(std::span<const double* const> of);
  [[nodiscard]] double rest_energy(std::span<const double* const> fields);
  [[nodiscard]] int varying(int f, int i) const { return f * m_ + i; }
  /// In rows of kept fields at one stage, and at all.
  ///@{
  [[nodiscard]] int row_of(int field) const { return rows_[static_cast<std::size_t>(field)]; }
  [[nodiscard]] int row_of(int field, int stage) const { return row_of(field) * m_ + stage; }
  [[nodiscard]] bool is_derived(int field) const { return row_of(field) < 0; }
  ///@}

  MultisymplecticSystem system_;
  grids::Grid grid_;
  GaussTableau tableau_;
  int m_, d_;
  std::vector<bool> at_midpoints_;
  std::vector<int> F_;            ///< fields that S'' varies with, or whose ∂S/∂z_f names a coordinate
  std::vector<int> kept_, rows_;  ///< fields that have rows of waves, and the number of each field's; -1: none
  Eigen::MatrixXd whole_;         ///< L + L̄
  MatrixTerms M_, L_terms_, middle_terms_, whole_terms_;  ///< M, L, L̄ among F, L + L̄
  Eigen::VectorXd linear_;                                ///< of S in the other fields
  std::vector<MatrixTerms> K_, K_plus_;                   ///< per axis
  formula::BatchEvaluator rest_gradient_, rest_value_;
  SpaceCollocation space_;
  PlacedCoordinates places_;
  bool tangent_ = false;
  formula::BatchEvaluator rest_curvature_;  ///< N'', compiled where it is needed first
  grids::FieldSet curvature_;               ///< N'' at the stages, row (f·|F| + g)·m + i
  /// What Newton's method takes, from when it is needed first.
  struct Newton {
    solve::Gmres gmres;
    grids::FieldSet residual, correction;  ///< T(b + R) - Y and δ, as y_
    grids::FieldSet image;                 ///< of a vector of GMRES under T (N'' - L̄)
    grids::FieldSet kept, start;           ///< Y_F of the last step of the run; to begin with
    bool any_kept = false, any_start = false;
    std::vector<const double*> rows;  ///< of a vector of GMRES
  };
  std::optional<Newton> newton_;
  double fixed_point_fails_at_ = std::numeric_limits<double>::infinity();  ///< |h|
  int since_fixed_point_ = 0;  ///< steps solved by Newton's method since the other was tried
  bool restored_ = false;      ///< and no stages taken for laws since
  std::vector<double> parseval_;

  Eigen::VectorXcd eigenvalues_;  ///< of A⁻¹ = V Λ V⁻¹
  Eigen::MatrixXcd V_, V_inverse_;
  Eigen::VectorXcd ones_;  ///< V⁻¹ (1, …, 1)
  Eigen::VectorXd at_middle_;
  GaussTableau::Inverse a_inverse_;
  std::vector<double> a_inverse_high_, a_inverse_low_;  ///< by rows
  std::vector<std::complex<double>> V_by_rows_, V_inverse_by_rows_;

  std::optional<WaveResolvent> resolvent_;  ///< about radius_, once has_resolvent() is true
  std::optional<WaveResolvent>
      last_resolvent_;               ///< before it: a look-ahead goes from short steps to long ones and back
  std::optional<bool> is_solvable_;  ///< by resolvent_ of all ranks, if that is known
  double radius_ = 0.0;
  bool is_forgetful_ = false;  ///< once forget_steps() was called

  std::uint64_t stamp_ = 0;
  grids::FieldSet high_;  ///< the level, for stages
  bool keeps_level_ = true;
  grids::FieldSet level_F_;  ///< its varying fields, and what they have beyond double precision
  grids::FieldSet low_F_;
  std::vector<double> level_sizes_;  ///< max |z| of level_F_
  LargestRounding rest_rounding_;    ///< of rest_gradient_
  std::vector<double> changes_;      ///< of each varying field, by the last correction
  std::vector<double> noise_;        ///< of each varying field, what rounding of N' makes of it; empty: not measured
  WaveRows level_;   ///< ẑ_k, as all rows at the points; 0 of fields at midpoints, which take no memory
  WaveRows slopes_;  ///< of potentials, in their own rows; none if there are none

  double h_ = 0.0;
  double reference_h_ = 0.0;    ///< near h_: of all matrices
  double inverted_h_ = 0.0;     ///< the reference that transfer_ was made for
  bool starts_solved_ = false;  ///< with stages that are as good as refined_at asks
  WaveRows base_F_;             ///< what b of P Y = b + N' makes of Y_F, row f·m + i
  PackedMatrices transfer_;     ///< N' ↦ Y_F
  bool steady_ = false;
  double maps_h_ = 0.0;
  PackedMatrices base_map_, rest_map_;      ///< b ↦ Y and N' ↦ Y, for the reference maps_h_; empty on many waves
  std::vector<PackedMatrices> resolvents_;  ///< the resolvent at each eigenvalue, with these
  WaveRows base_Y_;                         ///< what b makes of Y then, and what mends it
  WaveRows rate_, right_, resolved_;        ///< see refine()
  WaveRows rest_, Y_F_, Y_;
  WaveRows scratch_;  ///< as many rows as are transformed at once, and one
  WaveRows left_;     ///< of the equation of all stages; none with one stage
  bool refined_ = false;
  std::vector<const double*> inputs_;  ///< of the rest
  grids::FieldSet y_, y_last_, point_, rest_grid_;
  grids::FieldSet work_;  ///< as many fields as are transformed at once
  PointTransform points_F_;
  std::vector<double> weights_;  ///< of a continuation
  grids::Fourier fourier_all_;   ///< of nodes
  std::vector<int> all_, rows_F_;
  std::vector<bool> asked_;  ///< whose rates at stages; none: all
  bool solved_ = false, complete_ = false;
  int iterations_ = 0;
};

/// Stages solved anew, for laws that no run shares its own with.
[[nodiscard]] std::shared_ptr<StageSource> make_gauss_stages(const MultisymplecticSystem& system,
                                                             const grids::Grid& grid, int stages, SpaceRule space = {});

}  // namespace rubato
