#pragma once

#include <span>

#include <Eigen/Core>

#include <rubato/pde/initial_level.hpp>

namespace rubato {

/// Compares what the user gave for a field with what the constraints of the level determine.
///
/// A w = D u lets w differ from u_x by Δx² w_xx/12 to leading order, a twelfth of the second differences of w *there*
/// (the one-sided differences of euler-box by Δx w_x/2, half of the first). So much, several times over, is allowed,
/// and of what is rough elsewhere, such as a jump across the periodic seam, what reaches there: a spectral derivative
/// carries it on with the inverse square of the distance in cells, once neighbours are averaged. A potential is
/// compared with its periodic part and slope together, or with its periodic part, up to what its constraint leaves
/// free.
///
/// \param rows the constraints as combinations of the equation's rows
/// \throws InitialFieldError where they differ by more
void check_agreement(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation, int field,
                     const InitialFields& given, const LatticeLevel& level, const Eigen::MatrixXd& rows);

}  // namespace rubato
