#pragma once

#include <string>

namespace rubato::program {

/// A name beside the record: its own with another ending.
[[nodiscard]] std::string beside(const std::string& record, const std::string& ending);

}  // namespace rubato::program
