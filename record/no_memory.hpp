#pragma once

#include <rubato/record/error.hpp>

namespace rubato::record {

/// HDF5 could not allocate what it needs to read or write a record.
class NoMemory : public Error {
public:
  using Error::Error;
};

}  // namespace rubato::record
