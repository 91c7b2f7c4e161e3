#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <rubato/pde/local_laws.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/stage_source.hpp>

namespace rubato {

/// "momentum", in more dimensions "momentum_x", …; where S names the coordinate, momentum has a source, and what is
/// reported is its `balance`: "momentum_balance", "momentum_balance_x".
[[nodiscard]] std::string momentum_name(bool balance, const grids::Grid& grid, int axis);

/// What the laws of a system need to know of it, whatever the scheme: directions μ are 0 for time and 1 + a for axis a.
struct LawTables {
  static constexpr int time = 0;

  /// \throws std::invalid_argument if one of `symmetries` is none
  LawTables(const MultisymplecticSystem& system, const grids::Grid& grid,
            const std::vector<LinearSymmetry>& symmetries);

  [[nodiscard]] double spacing(int mu, double h) const { return mu == time ? h : grid.spacing(mu - 1); }

  MultisymplecticSystem system;
  grids::Grid grid;
  int d, directions;                                     ///< directions: 1 + dimensions
  std::vector<MatrixTerms> plus;                         ///< Λ₊ of each direction
  std::vector<MatrixTerms> full;                         ///< Λ of each direction, for the two-form
  std::vector<std::vector<MatrixTerms>> quadratic;       ///< ½ΛB: [symmetry][direction]
  std::vector<std::vector<MatrixTerms>> quadratic_plus;  ///< Λ₊B where it is -BᵀΛ₊, else ½ΛB: between neighbours
  std::vector<std::vector<MatrixTerms>> linear;          ///< bᵀΛ: [symmetry][direction], in `column`
  std::vector<std::string> names;

  /// The currents J_μ of the symmetries, linear ones first, at `count` points into `out`: of the fields `z`, or, where
  /// fluxes join them with others, with `partner`'s (empty: none).
  void symmetry_currents(int mu, std::size_t count, std::span<const double* const> z,
                         std::span<const double* const> partner, std::span<double* const> out) const;

private:
  void add_affine_symmetries();
};

/// The laws of one family of schemes; LocalLaws documents the functions.
class LawEngine {
public:
  LawEngine() = default;
  LawEngine(const LawEngine&) = delete;
  LawEngine& operator=(const LawEngine&) = delete;
  virtual ~LawEngine() = default;

  [[nodiscard]] virtual const LawTables& tables() const = 0;
  /// Where the stages of steps come from, if the laws need them: a run's own, so that they are solved once.
  virtual void share(std::shared_ptr<StageSource> /*stages*/) {}
  virtual std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                        std::span<double* const> residuals) = 0;
  virtual std::vector<double> totals(const LatticeLevel& level) = 0;
  virtual Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h,
                                          double* residual) = 0;
};

/// On the faces of cells, with Placement::cells; at the nodes otherwise, with the derivatives of NodeDerivative.
[[nodiscard]] std::unique_ptr<LawEngine> make_face_laws(LawTables tables, Placement placement);
/// At the nodes, with the fluxes integrated over the stages of a step; from `stages` until others are shared.
[[nodiscard]] std::unique_ptr<LawEngine> make_stage_laws(LawTables tables, std::shared_ptr<StageSource> stages,
                                                         Placement placement = Placement::nodes);
/// On cells with their values at the base corner: Placement::corners.
[[nodiscard]] std::unique_ptr<LawEngine> make_corner_laws(LawTables tables);

}  // namespace rubato
