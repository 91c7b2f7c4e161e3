#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/variational_laws.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/law.hpp>

namespace rubato {

/// The local residuals that are reported of a lattice, step by step, from two levels and h alone: a run and the check
/// of its record differ in where the levels come from only.
///
/// First those of LocalLaws, in every cell; then, of steps that follow each other, VariationalLaws at the nodes of the
/// level between; then the multisymplectic residual of two random tangent solutions, which start with a fixed seed at
/// the first step taken.
class LatticeResiduals {
public:
  struct Wanted {
    bool variational = true;  ///< steps follow each other
    bool tangents = false;
    bool cells = false;  ///< laws in cells have the residual in every one, Law::cells()
  };

  /// Variational laws where the method has them, too. \throws SchemeRefusal if tangents are wanted that it has
  /// not
  LatticeResiduals(const LatticeMethod& method, LocalLaws& laws, const MultisymplecticSystem& system,
                   const grids::Grid& grid, Wanted wanted);
  LatticeResiduals(const LatticeResiduals&) = delete;
  LatticeResiduals& operator=(const LatticeResiduals&) = delete;

  /// Which residuals of a step are wanted: all; none, but those of the next step, of which some join both; none at all.
  enum class Part { all, next, none };
  /// Of the step to `level`.
  [[nodiscard]] static Part part(const Laws& laws, std::size_t level) {
    return laws.taken_at(level) ? Part::all : laws.taken_at(level + 1) ? Part::next : Part::none;
  }

  /// Takes the step from `before` to `after`. Tangent solutions go on whatever is wanted.
  void take(const LatticeLevel& before, const LatticeLevel& after, double h, Part wanted);
  /// True if a step of which so much is wanted need not be taken, for which its levels would have to be found: skip()
  /// does as well.
  [[nodiscard]] bool may_skip(Part wanted) const { return wanted == Part::none && !tangents_; }
  void skip();

  /// Of the step taken last; those in every cell are not numbers before the first one, and where none was wanted.
  ///@{
  [[nodiscard]] std::span<Law> laws() { return laws_; }
  [[nodiscard]] std::span<const Law> laws() const { return laws_; }
  ///@}
  /// The first of them, those of LocalLaws.
  [[nodiscard]] std::span<const Law> in_cells() const { return in_cells_; }

  /// True if those in cells are of the step taken last.
  [[nodiscard]] bool took_cells() const { return took_cells_; }

  /// What became of the tangent solutions, if their step could not be solved: they end there.
  [[nodiscard]] Status tangent_status() const { return tangent_status_; }

  void save(StateWriter& state) const;
  /// `before`, `after`, `h` and `wanted` are those of the step taken last before save(), if there was any (h not 0).
  void restore(StateReader& state, const LatticeLevel& before, const LatticeLevel& after, double h, Part wanted);

private:
  void clear();
  void forget_cells();
  void take_in_cells(const LatticeLevel& before, const LatticeLevel& after, double h, Part wanted);

  LocalLaws& local_;
  bool steps_follow_;
  LocalLaws::Question of_last_step_ = LocalLaws::none;  ///< what laws were asked of the step taken last
  std::optional<VariationalLaws> variational_;
  std::optional<TangentPair> tangents_;
  Status tangent_status_ = Status::success;
  std::optional<grids::FieldSet> cells_;  ///< the residual of each law in every cell, where that is wanted
  bool took_cells_ = false;
  std::vector<Law> laws_;
  std::span<Law> in_cells_, at_nodes_, of_tangents_;  ///< parts of them
};

}  // namespace rubato
