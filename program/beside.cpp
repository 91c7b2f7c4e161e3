#include "beside.hpp"

#include <filesystem>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato::program {

std::string beside(const std::string& record, const std::string& ending) {
  std::filesystem::path path(record);
  if (path.extension() == ".h5" || path.extension() == ".hdf5") {
    path.replace_extension();
  }
  return path.string() + ending;
}

void refuse_replacing(const std::string& input, const std::string& output) {
  std::error_code ignored;
  if (std::filesystem::equivalent(input, output, ignored)) {
    throw std::invalid_argument(
        fmt::format("{}: the output would replace the file that is read; -o names another", output));
  }
}

}  // namespace rubato::program
