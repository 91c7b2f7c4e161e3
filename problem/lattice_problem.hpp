#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/pde/node_formula.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// What [multisymplectic], [grid], [initial], [symmetries] and [scheme] of a problem stand for in the library's own
/// terms. All throw ProblemError at the place in the problem that is wrong.
///@{
[[nodiscard]] MultisymplecticSystem make_system(const Problem& problem);
[[nodiscard]] grids::Grid make_grid(const Problem& problem);
/// The formulas of [initial] at the nodes; those that differentiate other fields after these.
[[nodiscard]] InitialFields make_initial_fields(const Problem& problem, const grids::Grid& grid);
[[nodiscard]] LatticeOptions make_lattice_options(const Problem& problem, const MultisymplecticSystem& system);
[[nodiscard]] LatticeIntegrator make_lattice(const Problem& problem);
/// The scheme of the problem.
[[nodiscard]] LatticeMethodChoice method_choice(const Scheme& scheme);
[[nodiscard]] std::unique_ptr<LatticeMethod> make_method(const Problem& problem);
/// The level that a run of the problem starts from; of a thread that has a slab its part.
[[nodiscard]] LatticeLevel make_initial_level(const Problem& problem, const MultisymplecticSystem& system,
                                              const grids::Grid& grid);
///@}

/// Formulas of one section of a lattice problem, evaluated together at every node.
class NodeTable {
public:
  /// \param fields the names of the fields that the formulas may name, with dx() and its like; empty: the grid's
  /// coordinates and t instead
  NodeTable(const Problem& problem, const std::vector<NamedFormula>& formulas, const std::vector<std::string>& fields,
            const grids::Grid& grid);

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  /// One array of node values for each name.
  [[nodiscard]] std::vector<std::vector<double>> at(const LatticeLevel& level, double t);
  /// Σ ΔV of each over the nodes.
  [[nodiscard]] std::vector<double> integrals(const LatticeLevel& level, double t);

private:
  std::vector<std::string> names_;
  std::optional<NodeFormula> formula_;  ///< absent when there is nothing to evaluate
};

/// The invariants of a problem. \throws ProblemError also for one that reads a field which exists at midpoints only
[[nodiscard]] NodeTable make_invariants(const Problem& problem, const MultisymplecticSystem& system,
                                        const grids::Grid& grid);
/// Its exact solutions. \throws ProblemError also for that of a field which exists at midpoints only
[[nodiscard]] NodeTable make_exact(const Problem& problem, const MultisymplecticSystem& system,
                                   const grids::Grid& grid);

/// |field - exact| over the nodes of a level, for each name of [exact].
[[nodiscard]] std::vector<figures::Named<Spread>> lattice_errors(NodeTable& exact, const MultisymplecticSystem& system,
                                                                 const LatticeLevel& level, double t);

}  // namespace rubato
