#pragma once

#include <cstdlib>
#include <stdexcept>
#include <string>

namespace rubato {

/// What the environment variable RUBATO_LANES says: how many doubles kernels are to take side by side (2, 4 or 8). 0
/// where it says nothing: as many as the machine can. Results do not depend on it, which is what the variable is for:
/// the tests are run with each value. \throws std::invalid_argument if the variable has another value
inline int lanes_asked_for() {
  static const int lanes = [] {
    const char* text = std::getenv("RUBATO_LANES");
    const std::string value = text == nullptr ? "" : text;
    if (value.empty()) {
      return 0;
    }
    if (value != "2" && value != "4" && value != "8") {
      throw std::invalid_argument("the environment variable RUBATO_LANES has to be 2, 4 or 8; it is " + value);
    }
    return std::stoi(value);
  }();
  return lanes;
}

}  // namespace rubato
