#include <algorithm>
#include <bit>
#include <span>
#include <utility>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/hdf5.hpp>
#include <rubato/record/detail/structure.hpp>

namespace rubato::record::detail {

namespace {

constexpr const char* group_name = "/checkpoint";
constexpr const char* checksum_attribute = "checksum";

struct Bytes {
  hid_t stored;
  hid_t memory;
  hsize_t count;
  const void* data;
};

Bytes bytes_of(const CheckpointArray& array) {
  if (const auto* numbers = std::get_if<std::vector<double>>(&array))
    return {H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, numbers->size(), numbers->data()};
  if (const auto* integers = std::get_if<std::vector<std::int64_t>>(&array))
    return {H5T_STD_I64LE, H5T_NATIVE_INT64, integers->size(), integers->data()};
  const auto& text = std::get<std::string>(array);
  return {H5T_STD_U8LE, H5T_NATIVE_UINT8, text.size(), text.data()};
}

/// One number for all that `resume` starts from: names, sizes and values, the numbers as little-endian machines keep
/// them (this library runs on no others).
class WholeChecksum {
public:
  void begin(const std::string& name, std::uint64_t index, std::uint64_t count) {
    checksum_.add(std::as_bytes(std::span(name.c_str(), name.size() + 1)));
    const std::uint64_t head[] = {index, count};
    checksum_.add(std::as_bytes(std::span(head)));
  }
  void add(std::span<const std::byte> bytes) { checksum_.add(bytes); }
  void add(const std::string& name, const CheckpointArray& array) {
    const Bytes bytes = bytes_of(array);
    begin(name, array.index(), bytes.count);
    add({static_cast<const std::byte*>(bytes.data), bytes.count * H5Tget_size(bytes.memory)});
  }
  /// An array of numbers as it is stored.
  void add_stored(const std::string& name, hid_t dataset) {
    begin(name, CheckpointArray(std::vector<double>()).index(), extent(dataset).at(0));
    read_through(dataset, [this](std::span<const std::byte> bytes) { add(bytes); });
  }
  [[nodiscard]] std::int64_t value() const { return std::bit_cast<std::int64_t>(checksum_.value()); }

private:
  static_assert(std::endian::native == std::endian::little);
  Checksum checksum_;
};

std::int64_t checksum_of(const Checkpoint& checkpoint) {
  WholeChecksum checksum;
  for (const auto& [name, array] : checkpoint)
    checksum.add(name, array);
  return checksum.value();
}

/// Whether the array stored under this name has the same size and type, so that it can be overwritten in place.
bool fits(hid_t group, const std::string& name, const Bytes& bytes) {
  const Handle dataset = open_dataset(group, name);
  const Handle type(H5Dget_type(dataset), H5Tclose, "writing the checkpoint");
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose, "writing the checkpoint");
  return (bytes.count == 0 || H5Pget_nfilters(properties) > 0) &&  // records of before had no checksums
         extent(dataset) == std::vector<hsize_t>{bytes.count} && H5Tequal(type, bytes.stored) > 0;
}

std::vector<std::string> names_in(hid_t group) {
  std::vector<std::string> names;
  const auto collect = [](hid_t, const char* name, const H5L_info_t*, void* list) -> herr_t {
    static_cast<std::vector<std::string>*>(list)->emplace_back(name);
    return 0;
  };
  check(H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, nullptr, collect, &names), "listing the checkpoint");
  return names;
}

template <class Container>
Container read_all(hid_t dataset, hid_t memory) {
  const auto sizes = extent(dataset);
  Container values(sizes.size() == 1 ? sizes[0] : 0, {});
  read_rows(dataset, memory, 0, values.size(), values.data());
  return values;
}

const std::string writing = "writing the checkpoint";

Handle open_or_make_group(hid_t file) {
  return check(H5Lexists(file, group_name, H5P_DEFAULT), writing) > 0
             ? Handle(H5Gopen2(file, group_name, H5P_DEFAULT), H5Gclose, writing)
             : Handle(H5Gcreate2(file, group_name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose, writing);
}

bool is_in(hid_t group, const std::string& name) {
  return check(H5Lexists(group, name.c_str(), H5P_DEFAULT), writing) > 0;
}

/// Removes what is not of the checkpoint, `left_alone` aside.
void keep_only(hid_t group, const Checkpoint& checkpoint, const std::string& left_alone = {}) {
  for (const auto& name : names_in(group))
    if (name != left_alone && !checkpoint.contains(name))
      check(H5Ldelete(group, name.c_str(), H5P_DEFAULT), writing);
}

/// The dataset for an array: the one that is there, if it is like it.
Handle array_for(hid_t group, const std::string& name, const Bytes& bytes) {
  if (is_in(group, name)) {
    if (fits(group, name, bytes))
      return open_dataset(group, name);
    check(H5Ldelete(group, name.c_str(), H5P_DEFAULT), writing);
  }
  const Handle space(H5Screate_simple(1, &bytes.count, nullptr), H5Sclose, writing);
  return {H5Dcreate2(group, name.c_str(), bytes.stored, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Dclose,
          writing};
}

void write_array(hid_t group, const std::string& name, const CheckpointArray& array) {
  const Bytes bytes = bytes_of(array);
  const Handle dataset = array_for(group, name, bytes);
  write_rows(dataset, bytes.memory, 0, bytes.count, bytes.data);
  check(H5Dflush(dataset), writing);  // what fails when it is closed is not reported
}

}  // namespace

void write_checkpoint(hid_t file, const Checkpoint& checkpoint) {
  const Handle group = open_or_make_group(file);
  keep_only(group, checkpoint);
  for (const auto& [name, array] : checkpoint)
    write_array(group, name, array);
  write_attribute(group, checksum_attribute, Type::i64, checksum_of(checkpoint));
}

void write_checkpoint(hid_t file, const CheckpointInParts& checkpoint) {
  const Handle group = open_or_make_group(file);
  const Bytes bytes{H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, checkpoint.size, nullptr};
  const Handle dataset = array_for(group, checkpoint.name, bytes);
  std::size_t written = 0;
  std::vector<double> chunk;                          // each is written once
  constexpr std::size_t most = std::size_t{1} << 17;  // 1 MiB of numbers at a time
  chunk.reserve(std::min<std::size_t>(checkpoint.size, most));
  const auto write = [&] {
    write_rows(dataset, bytes.memory, written, chunk.size(), chunk.data());
    written += chunk.size();
    chunk.clear();
  };
  checkpoint.hand_over([&](std::span<const double> part) {
    if (part.size() > checkpoint.size - written - chunk.size())
      throw Failure("more numbers came for the checkpoint than were announced");
    while (!part.empty()) {
      const auto some = part.first(std::min(part.size(), chunk.capacity() - chunk.size()));
      chunk.insert(chunk.end(), some.begin(), some.end());
      part = part.subspan(some.size());
      if (chunk.size() == chunk.capacity())
        write();
    }
  });
  write();
  check(H5Dflush(dataset), writing);
  if (written != checkpoint.size)
    throw Failure("fewer numbers came for the checkpoint than were announced");
  Checkpoint all = checkpoint.others();
  all[checkpoint.name] = std::vector<double>();
  WholeChecksum checksum;
  keep_only(group, all, checkpoint.name);
  for (const auto& [name, array] : all) {
    if (name == checkpoint.name) {
      checksum.add_stored(name, dataset);
    } else {
      write_array(group, name, array);
      checksum.add(name, array);
    }
  }
  write_attribute(group, checksum_attribute, Type::i64, checksum.value());
}

std::int64_t stored_checkpoint_checksum(hid_t file) {
  if (check(H5Lexists(file, group_name, H5P_DEFAULT), "looking for the checkpoint") == 0)
    return 0;
  const Handle group(H5Gopen2(file, group_name, H5P_DEFAULT), H5Gclose, "reading the checkpoint");
  return has_attribute(group, checksum_attribute) ? read_integer_attribute(group, checksum_attribute) : 0;
}

namespace {

/// \param is_left_out of which arrays of numbers nothing but the checksum is wanted
template <class IsLeftOut>
Checkpoint read_checkpoint_but(hid_t file, const IsLeftOut& is_left_out) {
  const Handle group(H5Gopen2(file, group_name, H5P_DEFAULT), H5Gclose, "reading the checkpoint");
  Checkpoint checkpoint;
  WholeChecksum checksum;
  for (const auto& name : names_in(group)) {
    const Handle dataset = open_dataset(group, name);
    const Handle type(H5Dget_type(dataset), H5Tclose, "reading the checkpoint");
    if (extent(dataset).size() != 1 || H5Tget_class(type) == H5T_STRING)
      throw Failure("dataset '/checkpoint/" + name + "' is not a list of numbers");
    try {
      if (is_left_out(name) && H5Tequal(type, H5T_IEEE_F64LE) > 0) {
        checksum.add_stored(name, dataset);
        continue;
      }
      if (H5Tget_class(type) == H5T_FLOAT)
        checkpoint[name] = read_all<std::vector<double>>(dataset, H5T_NATIVE_DOUBLE);
      else if (H5Tget_size(type) == 1)
        checkpoint[name] = read_all<std::string>(dataset, H5T_NATIVE_UINT8);
      else
        checkpoint[name] = read_all<std::vector<std::int64_t>>(dataset, H5T_NATIVE_INT64);
      checksum.add(name, checkpoint.at(name));
    } catch (const Failure& failure) {
      throw Failure("dataset '/checkpoint/" + name + "': " + failure.what());
    }
  }
  if (has_attribute(group, checksum_attribute) && read_integer_attribute(group, checksum_attribute) != checksum.value())
    throw Failure(
        "group '/checkpoint' is damaged: its arrays are not those that were written, by their checksum, and "
        "the run cannot be continued");
  return checkpoint;
}

}  // namespace

Checkpoint read_checkpoint(hid_t file, const std::string& left_out) {
  return read_checkpoint_but(file, [&left_out](const std::string& name) { return name == left_out; });
}

void examine_checkpoint(hid_t file) {
  (void)read_checkpoint_but(file, [](const std::string&) { return true; });
}

}  // namespace rubato::record::detail
