#pragma once

#include <memory>

#include <rubato/pde/lattice_method.hpp>

namespace rubato {

/// A method between walls: that of the ring on which fields go on in mirrors (Mirrors, theory, section 12), of which
/// levels, laws and rows of the equation are the part between the walls. Energies are those of that part. The first
/// level's cautions report data that do not meet the walls.
/// \throws SchemeRefusal if the method is not the same in a mirror
[[nodiscard]] std::unique_ptr<LatticeMethod> make_mirrored_method(std::unique_ptr<LatticeMethod> method,
                                                                  const LatticeMethodChoice& choice);

/// `box` on a line between walls, with any number of cells, fixed levels where walls drive fields.
///
/// Laws are in cells. They hold in all of them, at driven walls as well. \throws SchemeRefusal as WallConditions; for
/// constraints that differentiate a field without an equation of motion (beams); for potentials that are held in the
/// mean
[[nodiscard]] std::unique_ptr<LatticeMethod> make_box_between_walls(const LatticeMethodChoice& choice);

}  // namespace rubato
