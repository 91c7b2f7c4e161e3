#pragma once

#include <string>

#include <fmt/format.h>

/// What the programs of this folder find wrong.
namespace children {

inline int failures = 0;

inline void expect(bool holds, const std::string& what) {
  if (!holds) {
    fmt::print("FAILED: {}\n", what);
    ++failures;
  }
}

}  // namespace children
