#include <algorithm>
#include <cstring>
#include <initializer_list>

#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record::detail {

namespace {

std::recursive_mutex& process_lock() {
  static std::recursive_mutex mutex;
  return mutex;
}

/// HDF5 wraps the system's message in a line of internals; the user wants the message.
std::string essence(const std::string& description) {
  static constexpr std::string_view mark = "error message = '";
  const auto begin = description.find(mark);
  if (begin == std::string::npos)
    return description;
  const auto end = description.find('\'', begin + mark.size());
  return description.substr(begin + mark.size(), end - begin - mark.size());
}

Handle access_without_locks() {
  Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "preparing file access");
  check(H5Pset_file_locking(access, false, true), "preparing file access");
  // Closing the file closes whatever is still open in it, so that closing is never silently put off.
  check(H5Pset_fclose_degree(access, H5F_CLOSE_STRONG), "preparing file access");
  check(H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_LATEST), "preparing file access");
  return access;
}

Handle select_rows(hid_t space, hsize_t first, hsize_t count) {
  const int rank = check(H5Sget_simple_extent_ndims(space), "selecting rows");
  std::vector<hsize_t> sizes(rank);
  std::vector<hsize_t> start(rank, 0);
  check(H5Sget_simple_extent_dims(space, sizes.data(), nullptr), "selecting rows");
  start.at(0) = first;
  sizes.at(0) = count;
  check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, sizes.data(), nullptr), "selecting rows");
  return {H5Screate_simple(rank, sizes.data(), nullptr), H5Sclose, "selecting rows"};
}

Handle open_attribute(hid_t object, const std::string& name) {
  return {H5Aopen(object, name.c_str(), H5P_DEFAULT), H5Aclose, "reading attribute '" + name + "'"};
}

/// The number of values, without regard to their shape.
hsize_t count_of(hid_t attribute, const std::string& name) {
  const Handle space(H5Aget_space(attribute), H5Sclose, "reading attribute '" + name + "'");
  return static_cast<hsize_t>(check(H5Sget_simple_extent_npoints(space), "reading attribute '" + name + "'"));
}

void require_one_integer(hid_t attribute, const std::string& name) {
  const Handle type(H5Aget_type(attribute), H5Tclose, "reading attribute '" + name + "'");
  if (H5Tget_class(type) != H5T_INTEGER || H5Tget_size(type) > sizeof(std::int64_t) || count_of(attribute, name) != 1)
    throw Failure("attribute '" + name + "' is not one integer");
}

}  // namespace

Session::Session() : lock_(process_lock()) {
  H5Eget_auto2(H5E_DEFAULT, &print_, &print_data_);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

Session::~Session() {
  H5Eset_auto2(H5E_DEFAULT, print_, print_data_);
}

void fail(const std::string& doing) {
  struct First {
    std::string reason;
    bool no_memory = false;
  } first;
  const auto keep_first = [](unsigned position, const H5E_error2_t* error, void* kept) -> herr_t {
    First& all = *static_cast<First*>(kept);
    if (position == 0 && error->desc)
      all.reason = error->desc;
    all.no_memory = all.no_memory || error->maj_num == H5E_RESOURCE || error->min_num == H5E_CANTALLOC;
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, keep_first, &first);
  const std::string text = first.reason.empty() ? doing : doing + ": " + essence(first.reason);
  if (first.no_memory)
    throw NoMemoryFailure(text);
  throw Failure(text);
}

Handle create_file(const std::filesystem::path& file) {
  return {H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access_without_locks()), H5Fclose, "creating the file"};
}

Handle open_file(const std::filesystem::path& file, unsigned flags) {
  return {H5Fopen(file.c_str(), flags, access_without_locks()), H5Fclose, "opening the file"};
}

int descriptor_of(hid_t file) {
  void* handle = nullptr;
  check(H5Fget_vfd_handle(file, H5P_DEFAULT, &handle), "looking at the file");
  return *static_cast<const int*>(handle);
}

Handle open_dataset(hid_t file, const std::string& path) {
  return {H5Dopen2(file, path.c_str(), H5P_DEFAULT), H5Dclose, "opening dataset '" + path + "'"};
}

std::vector<hsize_t> extent(hid_t dataset) {
  const Handle space(H5Dget_space(dataset), H5Sclose, "reading an extent");
  std::vector<hsize_t> sizes(check(H5Sget_simple_extent_ndims(space), "reading an extent"));
  check(H5Sget_simple_extent_dims(space, sizes.data(), nullptr), "reading an extent");
  return sizes;
}

hid_t stored_type(Type type) {
  switch (type) {
    case Type::f64: return H5T_IEEE_F64LE;
    case Type::i64: return H5T_STD_I64LE;
    case Type::i32: return H5T_STD_I32LE;
    case Type::u8: return H5T_STD_U8LE;
  }
  return H5I_INVALID_HID;
}

hid_t memory_type(Type type) {
  switch (type) {
    case Type::f64: return H5T_NATIVE_DOUBLE;
    case Type::i64: return H5T_NATIVE_INT64;
    case Type::i32: return H5T_NATIVE_INT32;
    case Type::u8: return H5T_NATIVE_UINT8;
  }
  return H5I_INVALID_HID;
}

namespace {

constexpr std::initializer_list<Type> types{Type::f64, Type::i64, Type::i32, Type::u8};

bool is_stored_as(hid_t stored, Type type) {
  return H5Tequal(stored, stored_type(type)) > 0;
}

}  // namespace

bool is_number(hid_t stored) {
  return std::ranges::any_of(types, [&](Type type) { return is_stored_as(stored, type); });
}

Type type_of(hid_t stored) {
  const auto* const found = std::ranges::find_if(types, [&](Type type) { return is_stored_as(stored, type); });
  if (found == types.end())
    throw Failure("it is of a type that records do not use");
  return *found;
}

std::size_t size_of(Type type) {
  switch (type) {
    case Type::f64:
    case Type::i64: return 8;
    case Type::i32: return 4;
    case Type::u8: return 1;
  }
  return 0;
}

Handle text_type() {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose, "preparing text");
  check(H5Tset_size(type, H5T_VARIABLE), "preparing text");
  check(H5Tset_cset(type, H5T_CSET_UTF8), "preparing text");
  return type;
}

bool has_attribute(hid_t object, const std::string& name) {
  return check(H5Aexists(object, name.c_str()), "looking for attribute '" + name + "'") > 0;
}

void write_attribute(hid_t object, const std::string& name, const std::string& text) {
  const std::string doing = "writing attribute '" + name + "'";
  if (has_attribute(object, name))
    check(H5Adelete(object, name.c_str()), doing);
  const Handle type = text_type();
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, doing);
  const Handle attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose, doing);
  const char* characters = text.c_str();
  check(H5Awrite(attribute, type, &characters), doing);
}

void write_attribute(hid_t object, const std::string& name, Type type, std::int64_t value) {
  const std::string doing = "writing attribute '" + name + "'";
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, doing);
  const Handle attribute =
      has_attribute(object, name)
          ? open_attribute(object, name)
          : Handle(H5Acreate2(object, name.c_str(), stored_type(type), space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
                   doing);
  require_one_integer(attribute, name);
  check(H5Awrite(attribute, H5T_NATIVE_INT64, &value), doing);
}

std::string read_text_attribute(hid_t object, const std::string& name) {
  return read_text_list(object, name, 1).front();
}

std::vector<std::string> read_text_list(hid_t object, const std::string& name, std::size_t count) {
  const std::string doing = "reading attribute '" + name + "'";
  const Handle attribute = open_attribute(object, name);
  const Handle stored(H5Aget_type(attribute), H5Tclose, doing);
  if (H5Tis_variable_str(stored) <= 0 || count_of(attribute, name) != count)
    throw Failure("attribute '" + name + "' is not " +
                  (count == 1 ? "a text" : "a list of " + std::to_string(count) + " texts") + " of variable length");
  const Handle type = text_type();
  std::vector<char*> characters(count, nullptr);
  check(H5Aread(attribute, type, characters.data()), doing);
  std::vector<std::string> texts;
  for (char* text : characters) {
    texts.emplace_back(text != nullptr ? text : "");
    H5free_memory(text);
  }
  return texts;
}

std::int64_t read_integer_attribute(hid_t object, const std::string& name) {
  std::int64_t value = 0;
  const Handle attribute = open_attribute(object, name);
  require_one_integer(attribute, name);
  check(H5Aread(attribute, H5T_NATIVE_INT64, &value), "reading attribute '" + name + "'");
  return value;
}

void read_rows(hid_t dataset, hid_t memory, hsize_t first, hsize_t count, void* data) {
  if (count == 0)
    return;
  const Handle space(H5Dget_space(dataset), H5Sclose, "reading rows");
  const Handle room = select_rows(space, first, count);
  check(H5Dread(dataset, memory, room, space, H5P_DEFAULT, data), "reading rows");
}

void read_block(hid_t dataset, hid_t memory, std::vector<hsize_t> first, const std::vector<hsize_t>& sizes,
                void* data) {
  first.resize(sizes.size(), 0);
  const Handle space(H5Dget_space(dataset), H5Sclose, "reading rows");
  check(H5Sselect_hyperslab(space, H5S_SELECT_SET, first.data(), nullptr, sizes.data(), nullptr), "selecting rows");
  const Handle room(H5Screate_simple(static_cast<int>(sizes.size()), sizes.data(), nullptr), H5Sclose,
                    "selecting rows");
  check(H5Dread(dataset, memory, room, space, H5P_DEFAULT, data), "reading rows");
}

void read_through(hid_t dataset, const std::function<void(std::span<const std::byte>)>& use) {
  const Handle type(H5Dget_type(dataset), H5Tclose, "looking at its type");
  const auto sizes = extent(dataset);
  std::size_t row_bytes = H5Tget_size(type);
  for (std::size_t i = 1; i < sizes.size(); ++i)
    row_bytes *= sizes[i];
  if (row_bytes == 0)
    return;
  constexpr std::size_t most_bytes = std::size_t{8} << 20;
  const hsize_t slab = std::max<hsize_t>(1, most_bytes / row_bytes);
  std::vector<std::byte> rows(row_bytes * std::min(slab, sizes.front()));
  for (hsize_t first = 0; first < sizes.front(); first += slab) {
    const hsize_t count = std::min(slab, sizes.front() - first);
    read_rows(dataset, type, first, count, rows.data());
    use(std::span(rows).first(row_bytes * count));
  }
}

void write_rows(hid_t dataset, hid_t memory, hsize_t first, hsize_t count, const void* data) {
  if (count == 0)
    return;
  const Handle space(H5Dget_space(dataset), H5Sclose, "writing rows");
  const Handle room = select_rows(space, first, count);
  check(H5Dwrite(dataset, memory, room, space, H5P_DEFAULT, data), "writing rows");
}

hsize_t plane_of(const std::vector<hsize_t>& extent) {
  hsize_t plane = 1;
  for (std::size_t i = 2; i < extent.size(); ++i)
    plane *= extent[i];
  return plane;
}

void write_part(hid_t dataset, hid_t memory, hsize_t row, hsize_t first, hsize_t count, const void* data,
                hid_t transfer) {
  if (count == 0)
    return;
  std::vector<hsize_t> sizes = extent(dataset), start(sizes.size(), 0);
  const hsize_t plane = plane_of(sizes);
  start.front() = row;
  sizes.front() = 1;
  if (sizes.size() > 1) {
    start[1] = first / plane;
    sizes[1] = count / plane;
  }
  const Handle space(H5Dget_space(dataset), H5Sclose, "writing rows");
  check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, sizes.data(), nullptr), "writing rows");
  const Handle room(H5Screate_simple(static_cast<int>(sizes.size()), sizes.data(), nullptr), H5Sclose, "writing rows");
  check(H5Dwrite(dataset, memory, room, space, transfer, data), "writing rows");
}

}  // namespace rubato::record::detail
