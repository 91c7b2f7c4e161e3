#include <rubato/problem/location.hpp>

#include <fmt/format.h>

namespace rubato {

std::string Location::text() const {
  return line > 0 ? fmt::format("{}:{}:{}", file, line, column) : file;
}

}  // namespace rubato
