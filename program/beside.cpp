#include "beside.hpp"

#include <filesystem>

namespace rubato::program {

std::string beside(const std::string& record, const std::string& ending) {
  std::filesystem::path path(record);
  if (path.extension() == ".h5" || path.extension() == ".hdf5") {
    path.replace_extension();
  }
  return path.string() + ending;
}

}  // namespace rubato::program
