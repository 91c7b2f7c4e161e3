#pragma once

#include <span>
#include <vector>

#include "audit/lattice_problem.hpp"
#include "audit/series.hpp"

namespace audit {

/// A field at the nodes or in the cells, x running fastest.
using Values = std::vector<Bounded>;
/// All fields of one level.
using LatticeState = std::vector<Values>;

/// One place of a step at which fluxes are taken: its weight among them, the fields and their rates there.
struct FluxPlace {
  long double weight;
  LatticeState state, rate;
};

/// The equations of a lattice's scheme (theory, section 5), evaluated in extended precision with a bound of what
/// rounding makes of each in double. Space derivatives of `fourier` come from the matrix of the trigonometric
/// interpolation.
class LatticeOracle {
public:
  explicit LatticeOracle(const LatticeProblem& problem);

  /// Stored values with the rounding that they came with: fields that follow from a constraint carry what solving for
  /// them makes of the rounding of the others.
  [[nodiscard]] LatticeState state(std::span<const std::vector<double>> fields) const;

  /// What two levels leave of the equation: for each row its value in every cell (or at every node).
  [[nodiscard]] LatticeState residual(const LatticeState& before, const LatticeState& after, double h) const;
  /// E of the step between.
  [[nodiscard]] Bounded energy(const LatticeState& before, const LatticeState& after) const;
  /// 𝓔 of a level.
  [[nodiscard]] Bounded node_energy(const LatticeState& level) const;
  /// Σ ΔV |terms| of it
  [[nodiscard]] long double magnitude_of_terms(const LatticeState& level) const;
  /// The residual of the local energy law on edges, its fluxes taken in the middle of the step if nothing else is said.
  [[nodiscard]] Values energy_law(const LatticeState& before, const LatticeState& after, double h,
                                  std::span<const FluxPlace> places = {}) const;
  /// The residual of the local momentum law along a line, and the total of its density at a level.
  [[nodiscard]] Values momentum_law(const LatticeState& before, const LatticeState& after, double h,
                                    std::span<const FluxPlace> places = {}) const;
  [[nodiscard]] Bounded momentum(const LatticeState& level) const;

  /// The slope of the potential, which the record leaves out of it; from the first level.
  void set_slope(const LatticeState& first);
  [[nodiscard]] long double slope() const { return slope_.value; }
  /// Means over the cells of the box, or over their faces across one axis; else the values at the nodes.
  [[nodiscard]] LatticeState means(const LatticeState& state, std::size_t except = 9) const;
  /// ∇S at every node or in every cell.
  [[nodiscard]] LatticeState gradient(const LatticeState& state) const;

private:
  [[nodiscard]] std::size_t neighbour(std::size_t node, std::size_t axis, int direction) const;
  [[nodiscard]] Values averaged(const Values& values, std::size_t axis) const;
  [[nodiscard]] Values differenced(const Values& values, std::size_t axis) const;
  [[nodiscard]] Values spectral(const Values& values, std::size_t axis) const;
  /// Mean differences, or derivatives at the nodes.
  [[nodiscard]] LatticeState slopes(const LatticeState& state, std::size_t axis) const;
  [[nodiscard]] Bounded volume() const;
  [[nodiscard]] Values energy_density(const LatticeState& state) const;
  [[nodiscard]] Values S(const LatticeState& state) const;
  [[nodiscard]] FluxPlace middle_of(const LatticeState& before, const LatticeState& after, double h) const;
  [[nodiscard]] bool one_sided() const;  ///< differences of neighbours at the nodes
  [[nodiscard]] LatticeState euler_residual(const LatticeState& before, const LatticeState& after, double h) const;
  [[nodiscard]] bool cells() const { return problem_.lagrangian == LatticeProblem::Lagrangian::box; }

  const LatticeProblem& problem_;
  std::vector<std::vector<Bounded>> interpolation_;  ///< for each axis the first column of the derivative's matrix
  Bounded slope_ = 0.0L;
};

}  // namespace audit
