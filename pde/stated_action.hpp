#pragma once

#include <memory>
#include <vector>

#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/wall_drives.hpp>
#include <rubato/variation/corner_density.hpp>
#include <rubato/variation/lattice_action.hpp>

namespace rubato {

/// An action from which a scheme is made (ActionRows), for S without its constant.
struct StatedAction {
  LatticeAction action;
  bool is_symmetric = false;  ///< 𝕊 of a step is minus that of the step back
  /// Of the action's variables: see cell_equations() of corner_density.hpp; empty where there are none.
  std::vector<formula::Expression> cell_equations;
  std::shared_ptr<const WallDrives> drives = nullptr;  ///< null where no wall drives a field
  std::vector<double> typical = {};  ///< fields at a node of the initial level, or none: L is defined near them

  /// True if the action reads the field.
  [[nodiscard]] bool names(int field) const;
};

/// That of a density, without the constant that it is a sum with: the energy's zero is that of S without its own.
[[nodiscard]] StatedAction state_action(const MultisymplecticSystem& system, CornerDensity density,
                                        std::shared_ptr<const WallDrives> drives = nullptr);

/// For StatedAction::typical.
[[nodiscard]] std::vector<double> typical_values(const LatticeLevel& level);

}  // namespace rubato
