#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/pde/jumps.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/pde/moving_frame.hpp>
#include <rubato/pde/nodal_view.hpp>
#include <rubato/pde/node_formula.hpp>
#include <rubato/pde/sponge.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// What [multisymplectic], [grid], [initial], [symmetries] and [scheme] of a problem stand for in the library's own
/// terms. All throw ProblemError at the place in the problem that is wrong.
///@{
/// The equation that the scheme solves; with [scheme] frame that of the frame, with jumps and twists that of the
/// periodic fields.
[[nodiscard]] MultisymplecticSystem make_system(const Problem& problem);
[[nodiscard]] Eigen::MatrixXd dense(const Matrix& matrix);
/// The equation as the problem states it: without a frame, and for no scheme in particular.
[[nodiscard]] MultisymplecticSystem make_laboratory_system(const Problem& problem);
/// The same in the frame of the problem, if there is one; of the fields z, which may jump.
[[nodiscard]] MultisymplecticSystem make_system_of_fields(const Problem& problem);
/// J_a of all fields, one vector for each axis of [grid]; none where no field jumps.
[[nodiscard]] std::vector<Eigen::VectorXd> jumps_of(const MultisymplecticProblem& pde);
/// The jumps and twists of [grid].
[[nodiscard]] Jumps make_jumps(const Problem& problem);
/// The layers of [grid] sponge; null where there are none.
[[nodiscard]] std::shared_ptr<const Sponge> make_sponge(const Problem& problem);
/// The twists of them.
[[nodiscard]] Twists make_twists(const Problem& problem);
/// Numbers that are still to be fitted are 0. Nothing without a frame.
[[nodiscard]] std::optional<MovingFrame> make_frame(const Problem& problem);
[[nodiscard]] grids::Grid make_grid(const Problem& problem);
/// The formulas of [initial] at the nodes, without the ramps and turns of Jumps; those that differentiate other fields
/// after these.
[[nodiscard]] InitialFields make_initial_fields(const Problem& problem, const grids::Grid& grid);
[[nodiscard]] LatticeOptions make_lattice_options(const Problem& problem, const MultisymplecticSystem& system);
[[nodiscard]] LatticeIntegrator make_lattice(const Problem& problem);
/// The scheme of the problem; make_bare_method() has no sponge.
[[nodiscard]] LatticeMethodChoice method_choice(const Scheme& scheme);
/// What walls give fields; null where no wall does.
[[nodiscard]] std::shared_ptr<const WallDrives> make_wall_drives(const Problem& problem);
[[nodiscard]] std::unique_ptr<LatticeMethod> make_method(const Problem& problem);
[[nodiscard]] std::unique_ptr<LatticeMethod> make_bare_method(const Problem& problem);
/// The level that a run of the problem starts from; of a thread that has a slab its part.
[[nodiscard]] LatticeLevel make_initial_level(const Problem& problem, const MultisymplecticSystem& system,
                                              const grids::Grid& grid);
///@}

/// True for a field that the record has of the first and the last level where it has no other states: one that has an
/// equation of motion and exists at levels, or an exact solution.
[[nodiscard]] bool is_stored_alone(const MultisymplecticSystem& system, int field,
                                   const std::vector<std::string>& exact);

/// Formulas of one section of a lattice problem, evaluated together at every node. With a frame, levels are those of
/// the frame, and formulas speak of the laboratory; with jumps and twists levels are periodic, and formulas of the
/// whole fields.
class NodeTable {
public:
  /// \param fields the names of the fields that the formulas may name, with dx() and its like; empty: the grid's
  /// coordinates and t instead
  /// \param with_energy of the laboratory, as `laboratory_energy`, with a frame
  NodeTable(const Problem& problem, const std::vector<NamedFormula>& formulas, const std::vector<std::string>& fields,
            const grids::Grid& grid, bool with_energy = false);

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  /// One array for each name: formulas of coordinates and t at the nodes of the frame, others at those of the
  /// laboratory.
  [[nodiscard]] std::vector<std::vector<double>> at(const LatticeLevel& level, double t);
  /// Σ ΔV of each over the nodes of the laboratory.
  [[nodiscard]] std::vector<double> integrals(const LatticeLevel& level, double t);
  /// The frame, if there is one.
  [[nodiscard]] const MovingFrame* frame() const { return laboratory_ ? &laboratory_->frame() : nullptr; }
  /// A level with the fields that there are formulas for at the nodes; see NodalView. Valid until the next call.
  [[nodiscard]] const LatticeLevel& at_nodes(const LatticeLevel& level) { return nodal_ ? (*nodal_)(level) : level; }
  /// The fields with the ramps and turns that levels are without, at the nodes.
  [[nodiscard]] WholeFields& whole() { return whole_; }

private:
  std::vector<std::string> names_;
  std::optional<NodeFormula> formula_;  ///< absent when there is nothing to evaluate
  std::optional<LaboratoryView> laboratory_;
  std::optional<NodalView> nodal_;
  WholeFields whole_;
  bool reads_fields_;
};

/// The invariants of a problem; with a frame, whose energy is another, `laboratory_energy` after them. \throws
/// ProblemError also for one that reads a field which exists at midpoints only
[[nodiscard]] NodeTable make_invariants(const Problem& problem, const MultisymplecticSystem& system,
                                        const grids::Grid& grid);
/// Its exact solutions. \throws ProblemError also for that of a field which exists at midpoints only
[[nodiscard]] NodeTable make_exact(const Problem& problem, const MultisymplecticSystem& system,
                                   const grids::Grid& grid);

/// |field - exact| over the nodes of a level, for each name of [exact].
[[nodiscard]] std::vector<figures::Named<Spread>> lattice_errors(NodeTable& exact, const MultisymplecticSystem& system,
                                                                 const LatticeLevel& level, double t);

}  // namespace rubato
