#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/euler_box_formulas.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/variation/node_pass.hpp>

namespace rubato {

/// The Euler box equation as an explicit map of levels, z_k → z_{k+1}, and its tangent (theory, section 5):
///
///     M₊(z_{k+1} - z_k) - M₊ᵀ(z_k - z_{k-1}) = h [∇S - Σ_a K₊δ_a⁺z + K₊ᵀδ_a⁻z]  at every node.
///
/// The rows of M₊ at level k give the fields of its columns at the next; then the other rows at level k + 1 give the
/// other fields, one after the other, node by node (by Newton's method where S is not quadratic in one).
class EulerBoxMap {
public:
  /// \param derives whether there are derived() fields; else all are read as they are
  /// \throws std::invalid_argument if the rows cannot be put into such an order, saying which field is left; if the
  /// dimensions of grid and system differ; as EulerBoxFormulas
  EulerBoxMap(const MultisymplecticSystem& system, const grids::Grid& grid, bool derives = true);

  /// Computes the algebraic fields of a first level from the others, by the constraints at its nodes.
  [[nodiscard]] Status start(grids::FieldSet& fields);
  /// The energy of a level, 𝓔 = Σ ΔV [S - Σ_a zᵀK₊δ_a⁺z].
  [[nodiscard]] double energy(const grids::FieldSet& fields);
  /// Fields that follow from others at a level: advance() neither reads nor writes them, and energy() does not read
  /// them. And all others.
  ///@{
  [[nodiscard]] const std::vector<int>& derived() const { return formulas_->derived(); }
  [[nodiscard]] const std::vector<int>& found() const { return found_; }
  void write_derived(grids::FieldSet& fields);
  ///@}
  /// \param energy receives that of the level `after`
  [[nodiscard]] Status advance(double h, const grids::FieldSet& before, grids::FieldSet& after, double& energy);
  /// What two levels, h apart, leave of the equations that the map solves: of each row of M₊ at the level `before`, of
  /// the other rows at `after`; 0 to rounding if `after` is the image of `before`.
  void residual(double h, const grids::FieldSet& before, const grids::FieldSet& after, grids::FieldSet& rows);
  /// Takes a solution u of the linearised equation over the step from `before` to `after`.
  [[nodiscard]] Status tangent(double h, const grids::FieldSet& before, const grids::FieldSet& after,
                               const grids::FieldSet& u_before, grids::FieldSet& u_after);
  [[nodiscard]] int evaluations() const { return evaluations_; }  ///< of rows of the equation, since construction

  /// What a step makes of ghosts that are all right (grids::Slab): advance() and tangent() renew those of the fields
  /// that go on from level to level and that neighbours read, as far as they are wrong.
  struct Halo {
    std::vector<int> renewed;
    std::size_t planes = 0;  ///< of them, the outer ones on each side
    std::size_t lost = 0;    ///< outer planes that stay wrong of other fields
  };
  [[nodiscard]] static Halo halo(const MultisymplecticSystem& system);
  /// How many ghosts of walls, the outer ones, a step makes wrong that renews none.
  [[nodiscard]] static std::size_t lost_at_walls(const MultisymplecticSystem& system);

private:
  /// An entry of M₊: the equation of `row` at a level gives `column` at the next.
  struct Kick {
    int row = 0;
    int column = 0;
    double value = 0.0;
    std::size_t code = 0;  ///< of codes_
  };
  /// The equation of `row` at one level gives `field` there, node by node; `rate` is the entry of M₊ that multiplies
  /// its increment (0 for a constraint).
  struct LocalSolve {
    int row = 0;
    int field = 0;
    double rate = 0.0;
    std::size_t code = 0;   ///< of codes_
    bool is_affine = true;  ///< S'' of the row with the field is constant
  };
  /// What a step does in one pass: kicks and affine solves, and then, if it is not the last one, a solve by iteration.
  struct Turn {
    NodePass pass;
    std::vector<const Kick*> kicks;
    std::vector<const LocalSolve*> affine;
    const LocalSolve* iterated = nullptr;
  };

  /// ∂S/∂z of one row, and S'' of the row with the field that it gives if that varies.
  struct RowCode {
    formula::BatchEvaluator evaluate;
    std::size_t outputs = 0;
  };

  void plan();
  [[nodiscard]] std::vector<int> find_derived() const;
  void make_turns();
  void add_to(Turn& turn, NodeCode code, int field) const;
  [[nodiscard]] static EulerBoxMap of_three_nodes(const MultisymplecticSystem& system);
  [[nodiscard]] Halo find_halo(bool after) const;
  [[nodiscard]] std::size_t find_lost() const;
  [[nodiscard]] bool is_renewed(int field) const;
  void renew(int field, grids::FieldSet& fields) const;
  void order_solves(std::vector<bool> known, std::vector<bool> used, std::vector<LocalSolve>& solves) const;
  [[nodiscard]] double rate_of(int row, int field) const { return system_.structure().M_plus.transpose()(row, field); }
  [[nodiscard]] bool local(int row, int field) const;
  [[nodiscard]] bool across(int row, int field) const { return follows(row, field) || precedes(row, field); }
  /// True if a row reads the field at the next node along an axis, or at the one before.
  ///@{
  [[nodiscard]] bool follows(int row, int field) const;
  [[nodiscard]] bool precedes(int row, int field) const { return follows(field, row); }
  ///@}
  [[nodiscard]] int varying_entry(int row, int field) const;

  void compile();
  void evaluate(const grids::FieldSet& fields);
  void evaluate_row(std::size_t code, const grids::FieldSet& fields);
  void row_of_hessian(int row, const grids::FieldSet& u);
  void add_differences(int row, const grids::FieldSet& fields);
  void kick(const Kick& kick, double h, grids::FieldSet& fields, std::size_t begin, std::size_t end) const;
  void kick_and_renew(const Kick& entry, double h, grids::FieldSet& fields) const;
  void clear_ghosts(std::span<double> values) const;
  void correct(const LocalSolve& solve, const double* varying, double h, const grids::FieldSet& before,
               grids::FieldSet& fields);
  [[nodiscard]] bool is_rounding(const LocalSolve& solve, double h, const grids::FieldSet& before,
                                 const grids::FieldSet& fields);
  [[nodiscard]] Status run(const LocalSolve& solve, double h, const grids::FieldSet& before, grids::FieldSet& fields);

  MultisymplecticSystem system_;
  grids::Grid grid_;
  grids::FieldSet outputs_;                     ///< S, ∇S and the varying entries of S'' as last evaluated
  grids::FieldSet row_, derivative_, scratch_;  ///< of one row: the equation, S'' as RowCode has it
  PlacedCoordinates places_;
  std::vector<const double*> inputs_;  ///< the fields, then the coordinates
  formula::BatchEvaluator evaluate_;   ///< all of outputs_
  std::vector<RowCode> codes_;         ///< what kicks and solves take
  std::vector<Kick> kicks_;
  std::vector<LocalSolve> solves_, start_solves_;
  std::optional<EulerBoxFormulas> formulas_;  ///< by the plan
  std::vector<int> found_;
  std::vector<NodeCode> derive_;  ///< of derived()
  std::vector<NodeCode> start_;   ///< of start_solves_, where they are affine; made with the first start
  std::vector<Turn> turns_;       ///< made with the first step
  NodePass energy_;               ///< as this, with the first level
  std::vector<std::pair<int, std::size_t>> held_;  ///< fields that are iterated, and nodes on walls that hold them
  std::vector<grids::NodeRange> ghosts_;           ///< of walls
  Halo halo_;
  int evaluations_ = 0;
};

/// The first level of an euler-box run from the user's data: what initial_level() gives for Collocation::corners.
/// \throws std::invalid_argument as initial_level() and EulerBoxMap
[[nodiscard]] LatticeLevel euler_box_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                           const InitialFields& given);

}  // namespace rubato
