#pragma once

#include <memory>
#include <string>
#include <vector>

#include <rubato/pde/mirrors.hpp>
#include <rubato/pde/wall_drives.hpp>

namespace rubato {

/// Lets initial data meet the walls: a field that a wall holds at 0 and that is not far from it there becomes 0 there.
/// Where a wall drives a field, this and its momentum become what that says at the start.
/// \return sentences on data that do not meet them, with their sizes: such values, and slopes of other fields
/// \throws SchemeRefusal if S is not the same in the mirror about the values that a wall holds, naming the term;
/// InitialFieldError if a field is far from what a wall holds, varies along it, or two walls hold different values
[[nodiscard]] std::vector<std::string> meet_walls(const MultisymplecticSystem& system, const Mirrors& mirrors,
                                                  InitialFields& given,
                                                  std::shared_ptr<const WallDrives> drives = nullptr);

}  // namespace rubato
