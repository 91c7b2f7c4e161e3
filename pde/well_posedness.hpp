#pragma once

#include <complex>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// Growth of the waves of an equation that has no continuous dependence on its data.
struct ShortWaveGrowth {
  std::vector<double> wave;   ///< k, one component for each direction: the shortest that the grid has that way
  double rate = 0.0;          ///< Re σ of e^{σt + ik·x} there, the largest
  double rate_of_half = 0.0;  ///< and for waves half as long, which finer grids have
  std::vector<double> state;  ///< about which the equation was linearised; empty: the mean of the data
};

/// Looks for waves that grow the faster the shorter they are, without bound: the problem is then ill-posed (Hadamard),
/// and what a grid shows is its rounding and truncation errors, the finer the worse.
///
/// M z_t + Σ K_a z_{x_a} = ∇S(z), linearised about a constant state, has the waves e^{σt + ik·x}c with
/// det(σM + iΣ k_a K_a - S'') = 0. The largest Re σ is looked at for the shortest waves of the grid along the axes and
/// their diagonals, and on to 64 times as short: growth by more than the third root of that, and not small beside |σ|,
/// is without bound. Instabilities of physics, such as that of modulated waves, stay below one rate and are not meant.
/// States: the mean of the level and its values at some of the nodes, those of the extremes of each field among them.
///
/// What is found with coefficients frozen is necessary for being well-posed, not sufficient.
[[nodiscard]] std::optional<ShortWaveGrowth> find_short_wave_growth(const MultisymplecticSystem& system,
                                                                    const grids::Grid& grid, const LatticeLevel& level);

/// The roots σ of det(σM - B) = 0, M skew, that are not infinite. Empty where the pencil is singular or not finite.
[[nodiscard]] std::vector<std::complex<double>> finite_roots(const Eigen::MatrixXd& M, const Eigen::MatrixXd& kernel,
                                                             const Eigen::MatrixXcd& B);

/// The same as a sentence for people, with what to look at.
[[nodiscard]] std::string describe(const ShortWaveGrowth& growth, const grids::Grid& grid,
                                   const MultisymplecticSystem& system);

}  // namespace rubato
