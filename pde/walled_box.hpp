#pragma once

#include <memory>

#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/step_equation.hpp>
#include <rubato/pde/wall_drives.hpp>

namespace rubato {

/// The box scheme on a line between walls: make_box_scheme() with any number of cells, its rows closed by
/// WallConditions. No energy passes a wall that is fixed or free, and the law of levels holds as on a ring. `drives`,
/// if any, are what walls give; levels are fixed then, and energies are less their work.
///
/// Laws are in cells. They hold in all of them, at driven walls as well. \throws SchemeRefusal as WallConditions; for
/// constraints that differentiate a field without an equation of motion (beams); for potentials that are held in the
/// mean
///@{
[[nodiscard]] std::unique_ptr<LatticeMethod> make_walled_box_method(const LatticeMethodChoice& choice);
[[nodiscard]] std::unique_ptr<LatticeScheme> make_walled_box_scheme(const MultisymplecticSystem& system,
                                                                    const grids::Grid& grid, LatticeLevel first,
                                                                    double first_step,
                                                                    const std::shared_ptr<const WallDrives>& drives);
[[nodiscard]] std::unique_ptr<StepEquation> make_walled_box_equation(const MultisymplecticSystem& system,
                                                                     const grids::Grid& grid, const LatticeLevel& first,
                                                                     double first_step,
                                                                     const std::shared_ptr<const WallDrives>& drives);
/// As midpoint_start().
[[nodiscard]] LevelHistory walled_box_start(const MultisymplecticSystem& system, const grids::Grid& grid,
                                            const LatticeLevel& first, double first_step,
                                            const std::shared_ptr<const WallDrives>& drives);
///@}

}  // namespace rubato
