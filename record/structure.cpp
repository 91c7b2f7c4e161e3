#include <algorithm>
#include <set>
#include <string_view>

#include <fmt/format.h>
#include <hdf5_hl.h>

#include <rubato/record/detail/structure.hpp>
#include <rubato/record/together.hpp>

namespace rubato::record::detail {

namespace {

Handle creating_groups() {
  Handle properties(H5Pcreate(H5P_LINK_CREATE), H5Pclose, "preparing links");
  check(H5Pset_create_intermediate_group(properties, 1), "preparing links");
  return properties;
}

std::string name_of(const std::string& path) {
  return path.substr(path.rfind('/') + 1);
}

void make_scale(hid_t dataset, const std::string& path) {
  check(H5DSset_scale(dataset, name_of(path).c_str()), "making '" + path + "' a scale");
}

/// For texts of variable length, of which HDF5 holds as many as fit into buffers of its own, which it clears: a
/// megabyte each where nothing is said, for a dozen names.
Handle text_transfer() {
  Handle transfer(H5Pcreate(H5P_DATASET_XFER), H5Pclose, "preparing texts");
  check(H5Pset_buffer(transfer, std::size_t{1} << 14, nullptr, nullptr), "preparing texts");
  return transfer;
}

void create_scale(hid_t file, const Scale& scale) {
  const std::string doing = "writing scale '" + scale.path + "'";
  const auto create = [&](hid_t type, hsize_t count) {
    const Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose, doing);
    return Handle(H5Dcreate2(file, scale.path.c_str(), type, space, creating_groups(), H5P_DEFAULT, H5P_DEFAULT),
                  H5Dclose, doing);
  };
  Handle dataset;
  if (const auto* numbers = std::get_if<std::vector<double>>(&scale.values)) {
    dataset = create(H5T_IEEE_F64LE, numbers->size());
    check(H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers->data()), doing);
  } else {
    std::vector<const char*> texts;
    for (const auto& text : std::get<std::vector<std::string>>(scale.values))
      texts.push_back(text.c_str());
    const Handle type = text_type();
    dataset = create(type, texts.size());
    check(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, text_transfer(), texts.data()), doing);
  }
  make_scale(dataset, scale.path);
  if (!scale.description.empty())
    write_attribute(dataset, "description", scale.description);
}

void create_dataset(hid_t file, const Layout& layout, const Dataset& description) {
  const std::string doing = "making dataset '" + description.path + "'";
  std::vector<hsize_t> sizes = row_shape(layout, description);
  const std::vector<hsize_t> chunk = chunk_shape(layout, description);
  sizes.insert(sizes.begin(), 0);
  std::vector<hsize_t> limits = sizes;
  limits.front() = H5S_UNLIMITED;

  const Handle space(H5Screate_simple(static_cast<int>(sizes.size()), sizes.data(), limits.data()), H5Sclose, doing);
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, doing);
  check(H5Pset_chunk(properties, static_cast<int>(chunk.size()), chunk.data()), doing);
  if (layout.compression > 0) {
    check(H5Pset_shuffle(properties), doing);
    check(H5Pset_deflate(properties, static_cast<unsigned>(layout.compression)), doing);
  }
  if (description.together && layout.compression == 0 && is_long(layout, description)) {
    check(H5Pset_alloc_time(properties, H5D_ALLOC_TIME_EARLY), doing);
    check(H5Pset_fill_time(properties, H5D_FILL_TIME_NEVER), doing);
  }
  const Handle dataset(H5Dcreate2(file, description.path.c_str(), stored_type(description.type), space,
                                  creating_groups(), properties, H5P_DEFAULT),
                       H5Dclose, doing);
  write_attribute(dataset, rows_attribute, Type::i64, 0);
  if (!description.description.empty())
    write_attribute(dataset, "description", description.description);
  if (description.axis == description.path)
    make_scale(dataset, description.path);
}

void attach(hid_t dataset, hid_t file, unsigned dimension, const std::string& scale_path) {
  const Handle scale = open_dataset(file, scale_path);
  check(H5DSattach_scale(dataset, scale, dimension), "attaching scale '" + scale_path + "'");
  check(H5DSset_label(dataset, dimension, name_of(scale_path).c_str()), "naming a dimension");
}

void attach_dimensions(hid_t file, const Dataset& description) {
  const Handle dataset = open_dataset(file, description.path);
  if (description.axis == description.path)  // HDF5 does not attach a scale to itself
    check(H5DSset_label(dataset, 0, name_of(description.path).c_str()), "naming a dimension");
  else
    attach(dataset, file, 0, description.axis);
  unsigned dimension = 1;
  for (const auto& path : description.dimensions)
    attach(dataset, file, dimension++, path);
  for (const auto& [link, target] : links_of(description))
    if (check(H5Lexists(file, link.c_str(), H5P_DEFAULT), "looking for a link") == 0)
      check(H5Lcreate_hard(file, target.c_str(), file, link.c_str(), creating_groups(), H5P_DEFAULT),
            "linking '" + link + "'");
}

void compare_scale(hid_t file, const Scale& scale) {
  const Handle dataset = open_dataset(file, scale.path);
  bool equal = false;
  if (const auto* texts = std::get_if<std::vector<std::string>>(&scale.values)) {
    equal = read_texts(dataset) == *texts;
  } else {
    const auto& numbers = std::get<std::vector<double>>(scale.values);
    if (extent(dataset) == std::vector<hsize_t>{numbers.size()}) {
      std::vector<double> stored(numbers.size());
      read_rows(dataset, H5T_NATIVE_DOUBLE, 0, stored.size(), stored.data());
      equal = stored == numbers;
    }
  }
  if (!equal)
    throw Failure(fmt::format("scale '{}' differs from that of the run to be resumed", scale.path));
}

void compare_dataset(hid_t file, const Layout& layout, const Dataset& description) {
  const Handle dataset = open_dataset(file, description.path);
  std::vector<hsize_t> sizes = extent(dataset);
  const Handle type(H5Dget_type(dataset), H5Tclose, "reading a type");
  if (!has_attribute(dataset, rows_attribute) || sizes.empty() ||
      std::vector<hsize_t>(sizes.begin() + 1, sizes.end()) != row_shape(layout, description) ||
      H5Tequal(type, stored_type(description.type)) <= 0)
    throw Failure(
        fmt::format("dataset '{}' has another shape or type than that of the run to be resumed", description.path));
}

}  // namespace

std::vector<hsize_t> chunk_of(hid_t dataset) {
  const std::string doing = "reading how a dataset is stored";
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose, doing);
  std::vector<hsize_t> chunk(extent(dataset).size());
  if (H5Pget_layout(properties) != H5D_CHUNKED ||
      H5Pget_chunk(properties, static_cast<int>(chunk.size()), chunk.data()) != static_cast<int>(chunk.size()) ||
      chunk.empty() || chunk.front() == 0)
    throw Failure("a dataset that grows is not stored in chunks");
  return chunk;
}

bool is_for_ranks(hid_t dataset) {
  const std::string doing = "reading how a dataset is stored";
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose, doing);
  H5D_alloc_time_t time = H5D_ALLOC_TIME_DEFAULT;
  check(H5Pget_alloc_time(properties, &time), doing);
  return time == H5D_ALLOC_TIME_EARLY && H5Pget_nfilters(properties) == 0;
}

std::vector<std::string> read_texts(hid_t dataset) {
  const Handle stored(H5Dget_type(dataset), H5Tclose, "reading texts");
  const auto sizes = extent(dataset);
  if (H5Tis_variable_str(stored) <= 0 || sizes.size() != 1)
    throw Failure("the dataset is not a list of texts");
  std::vector<char*> characters(sizes[0]);
  const Handle type = text_type();
  const Handle space(H5Dget_space(dataset), H5Sclose, "reading texts");
  check(H5Dread(dataset, type, H5S_ALL, H5S_ALL, text_transfer(), characters.data()), "reading texts");
  std::vector<std::string> texts;
  for (const char* text : characters)
    texts.emplace_back(text ? text : "");
  H5Dvlen_reclaim(type, space, H5P_DEFAULT, characters.data());
  return texts;
}

void write_root_attributes(hid_t file, const Layout& layout) {
  write_attribute(file, "title", layout.title);
  write_attribute(file, "problem", layout.problem);
  write_attribute(file, "version", layout.version);
  write_attribute(file, "compiler", layout.compiler);
  write_attribute(file, "threads", Type::i32, layout.threads);
}

void create_structure(hid_t file, const Layout& layout) {
  write_attribute(file, "format", format_name);
  write_root_attributes(file, layout);
  write_attribute(file, "finished", Type::u8, 0);
  for (const auto& scale : layout.scales)
    create_scale(file, scale);
  for (const auto& dataset : layout.datasets)
    create_dataset(file, layout, dataset);
  for (const auto& dataset : layout.datasets)
    attach_dimensions(file, dataset);
  write_attribute(file, contents_attribute, fmt::format("{}", fmt::join(dataset_paths(file), "\n")));
}

void check_contents(hid_t file) {
  if (!has_attribute(file, contents_attribute))
    return;
  const std::string contents = read_text_attribute(file, contents_attribute);
  const auto paths = dataset_paths(file);
  const std::set<std::string_view> present(paths.begin(), paths.end());
  for (std::size_t begin = 0; begin < contents.size();) {
    const std::size_t end = std::min(contents.find('\n', begin), contents.size());
    const std::string_view path(contents.data() + begin, end - begin);
    if (!present.contains(path))
      throw Failure(
          fmt::format("no dataset '{}', though the attribute '{}' of the record names it", path, contents_attribute));
    begin = end + 1;
  }
}

void compare_structure(hid_t file, const Layout& layout) {
  for (const auto& scale : layout.scales)
    compare_scale(file, scale);
  std::set<std::string> known;
  for (const auto& dataset : layout.datasets) {
    compare_dataset(file, layout, dataset);
    known.insert(dataset.path);
    for (const auto& [link, target] : links_of(dataset))
      known.insert(link);
  }
  for (const auto& path : dataset_paths(file))
    if (!known.contains(path) && has_attribute(open_dataset(file, path), rows_attribute))
      throw Failure(fmt::format("dataset '{}' is unknown to the run to be resumed", path));
}

void check_format(hid_t file) {
  if (!has_attribute(file, "format"))
    throw Failure("not a record: it has no attribute 'format'");
  const std::string format = read_text_attribute(file, "format");
  if (format != format_name)
    throw Failure(fmt::format("its format is '{}', this version reads '{}'", format, format_name));
}

std::vector<std::string> dataset_paths(hid_t file) {
  std::vector<std::string> paths;
  const auto collect = [](hid_t group, const char* name, const H5L_info_t*, void* list) -> herr_t {
    H5O_info_t info;
    if (H5Oget_info_by_name2(group, name, &info, H5O_INFO_BASIC, H5P_DEFAULT) < 0)
      return -1;
    if (info.type == H5O_TYPE_DATASET)
      static_cast<std::vector<std::string>*>(list)->push_back(std::string("/").append(name));
    return 0;
  };
  check(H5Lvisit(file, H5_INDEX_NAME, H5_ITER_INC, collect, &paths), "listing the datasets");
  return paths;
}

}  // namespace rubato::record::detail
