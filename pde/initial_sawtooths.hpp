#pragma once

#include <vector>

#include <Eigen/Core>

#include <rubato/pde/initial_level.hpp>

namespace rubato {

/// Takes from the given fields of a level the sawtooths that no solution of its constraints can have. Where the
/// derivatives of an even number of cells vanish (StillWaves), a left kernel vector l of the constraints leaves
/// lᵀ∇S(z) = 0 alone: u = φ_x, say, wants the Nyquist mode of u to be 0. What is taken is the smallest change that does
/// it, c (-1)^i with constant c.
///
/// \param computed the fields that the constraints give; the others are the user's
/// \param left the kernel vectors as columns, one entry for each row of the equation
void remove_sawtooths(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
                      const std::vector<int>& computed, const Eigen::MatrixXd& left, LatticeLevel& level);

}  // namespace rubato
