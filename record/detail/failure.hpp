#pragma once

#include <stdexcept>

namespace rubato::record::detail {

/// A call to HDF5, or to the system, failed. Becomes an Error where the file is known (`with_file`).
class Failure : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

/// One for lack of memory. Becomes NoMemory.
class NoMemoryFailure : public Failure {
public:
  using Failure::Failure;
};

}  // namespace rubato::record::detail
