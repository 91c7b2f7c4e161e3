#include <rubato/record/detail/seal.hpp>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <span>
#include <string_view>

#include <fmt/format.h>

#include <rubato/record/detail/gate.hpp>
#include <rubato/record/detail/structure.hpp>

namespace rubato::record::detail {

namespace {

constexpr std::string_view checkpoint_path = "/checkpoint";
constexpr std::array texts{"compiler", "contents", "format", "problem", "title", "version"};
constexpr std::array integers{"finished", "threads"};

/// Every piece ends with a byte that texts do not have, so that none can pass for the beginning of the next.
void add(Checksum& checksum, std::string_view text) {
  checksum.add(std::as_bytes(std::span(text)));
  checksum.add(std::array{std::byte{0}});
}

// ---- attributes

std::uint64_t checksum_of_attribute(hid_t file, const char* name) {
  Checksum checksum;
  add(checksum, std::ranges::find(texts, std::string_view(name)) != texts.end()
                    ? read_text_attribute(file, name)
                    : fmt::format("{}", read_integer_attribute(file, name)));
  return checksum.value();
}

/// A text of fixed length, as the attributes of dimension scales are; empty where there is none of that kind.
std::string short_text(hid_t object, const char* name) {
  if (!has_attribute(object, name))
    return {};
  const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose, "reading an attribute");
  const Handle type(H5Aget_type(attribute), H5Tclose, "reading an attribute");
  const Handle space(H5Aget_space(attribute), H5Sclose, "reading an attribute");
  constexpr std::size_t longest = 4096;
  const std::size_t size = H5Tget_size(type);
  if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0 || size > longest ||
      H5Sget_simple_extent_npoints(space) != 1)
    return {};
  std::string text(size, '\0');
  check(H5Aread(attribute, type, text.data()), "reading an attribute");
  return text.substr(0, text.find('\0'));
}

/// The scales attached to each dimension, as the places of their headers in the file; empty if it is not such a list.
std::vector<std::vector<haddr_t>> attached_scales(hid_t dataset, std::size_t rank) {
  constexpr const char* name = "DIMENSION_LIST";
  if (!has_attribute(dataset, name))
    return {};
  const std::string doing = fmt::format("reading attribute '{}'", name);
  const Handle attribute(H5Aopen(dataset, name, H5P_DEFAULT), H5Aclose, doing);
  const Handle type(H5Aget_type(attribute), H5Tclose, doing);
  const Handle space(H5Aget_space(attribute), H5Sclose, doing);
  if (H5Tget_class(type) != H5T_VLEN || H5Sget_simple_extent_npoints(space) != static_cast<hssize_t>(rank))
    return {};
  if (const Handle reference(H5Tget_super(type), H5Tclose, doing); H5Tequal(reference, H5T_STD_REF_OBJ) <= 0)
    return {};
  std::vector<hvl_t> lists(rank);
  check(H5Aread(attribute, type, lists.data()), doing);
  std::vector<std::vector<haddr_t>> places;
  for (const hvl_t& list : lists) {
    const auto* const begin = static_cast<const hobj_ref_t*>(list.p);
    places.emplace_back(begin, begin + (begin != nullptr ? list.len : 0));
  }
  H5Dvlen_reclaim(type, space, H5P_DEFAULT, lists.data());
  return places;
}

haddr_t place_of(hid_t file, const std::string& path) {
  H5O_info_t info;
  check(H5Oget_info_by_name2(file, path.c_str(), &info, H5O_INFO_BASIC, H5P_DEFAULT), "looking at '" + path + "'");
  return info.addr;
}

// ---- datasets

void add_values(Checksum& checksum, hid_t dataset) {
  const Handle type(H5Dget_type(dataset), H5Tclose, "reading a type");
  if (is_number(type))
    read_through(dataset, [&](std::span<const std::byte> bytes) { checksum.add(bytes); });
  else
    for (const std::string& text : read_texts(dataset))
      add(checksum, text);
}

/// What says how the values are to be read.
void add_shape(Checksum& checksum, hid_t file, hid_t dataset, const std::string& path) {
  const Handle type(H5Dget_type(dataset), H5Tclose, "reading a type");
  add(checksum, is_number(type) ? fmt::format("type {}", static_cast<int>(type_of(type))) : "text");
  const auto sizes = extent(dataset);
  const auto names = dimension_names(dataset, path);
  const auto scales = attached_scales(dataset, sizes.size());
  const std::string group = path.substr(0, path.rfind('/') + 1);
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    add(checksum, fmt::format("{} along {}", sizes[i], names[i]));
    const bool is_attached = i < scales.size() && scales[i].size() == 1 && !names[i].empty() &&
                             H5Lexists(file, (group + names[i]).c_str(), H5P_DEFAULT) > 0 &&
                             scales[i].front() == place_of(file, group + names[i]);
    add(checksum, is_attached ? "attached" : "not attached");
  }
  if (has_attribute(dataset, rows_attribute))
    add(checksum, fmt::format("rows {}", read_integer_attribute(dataset, rows_attribute)));
  if (has_attribute(dataset, "description"))
    add(checksum, "description " + read_text_attribute(dataset, "description"));
  add(checksum, short_text(dataset, "CLASS"));
  add(checksum, short_text(dataset, "NAME"));
}

bool is_in_checkpoint(std::string_view path) {
  return path.starts_with(checkpoint_path) && path.substr(checkpoint_path.size()).starts_with('/');
}

/// Calls `use(path, checksum)` for each path of a dataset outside the checkpoint; each dataset is read once, unless
/// `values` has what its values make.
template <class Use>
void for_each_dataset(hid_t file, const std::map<std::string, Checksum>& values, const Use& use) {
  std::map<haddr_t, Checksum> known;
  for (const auto& [path, checksum] : values)
    known.emplace(place_of(file, path), checksum);
  for (const std::string& path : dataset_paths(file)) {
    if (is_in_checkpoint(path))
      continue;
    try {
      const Handle dataset = open_dataset(file, path);
      const auto [place, is_new] = known.try_emplace(place_of(file, path));
      if (is_new)
        add_values(place->second, dataset);
      Checksum checksum = place->second;
      add_shape(checksum, file, dataset, path);
      use(path, checksum.value());
    } catch (const Failure& failure) {
      throw Failure(fmt::format("dataset '{}': {}", path, failure.what()));
    }
  }
}

// ---- the seal

constexpr std::string_view attribute_kind = "attribute", dataset_kind = "dataset", group_kind = "group";

using Seal = std::map<std::string, std::uint64_t>;  ///< by "KIND NAME"

std::string key(std::string_view kind, std::string_view name) {
  return fmt::format("{} {}", kind, name);
}

[[noreturn]] void refuse_seal(std::string_view line) {
  throw Failure(fmt::format("attribute '{}' has the line '{}', which is not a checksum with its name", seal_attribute,
                            line.substr(0, 80)));
}

/// Empty if there is none.
Seal read_seal(hid_t file) {
  Seal seal;
  if (!has_attribute(file, seal_attribute))
    return seal;
  const std::string text = read_text_attribute(file, seal_attribute);
  for (std::size_t begin = 0, end = 0; begin < text.size(); begin = end + 1) {
    end = std::min(text.find('\n', begin), text.size());
    const std::string_view line(text.data() + begin, end - begin);
    constexpr std::size_t digits = 16;
    std::uint64_t checksum = 0;
    if (line.size() <= digits + 1 || line[digits] != ' ')
      refuse_seal(line);
    if (const auto read = std::from_chars(line.data(), line.data() + digits, checksum, 16);
        read.ptr != line.data() + digits || !seal.emplace(line.substr(digits + 1), checksum).second)
      refuse_seal(line);
  }
  if (seal.empty())
    refuse_seal("");
  return seal;
}

template <class Use>
void for_each_attribute(const Use& use) {
  for (const char* name : texts)
    use(name);
  for (const char* name : integers)
    use(name);
}

}  // namespace

void write_seal(hid_t file, const std::map<std::string, Checksum>& values) {
  std::string text;
  const auto add_line = [&](std::string_view kind, std::string_view name, std::uint64_t checksum) {
    text += fmt::format("{}{:016x} {} {}", text.empty() ? "" : "\n", checksum, kind, name);
  };
  for_each_attribute([&](const char* name) { add_line(attribute_kind, name, checksum_of_attribute(file, name)); });
  for_each_dataset(file, values,
                   [&](const std::string& path, std::uint64_t checksum) { add_line(dataset_kind, path, checksum); });
  add_line(group_kind, checkpoint_path, static_cast<std::uint64_t>(stored_checkpoint_checksum(file)));
  write_attribute(file, seal_attribute, text);
}

void compare_list(hid_t file) {
  Seal seal = read_seal(file);
  if (seal.empty())
    return;
  for_each_attribute([&](const char* name) {
    if (seal.erase(key(attribute_kind, name)) == 0)
      throw Failure(fmt::format("attribute '{}' has no checksum of the attribute '{}'", seal_attribute, name));
    (void)checksum_of_attribute(file, name);  // it is there
  });
  if (seal.erase(key(group_kind, checkpoint_path)) == 0)
    throw Failure(fmt::format("attribute '{}' has no checksum of the checkpoint", seal_attribute));
  for (const std::string& path : dataset_paths(file))
    if (!is_in_checkpoint(path) && seal.erase(key(dataset_kind, path)) == 0)
      throw Failure(
          fmt::format("dataset '{}' has no checksum in the attribute '{}': it is not one that the record was "
                      "written with",
                      path, seal_attribute));
  if (!seal.empty())
    throw Failure(fmt::format("there is no {}, though the attribute '{}' of the record has its checksum",
                              seal.begin()->first, seal_attribute));
}

std::vector<std::string> altered_names(hid_t file) {
  std::vector<std::string> altered;
  const Seal seal = read_seal(file);
  if (seal.empty())
    return altered;
  const auto compare = [&](std::string_view kind, const std::string& name, std::uint64_t checksum) {
    if (const auto found = seal.find(key(kind, name)); found == seal.end() || found->second != checksum)
      altered.push_back(name);
  };
  for_each_attribute([&](const char* name) { compare(attribute_kind, name, checksum_of_attribute(file, name)); });
  compare(group_kind, std::string(checkpoint_path), static_cast<std::uint64_t>(stored_checkpoint_checksum(file)));
  for_each_dataset(file, {},
                   [&](const std::string& path, std::uint64_t checksum) { compare(dataset_kind, path, checksum); });
  return altered;
}

void require_unaltered(hid_t file) {
  if (const auto altered = altered_names(file); !altered.empty()) {
    const std::string& name = altered.front();
    const auto kind = name.front() != '/' ? attribute_kind : name == checkpoint_path ? group_kind : dataset_kind;
    throw Failure(fmt::format("{} '{}' is not what was written, by its checksum in the attribute '{}'", kind, name,
                              seal_attribute));
  }
}

}  // namespace rubato::record::detail
