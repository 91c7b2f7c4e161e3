#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/record/detail/structure.hpp>
#include <rubato/record/together.hpp>

namespace rubato::record::detail {

namespace {

void validate_path(const std::string& path) {
  const bool well_formed = path.size() > 1 && path.front() == '/' && path.back() != '/' &&
                           path.find("//") == std::string::npos && path.find('\0') == std::string::npos &&
                           path.find('\n') == std::string::npos;
  if (!well_formed)
    throw std::invalid_argument(fmt::format("record: '{}' is not an absolute path of a dataset", path));
  if (path.starts_with("/checkpoint/") || path == "/checkpoint")
    throw std::invalid_argument(fmt::format("record: '{}' is in the checkpoint, which the writer keeps itself", path));
}

std::size_t length_of(const Scale& scale) {
  return std::visit([](const auto& values) { return values.size(); }, scale.values);
}

const Scale& scale_at(const Layout& layout, const std::string& path) {
  const auto found = std::ranges::find(layout.scales, path, &Scale::path);
  if (found == layout.scales.end())
    throw std::invalid_argument(fmt::format("record: there is no scale '{}'", path));
  return *found;
}

}  // namespace

void validate(const Layout& layout) {
  std::map<std::string, std::string> target_of;  // what each name in the file leads to
  const auto claim = [&](const std::string& name, const std::string& target) {
    const auto [place, is_new] = target_of.emplace(name, target);
    if (!is_new && place->second != target)
      throw std::invalid_argument(fmt::format("record: '{}' would be both '{}' and '{}'", name, place->second, target));
    return is_new;
  };
  const auto claim_own = [&](const std::string& path) {
    validate_path(path);
    if (!claim(path, path))
      throw std::invalid_argument(fmt::format("record: '{}' is declared twice", path));
  };

  for (const auto& scale : layout.scales) {
    claim_own(scale.path);
    if (length_of(scale) == 0)
      throw std::invalid_argument(fmt::format("record: scale '{}' is empty", scale.path));
  }
  for (const auto& dataset : layout.datasets)
    claim_own(dataset.path);
  for (const auto& [name, target] : target_of)
    for (std::size_t slash = name.find('/', 1); slash != std::string::npos; slash = name.find('/', slash + 1))
      if (target_of.contains(name.substr(0, slash)))
        throw std::invalid_argument(
            fmt::format("record: '{}' would be both a dataset and the group of '{}'", name.substr(0, slash), name));
  for (const auto& dataset : layout.datasets) {
    const auto axis = std::ranges::find(layout.datasets, dataset.axis, &Dataset::path);
    if (axis == layout.datasets.end() || axis->axis != axis->path || !axis->dimensions.empty())
      throw std::invalid_argument(
          fmt::format("record: the axis '{}' of '{}' is not a dataset that is its own axis and has one number per row",
                      dataset.axis, dataset.path));
    for (const auto& dimension : dataset.dimensions)
      (void)scale_at(layout, dimension);
    for (const auto& [link, target] : links_of(dataset))
      claim(link, target);
  }
}

std::vector<std::pair<std::string, std::string>> links_of(const Dataset& dataset) {
  const auto group_of = [](const std::string& path) { return path.substr(0, path.rfind('/')); };
  const auto name_of = [](const std::string& path) { return path.substr(path.rfind('/')); };
  std::vector<std::string> used{dataset.axis};
  used.insert(used.end(), dataset.dimensions.begin(), dataset.dimensions.end());
  std::vector<std::pair<std::string, std::string>> links;
  for (const auto& path : used)
    if (group_of(path) != group_of(dataset.path))
      links.emplace_back(group_of(dataset.path) + name_of(path), path);
  return links;
}

std::vector<hsize_t> row_shape(const Layout& layout, const Dataset& dataset) {
  std::vector<hsize_t> shape;
  for (const auto& dimension : dataset.dimensions)
    shape.push_back(length_of(scale_at(layout, dimension)));
  return shape;
}

namespace {

/// Chunks are of about so many bytes.
constexpr std::size_t target_bytes = std::size_t{128} << 10;

}  // namespace

std::vector<hsize_t> chunk_shape(const Layout& layout, const Dataset& dataset) {
  std::vector<hsize_t> row = row_shape(layout, dataset);
  const std::size_t value_bytes = size_of(dataset.type);
  constexpr std::size_t least_bytes = std::size_t{4} << 10;
  constexpr std::size_t most_bytes = std::size_t{1} << 20;
  constexpr std::size_t most_rows = 16384;

  const auto bytes = [&] {
    std::size_t product = value_bytes;
    for (const auto extent : row)
      product *= extent;
    return product;
  };
  for (auto& extent : row)
    while (bytes() > most_bytes && extent > 1)
      extent = (extent + 1) / 2;
  const std::size_t most = std::clamp<std::size_t>(target_bytes / bytes(), 1, most_rows);
  const std::size_t least = std::clamp<std::size_t>(least_bytes / bytes(), 1, most);
  row.insert(row.begin(), std::clamp(dataset.expected_rows.value_or(most), least, most));
  return row;
}

}  // namespace rubato::record::detail

namespace rubato::record {

std::size_t row_size(const Layout& layout, const Dataset& dataset) {
  std::size_t size = 1;
  for (const auto extent : detail::row_shape(layout, dataset))
    size *= extent;
  return size;
}

std::optional<double> expected_bytes(const Layout& layout, std::span<const std::optional<std::size_t>> rows) {
  constexpr double header = 2048.0;
  double bytes = 0.0;
  for (std::size_t i = 0; i < layout.datasets.size(); ++i) {
    const Dataset& dataset = layout.datasets[i];
    const auto expected = rows.empty() ? dataset.expected_rows : rows[i];
    if (!expected)
      return std::nullopt;
    bytes += header;
    if (dataset.axis.starts_with("/events/"))
      continue;  // their rows are a guess
    const auto of_chunk = static_cast<double>(detail::chunk_shape(layout, dataset).front());
    const double all = layout.compression > 0 ? static_cast<double>(*expected)
                                              : std::ceil(static_cast<double>(*expected) / of_chunk) * of_chunk;
    bytes += all * static_cast<double>(row_size(layout, dataset) * detail::size_of(dataset.type));
  }
  return bytes;
}

bool is_long(const Layout& layout, const Dataset& dataset) {
  return row_size(layout, dataset) * detail::size_of(dataset.type) >= detail::target_bytes;
}

}  // namespace rubato::record
