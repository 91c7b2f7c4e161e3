#include <cstring>

#include <rubato/record/reader.hpp>

#include "sample.hpp"

namespace sample {

namespace {

/// NaN equals NaN of the same bits, 0 differs from -0.
bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0);
}

}  // namespace

std::string difference(const std::filesystem::path& a, const std::filesystem::path& b) {
  const record::Reader first(a, record::Altered::reported);
  const record::Reader second(b, record::Altered::reported);
  const auto in_first = first.datasets();
  const auto in_second = second.datasets();
  if (in_first.size() != in_second.size())
    return "the numbers of datasets differ";
  for (std::size_t i = 0; i < in_first.size(); ++i) {
    const auto& path = in_first[i].path;
    if (path != in_second[i].path || in_first[i].is_text != in_second[i].is_text ||
        in_first[i].type != in_second[i].type || in_first[i].shape != in_second[i].shape ||
        in_first[i].dimensions != in_second[i].dimensions)
      return path + ": the shapes, types or dimensions differ";
    const bool equal = in_first[i].is_text ? first.read_strings(path) == second.read_strings(path)
                                           : same_bits(first.read(path), second.read(path));
    if (!equal)
      return path + ": the values differ";
  }
  return {};
}

}  // namespace sample
