#pragma once

#include <memory>

#include <rubato/pde/lattice_method.hpp>

namespace rubato {

/// `box` on a line between walls, with any number of cells, fixed levels where walls drive fields.
///
/// Laws are in cells. They hold in all of them, at driven walls as well. \throws SchemeRefusal as WallConditions; for
/// constraints that differentiate a field without an equation of motion (beams); for potentials that are held in the
/// mean
[[nodiscard]] std::unique_ptr<LatticeMethod> make_walled_box_method(const LatticeMethodChoice& choice);

}  // namespace rubato
