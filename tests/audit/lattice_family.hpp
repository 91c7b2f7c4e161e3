#pragma once

#include <complex>
#include <cstddef>
#include <random>
#include <vector>

#include "audit/lattice_oracle.hpp"
#include "audit/quadrature.hpp"

namespace audit {

/// A step of a family of maps on a lattice, taken once more.
struct FamilyStep {
  /// Where it leads; of fields in the middle of steps only their value there. On the box's cells the means over these.
  LatticeState end;
  Bounded energy;  ///< K of theory, section 8
  std::vector<FluxPlace> places;
};

/// The families of maps on lattices (theory, section 8), in extended precision: Gauss collocation with its stages found
/// by iteration on the waves of the grid, and compositions of the waves' flow with that of the rest of S at every node.
/// What rounding in double makes of a step is found by steps that are disturbed by as much at every place where numbers
/// are rounded, several times at random: several times the largest difference is the bound.
class LatticeFamily {
public:
  LatticeFamily(const LatticeProblem& problem, const LatticeOracle& oracle);

  /// Throws if the stages are not found.
  [[nodiscard]] FamilyStep step(const LatticeState& before, double h) const;

private:
  using Complex = std::complex<long double>;
  using Matrix = std::vector<std::vector<Complex>>;
  using Waves = std::vector<std::vector<Complex>>;  ///< [field][wave]
  using Real = std::vector<std::vector<long double>>;

  struct Taken {
    Real end;
    long double energy = 0.0L;
    std::vector<Real> stages, rates;
  };
  [[nodiscard]] Taken collocate(const LatticeState& before, long double h) const;
  void disturb_stages(const LatticeState& before, long double h, Taken& taken) const;
  [[nodiscard]] std::vector<Real> stage_residual(const Real& z_0, const std::vector<Real>& Y, long double h) const;
  [[nodiscard]] std::vector<Real> stage_rounding(const LatticeState& z_0, const std::vector<Real>& Y,
                                                 long double h) const;
  void correct(const std::vector<Real>& residual, const std::vector<Matrix>& inverses, std::vector<Real>& Y) const;
  [[nodiscard]] std::vector<Matrix> preconditioner(const Real& z, long double h) const;
  void finish(const Real& z_0, const std::vector<Real>& Y, long double h, Taken& taken) const;
  [[nodiscard]] Taken compose(Real z, long double h, bool disturbed) const;
  void add_places(const Real& z, long double h, bool disturbed, Taken& taken) const;
  void drift(Real& z, long double tau, bool disturbed) const;
  void kick(Real& z, long double tau) const;
  [[nodiscard]] long double wave_energy(const Real& z) const;
  [[nodiscard]] long double rest_energy(const Real& z) const;
  [[nodiscard]] long double noise() const;

  [[nodiscard]] Waves transformed(const Real& z) const;
  [[nodiscard]] Real real(const Waves& waves) const;
  /// Of values at the nodes the means over cells, and back.
  [[nodiscard]] Real averaged(const Real& z) const;
  [[nodiscard]] Real at_nodes(const Real& means) const;
  [[nodiscard]] bool cells() const { return problem_.lagrangian == LatticeProblem::Lagrangian::box; }
  [[nodiscard]] Real start_of(const LatticeState& before) const;
  /// Σ ∂_a K_a on a wave
  [[nodiscard]] Matrix derivatives(std::size_t wave) const;
  [[nodiscard]] Real applied(const Real& z) const;  ///< Σ K_a ∂_a z
  [[nodiscard]] Matrix M() const;
  [[nodiscard]] Matrix hessian_at_zero() const;
  [[nodiscard]] Real gradient(const Real& z) const;
  [[nodiscard]] long double sum_of_S(const Real& z) const;
  [[nodiscard]] bool moves(std::size_t field) const;

  const LatticeProblem& problem_;
  const LatticeOracle& oracle_;
  std::size_t d_, nodes_;
  std::vector<std::vector<std::vector<Complex>>> dft_;  ///< of each axis, e^(-2πi jk/N)
  std::vector<Matrix> derivatives_;                     ///< of each wave
  std::vector<Complex> averages_;                       ///< what means over cells make of each wave; 1 at nodes
  Matrix L_;                                            ///< of a splitting
  Matrix a_inverse_;                                    ///< of collocation
  long double cancellation_ = 1.0L;                     ///< among its eigenvectors
  Quadrature rule_, places_;                            ///< of the stages; of the fluxes of a splitting
  mutable std::mt19937_64 random_{12345};
};

}  // namespace audit
