#pragma once

#include <string>

#include "../folder.hpp"

/// Files that were once handled wrongly, one folder for all of them.
namespace rubato::defect_tests {

[[nodiscard]] inline std::string defect_file(const std::string& name) {
  return std::string(RUBATO_DEFECT_FILES) + "/" + name;
}

}  // namespace rubato::defect_tests
