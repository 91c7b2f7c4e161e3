#pragma once

#include <string>

namespace rubato::program {

/// A name beside the record: its own with another ending.
[[nodiscard]] std::string beside(const std::string& record, const std::string& ending);

/// \throws std::invalid_argument if the output would take the place of the file that is read, whatever --force says
void refuse_replacing(const std::string& input, const std::string& output);

}  // namespace rubato::program
