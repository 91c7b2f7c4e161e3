#include <rubato/study/location.hpp>

#include <fmt/format.h>

namespace rubato::study {

std::string Location::text() const {
  return line > 0 ? fmt::format("{}:{}:{}", file, line, column) : file;
}

}  // namespace rubato::study
