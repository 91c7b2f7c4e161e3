#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/local_laws.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/stage_source.hpp>

namespace rubato {

/// "momentum", in more dimensions "momentum_x", …; where S names the coordinate, momentum has a source, and at walls
/// a force: what is reported is its `balance`: "momentum_balance", "momentum_balance_x".
[[nodiscard]] std::string momentum_name(bool balance, const grids::Grid& grid, int axis);

/// The fields at `count` points, one after the other.
struct LawPoints {
  std::span<const double* const> z;
  std::span<const std::array<const double*, 4>> derivatives;  ///< of each field in direction ν
  const double* S = nullptr;
  std::span<const double* const> partner;  ///< z where fluxes join the points with others; empty: z
};

/// What currents are made of, at a point.
struct LawQuantity {
  enum class Kind {
    field,       ///< z_f
    partner,     ///< z_f where fluxes join the point with another
    derivative,  ///< D_ν z_f
    S
  };
  Kind kind = Kind::field;
  int field = 0, direction = 0;
};
/// factor·left·right is one of the terms of a law's current, or factor·left.
struct LawTerm {
  std::size_t law = 0;
  double factor = 1.0;
  LawQuantity left;
  std::optional<LawQuantity> right = std::nullopt;
  bool of_seam = false;  ///< what ramps and turns add to momentum
};

/// What the laws of a system need to know of it, whatever the scheme: directions μ are 0 for time and 1 + a for axis a.
struct LawTables {
  static constexpr int time = 0;

  /// \throws std::invalid_argument if one of `symmetries` is none
  LawTables(const MultisymplecticSystem& system, const grids::Grid& grid,
            const std::vector<LinearSymmetry>& symmetries);

  [[nodiscard]] double spacing(int mu, double h) const { return mu == time ? h : grid.spacing(mu - 1); }

  MultisymplecticSystem system;
  grids::Grid grid;
  std::vector<LinearSymmetry> symmetries;
  int d, directions;                                     ///< directions: 1 + dimensions
  std::vector<MatrixTerms> plus;                         ///< Λ₊ of each direction
  std::vector<MatrixTerms> full;                         ///< Λ of each direction, for the two-form
  std::vector<std::vector<MatrixTerms>> quadratic;       ///< ½ΛB: [symmetry][direction]
  std::vector<std::vector<MatrixTerms>> quadratic_plus;  ///< Λ₊B where it is -BᵀΛ₊, else ½ΛB: between neighbours
  std::vector<std::vector<MatrixTerms>> linear;          ///< bᵀΛ: [symmetry][direction], in `column`
  std::vector<std::vector<MatrixTerms>> ramps;           ///< sᵀΛ of ramps: [axis][direction], in `column`
  std::vector<std::vector<MatrixTerms>> turns;           ///< ½ΛG of turns: [axis][direction]
  std::vector<std::vector<MatrixTerms>> turns_plus;      ///< the same between neighbours, as quadratic_plus
  std::vector<std::string> names;

  /// The terms of the currents J_μ of all laws, one law after the other: where fluxes join points with others, or do
  /// not. Of derivatives those in the directions ν ≠ μ are read, of fields that are a row of some Λ₊.
  [[nodiscard]] std::vector<LawTerm> terms_of_currents(int mu, bool has_partner) const;
  /// These currents into `out`.
  void currents(int mu, std::size_t count, const LawPoints& points, std::span<double* const> out) const;

private:
  void add_quadratic(const Eigen::MatrixXd& B, std::vector<std::vector<MatrixTerms>>& at_points,
                     std::vector<std::vector<MatrixTerms>>& between);
  void add_affine_symmetries();

  std::array<std::vector<std::vector<LawTerm>>, 2> terms_;  ///< [has_partner][μ]
};

/// Residuals of each law in each cell as LocalLaws shows them: their magnitudes, and themselves where there is room.
[[nodiscard]] std::vector<Spread> write_residuals(const grids::FieldSet& of_laws, std::span<double* const> residuals);

/// The laws of one family of schemes; LocalLaws documents the functions.
class LawEvaluator {
public:
  LawEvaluator() = default;
  LawEvaluator(const LawEvaluator&) = delete;
  LawEvaluator& operator=(const LawEvaluator&) = delete;
  virtual ~LawEvaluator() = default;

  [[nodiscard]] virtual const LawTables& tables() const = 0;
  /// Where the stages of steps come from, if the laws need them: a run's own, so that they are solved once.
  virtual void share(std::shared_ptr<StageSource> /*stages*/) {}
  virtual std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                        std::span<double* const> residuals) = 0;
  /// The same where `before` is the level that was `after` for this the last time, and no other was asked for since:
  /// what is known of it need not be found again.
  virtual std::vector<Spread> next_residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                             std::span<double* const> residuals) {
    return this->residuals(before, after, h, residuals);
  }
  virtual std::vector<double> totals(const LatticeLevel& level) = 0;
  /// The same of the level that was `after` for residuals() the last time, which may know them.
  virtual std::vector<double> totals_after(const LatticeLevel& after) { return totals(after); }
  virtual Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h,
                                          double* residual) = 0;
};

/// The laws of another evaluator, with a law of two tangent solutions of its own.
class LawsWithTangents : public LawEvaluator {
public:
  explicit LawsWithTangents(std::unique_ptr<LawEvaluator> laws) : laws_(std::move(laws)) {}

  [[nodiscard]] const LawTables& tables() const final { return laws_->tables(); }
  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) final {
    return laws_->residuals(before, after, h, residuals);
  }
  std::vector<Spread> next_residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                     std::span<double* const> residuals) final {
    return laws_->next_residuals(before, after, h, residuals);
  }
  std::vector<double> totals(const LatticeLevel& level) final { return laws_->totals(level); }
  std::vector<double> totals_after(const LatticeLevel& after) final { return laws_->totals_after(after); }

private:
  std::unique_ptr<LawEvaluator> laws_;
};

/// On the faces of cells, or of elements. Here and below: with the fluxes integrated over the stages of a step, from
/// `stages` until others are shared; with null, taken at its middle.
[[nodiscard]] std::unique_ptr<LawEvaluator> make_edge_laws(LawTables tables, Collocation collocation,
                                                           std::shared_ptr<StageSource> stages = nullptr);
/// At the nodes, with the derivatives of NodeDerivative.
[[nodiscard]] std::unique_ptr<LawEvaluator> make_node_laws(LawTables tables, Collocation collocation,
                                                           std::shared_ptr<StageSource> stages = nullptr);
/// On cells with their values at the base corner: Collocation::corners.
[[nodiscard]] std::unique_ptr<LawEvaluator> make_euler_box_laws(LawTables tables);

/// The same laws as those of make_edge_laws() and make_node_laws() of Collocation::cells and corners with the fluxes at
/// the middle of a step, by formulas of a node and its neighbours; those that `general` makes where stages are shared,
/// and for tangent solutions.
[[nodiscard]] std::unique_ptr<LawEvaluator> make_compact_laws(
    LawTables tables, Collocation collocation, std::function<std::unique_ptr<LawEvaluator>(LawTables)> general);

}  // namespace rubato
