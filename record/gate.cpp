#include <algorithm>
#include <limits>
#include <map>
#include <set>
#include <span>
#include <utility>

#include <fmt/format.h>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/gate.hpp>
#include <rubato/record/detail/seal.hpp>
#include <rubato/record/detail/structure.hpp>

namespace rubato::record::detail {

namespace {

/// Deflate makes at most 1032 bytes out of one.
constexpr std::uint64_t most_deflation = 1032;
constexpr std::uint64_t largest_chunk = std::uint64_t{64} << 20;
constexpr std::size_t deepest_group = 8, most_links = 20000;
constexpr int highest_rank = 4;

std::uint64_t product(std::uint64_t a, std::uint64_t b) {
  return b != 0 && a > std::numeric_limits<std::uint64_t>::max() / b ? std::numeric_limits<std::uint64_t>::max()
                                                                     : a * b;
}

/// A link in the file, and what it leads to.
struct Link {
  std::string path;
  haddr_t address;
  bool is_group;
};

std::vector<Link> links_in(hid_t group, const std::string& path) {
  struct Collected {
    const std::string& path;
    std::vector<std::string> names;
    std::string wrong;
  } collected{path, {}, {}};
  const auto collect = [](hid_t, const char* name, const H5L_info_t* info, void* out) -> herr_t {
    auto& all = *static_cast<Collected*>(out);
    if (info->type != H5L_TYPE_HARD)
      all.wrong = fmt::format("'{}{}' is a link to a name, which may lead out of the record", all.path, name);
    else
      all.names.emplace_back(name);
    return all.wrong.empty() && all.names.size() <= most_links ? 0 : 1;
  };
  const std::string shown = path == "/" ? path : path.substr(0, path.size() - 1);
  check(H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, nullptr, collect, &collected), "listing group '" + shown + "'");
  if (!collected.wrong.empty())
    throw Failure(collected.wrong);
  std::vector<Link> links;
  for (const auto& name : collected.names) {
    H5O_info_t info;
    check(H5Oget_info_by_name2(group, name.c_str(), &info, H5O_INFO_BASIC, H5P_DEFAULT),
          fmt::format("looking at '{}{}'", path, name));
    if (info.type != H5O_TYPE_GROUP && info.type != H5O_TYPE_DATASET)
      throw Failure(fmt::format("'{}{}' is neither a group nor a dataset", path, name));
    links.push_back({path + name, info.addr, info.type == H5O_TYPE_GROUP});
  }
  return links;
}

/// All links, outer ones first. A group that is reached on two ways is a way in circles, or of no use.
void collect_links(hid_t group, const std::string& path, std::size_t depth, std::set<haddr_t>& groups,
                   std::vector<Link>& all) {
  for (Link& link : links_in(group, path)) {
    if (all.size() == most_links)
      throw Failure(fmt::format("it has more than {} links", most_links));
    all.push_back(link);
    if (!link.is_group)
      continue;
    if (!groups.insert(link.address).second)
      throw Failure(fmt::format("group '{}' is reached on two ways", link.path));
    if (depth == deepest_group)
      throw Failure(fmt::format("group '{}' is nested too deeply", link.path));
    const Handle inner(H5Gopen2(group, link.path.substr(link.path.rfind('/') + 1).c_str(), H5P_DEFAULT), H5Gclose,
                       "opening group '" + link.path + "'");
    collect_links(inner, link.path + "/", depth + 1, groups, all);
  }
}

std::vector<Link> all_links(hid_t file) {
  H5O_info_t root;
  check(H5Oget_info2(file, &root, H5O_INFO_BASIC), "looking at the file");
  std::set<haddr_t> groups{root.addr};
  std::vector<Link> links;
  collect_links(file, "/", 0, groups, links);
  return links;
}

bool is_text(hid_t type) {
  return H5Tget_class(type) == H5T_STRING && H5Tis_variable_str(type) > 0;
}

/// Filters that records use, each once. True if the data are deflated.
bool examine_filters(hid_t properties) {
  const int count = check(H5Pget_nfilters(properties), "looking at its filters");
  std::set<H5Z_filter_t> seen;
  for (unsigned i = 0; i < static_cast<unsigned>(count); ++i) {
    unsigned flags = 0;
    std::size_t no_values = 0;
    const H5Z_filter_t filter = check(H5Pget_filter2(properties, i, &flags, &no_values, nullptr, 0, nullptr, nullptr),
                                      "looking at its filters");
    const bool is_known =
        filter == H5Z_FILTER_SHUFFLE || filter == H5Z_FILTER_DEFLATE || filter == H5Z_FILTER_FLETCHER32;
    if (!is_known || !seen.insert(filter).second)
      throw Failure(fmt::format("it goes through filter {}, which records do not use{}", static_cast<int>(filter),
                                is_known ? " twice" : ""));
  }
  return seen.contains(H5Z_FILTER_DEFLATE);
}

void examine_chunks(hid_t dataset, hid_t properties, const std::vector<hsize_t>& sizes, std::uint64_t value_bytes,
                    std::uint64_t stored) {
  std::vector<hsize_t> chunk(sizes.size());
  if (H5Pget_chunk(properties, static_cast<int>(chunk.size()), chunk.data()) != static_cast<int>(sizes.size()))
    throw Failure("its chunks have another number of dimensions");
  std::uint64_t chunk_bytes = value_bytes, needed = 1;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (chunk[i] == 0)
      throw Failure("its chunks are empty");
    chunk_bytes = product(chunk_bytes, chunk[i]);
    needed = product(needed, sizes[i] / chunk[i] + (sizes[i] % chunk[i] != 0 ? 1 : 0));
  }
  if (chunk_bytes > largest_chunk)
    throw Failure(fmt::format("its chunks of {} bytes are larger than records make them", chunk_bytes));
  const bool is_deflated = examine_filters(properties);
  hsize_t held = 0;
  const Handle space(H5Dget_space(dataset), H5Sclose, "counting its chunks");
  check(H5Dget_num_chunks(dataset, space, &held), "counting its chunks");
  if (held != needed)
    throw Failure(fmt::format("by its shape it has {} chunks, but the file holds {}", needed, held));
  // Every chunk is as large as any when it is unpacked.
  if (product(chunk_bytes, needed) > (is_deflated ? product(most_deflation, stored) : stored))
    throw Failure(fmt::format("it claims more data than the {} bytes that the file holds of it", stored));
}

/// \returns the bytes that the file holds of it
std::uint64_t examine_storage(hid_t dataset, std::uint64_t file_bytes) {
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose, "looking at it");
  const Handle type(H5Dget_type(dataset), H5Tclose, "looking at its type");
  const Handle space(H5Dget_space(dataset), H5Sclose, "looking at its shape");
  if (H5Sget_simple_extent_type(space) != H5S_SIMPLE)
    throw Failure("it has no shape");
  if (!is_text(type) && !is_number(type))
    throw Failure("it is of a type that records do not use");
  const auto sizes = extent(dataset);
  if (sizes.empty() || sizes.size() > highest_rank)
    throw Failure(fmt::format("it has {} dimensions", sizes.size()));
  if (check(H5Pget_external_count(properties), "looking at its files") != 0)
    throw Failure("its data are in another file");

  const std::uint64_t value_bytes = H5Tget_size(type);
  std::uint64_t claimed = value_bytes;
  for (const hsize_t size : sizes)
    claimed = product(claimed, size);
  const std::uint64_t stored = H5Dget_storage_size(dataset);
  switch (H5Pget_layout(properties)) {
    case H5D_CHUNKED: examine_chunks(dataset, properties, sizes, value_bytes, stored); break;
    case H5D_CONTIGUOUS:
      if (claimed > 0 && H5Dget_offset(dataset) == HADDR_UNDEF)
        throw Failure("it claims data, but the file holds none of it");
      [[fallthrough]];
    case H5D_COMPACT:
      if (claimed > stored)
        throw Failure(fmt::format("it claims {} bytes, but the file holds {} of it", claimed, stored));
      break;
    default: throw Failure("its data are put together from other datasets");
  }
  if (stored > file_bytes)
    throw Failure(fmt::format("it claims {} bytes of a file of {}", stored, file_bytes));
  return stored;
}

/// The attributes that are read of a dataset.
void examine_attributes(hid_t dataset, const std::string& path) {
  if (has_attribute(dataset, "description"))
    (void)read_text_attribute(dataset, "description");
  if (has_attribute(dataset, rows_attribute)) {
    const auto rows = read_integer_attribute(dataset, rows_attribute);
    const auto sizes = extent(dataset);
    if (rows < 0 || static_cast<hsize_t>(rows) > sizes.front())
      throw Failure(fmt::format("it should have {} rows, but has {}", rows, sizes.front()));
  }
  (void)dimension_names(dataset, path);
}

/// The scales along a growing dataset lie in its own group, named as its dimensions are, and are as long.
void examine_scales(hid_t file, hid_t dataset, const std::string& path) {
  const auto sizes = extent(dataset);
  const auto names = dimension_names(dataset, path);
  const std::string group = path.substr(0, path.rfind('/') + 1);
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (names[i].empty() || names[i].find('/') != std::string::npos || names[i] == ".")
      throw Failure(fmt::format("its dimension {} has no name (attribute 'DIMENSION_LABELS')", i));
    const std::string scale_path = group + names[i];
    H5O_info_t info;
    const bool exists = H5Lexists(file, scale_path.c_str(), H5P_DEFAULT) > 0 &&
                        H5Oget_info_by_name2(file, scale_path.c_str(), &info, H5O_INFO_BASIC, H5P_DEFAULT) >= 0 &&
                        info.type == H5O_TYPE_DATASET;
    if (!exists)
      throw Failure(fmt::format("there is no scale '{}' along its dimension {}", scale_path, i));
    const auto scale = extent(open_dataset(file, scale_path));
    if (scale.size() != 1 || scale[0] != sizes[i])
      throw Failure(fmt::format("along '{}' it has {} values, and the scale has {}", scale_path, sizes[i],
                                scale.empty() ? 1 : scale[0]));
  }
}

/// Calls `look` with a dataset; what it finds wrong is wrong with that one.
template <class Look>
void at_dataset(hid_t file, const std::string& path, const Look& look) {
  try {
    look(open_dataset(file, path));
  } catch (const Failure& failure) {
    const std::string reason = failure.what();
    throw Failure(reason.find("'" + path + "'") != std::string::npos ? reason
                                                                     : fmt::format("dataset '{}': {}", path, reason));
  }
}

void examine(hid_t file, std::uint64_t file_bytes) {
  check_format(file);
  for (const char* name : {"title", "problem", "version", "compiler"})
    (void)read_text_attribute(file, name);
  if (const auto threads = read_integer_attribute(file, "threads"); threads < 1 || threads > 1'000'000)
    throw Failure(fmt::format("attribute 'threads' is {}", threads));
  if (const auto finished = read_integer_attribute(file, "finished"); finished < 0 || finished > 1)
    throw Failure(fmt::format("attribute 'finished' is {}, neither 0 nor 1", finished));

  const std::vector<Link> links = all_links(file);
  check_contents(file);
  compare_list(file);
  std::map<haddr_t, std::string> seen;
  std::uint64_t stored = 0;
  const auto last_name = [](const std::string& path) { return path.substr(path.rfind('/') + 1); };
  for (const Link& link : links) {
    if (link.is_group)
      continue;
    // Axes are linked where they serve, under their name.
    if (const auto [found, is_new] = seen.emplace(link.address, link.path); !is_new) {
      if (last_name(found->second) != last_name(link.path))
        throw Failure(fmt::format("'{}' and '{}' are one dataset", found->second, link.path));
      continue;
    }
    at_dataset(file, link.path, [&](hid_t dataset) {
      stored += examine_storage(dataset, file_bytes);
      examine_attributes(dataset, link.path);
      if (stored > file_bytes)
        throw Failure(fmt::format("it and those before it claim {} bytes of a file of {}", stored, file_bytes));
    });
  }
  for (const Link& link : links)
    if (!link.is_group)
      at_dataset(file, link.path, [&](hid_t dataset) {
        if (has_attribute(dataset, rows_attribute))
          examine_scales(file, dataset, link.path);
      });
  if (check(H5Lexists(file, "/checkpoint", H5P_DEFAULT), "looking for the checkpoint") > 0)
    examine_checkpoint(file);
}

/// A file without a mark that goes on after what HDF5 knows of had one, or something was appended to it.
void require_end(hid_t file, int descriptor) {
  haddr_t end = 0;
  check(H5Fget_eoa(file, &end), "looking for its end");
  if (const std::uint64_t size = size_of(descriptor); size != end)
    throw Failure(fmt::format("is damaged: it has {} bytes, and its end is not that of a record (truncated?)", size));
}

[[noreturn]] void explain_damage(hid_t file) {
  for (const Link& link : all_links(file))
    if (!link.is_group)
      at_dataset(file, link.path, [&](hid_t dataset) {
        try {
          (void)examine_storage(dataset, std::numeric_limits<std::uint64_t>::max());
          const Handle type(H5Dget_type(dataset), H5Tclose, "looking at its type");
          if (is_number(type))
            read_through(dataset, [](std::span<const std::byte>) {});  // the checksums of its chunks are compared
        } catch (const Failure& failure) {
          throw Failure(fmt::format("dataset '{}' is damaged: {}", link.path, failure.what()));
        }
      });
  throw Failure(
      "is damaged: its bytes are not those that were written, by the checksum at its end, in what belongs to no "
      "dataset of "
      "numbers (attributes, texts, indices)");
}

}  // namespace

Integrity admit(hid_t file, int descriptor) {
  const Integrity integrity = integrity_of(descriptor);
  switch (integrity) {
    case Integrity::damaged: explain_damage(file);
    case Integrity::unknown: require_end(file, descriptor); break;
    case Integrity::intact: break;
  }
  examine(file, size_of(descriptor));
  return integrity;
}

std::vector<std::string> dimension_names(hid_t dataset, const std::string& path) {
  constexpr const char* name = "DIMENSION_LABELS";
  const std::size_t rank = extent(dataset).size();
  if (!has_attribute(dataset, name))
    return std::vector<std::string>(rank);
  try {
    return read_text_list(dataset, name, rank);
  } catch (const Failure& failure) {
    throw Failure(fmt::format("dataset '{}': {}", path, failure.what()));
  }
}

}  // namespace rubato::record::detail
