// mutate_records RUBATO COUNT: records of an orbit and of lattices, altered at random in their bytes or in their
// structure, are read by every command that reads records. None may crash, take more than 20 s or more memory than ten
// times the file and 200 MB; each says what is wrong with which file (status 5 or 6), or goes on where nothing that is
// read has changed. Exits 0 if all of this holds.

#include <array>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <hdf5.h>

#include <rubato/record/reader.hpp>

#include "children.hpp"
#include "record/sample.hpp"

namespace {

namespace fs = std::filesystem;

std::mt19937 random_bits(20261121);

std::size_t below(std::size_t count) {
  return static_cast<std::size_t>(random_bits() % count);
}

template <typename Container>
const auto& one_of(const Container& all) {
  return all[below(std::size(all))];
}

// ---- in the bytes

void flip_bits(const fs::path& file) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  const auto size = static_cast<std::size_t>(fs::file_size(file));
  for (std::size_t flips = 1 + below(3); flips > 0; --flips) {
    const auto place = static_cast<std::streamoff>(below(size));
    stream.seekg(place);
    const char byte = static_cast<char>(stream.get() ^ (1 << below(8)));
    stream.seekp(place);
    stream.put(byte);
  }
}

void overwrite(const fs::path& file) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  const std::size_t length = 1 + below(64);
  stream.seekp(static_cast<std::streamoff>(below(static_cast<std::size_t>(fs::file_size(file)) - length)));
  for (std::size_t i = 0; i < length; ++i) {
    stream.put(static_cast<char>(random_bits()));
  }
}

void change_length(const fs::path& file) {
  const auto size = static_cast<std::size_t>(fs::file_size(file));
  fs::resize_file(file, below(3) == 0 ? size + 1 + below(5000) : below(size));
}

// ---- in the structure

std::vector<std::string> datasets_of(hid_t file) {
  std::vector<std::string> paths;
  H5Ovisit2(
      file, H5_INDEX_NAME, H5_ITER_INC,
      [](hid_t, const char* name, const H5O_info_t* info, void* out) -> herr_t {
        if (info->type == H5O_TYPE_DATASET) {
          static_cast<std::vector<std::string>*>(out)->push_back("/" + std::string(name));
        }
        return 0;
      },
      &paths, H5O_INFO_BASIC);
  return paths;
}

/// Puts a dataset in the place of another, without its attributes but for the number of rows. Where HDF5 does not make
/// one of that kind, the file stays as it is.
void replace(hid_t file, const std::string& path, hid_t type, const std::vector<hsize_t>& sizes, hid_t properties,
             bool write) {
  const hid_t space = H5Screate_simple(static_cast<int>(sizes.size()), sizes.data(), nullptr);
  const hid_t dataset = H5Dcreate_anon(file, type, space, properties, H5P_DEFAULT);
  std::size_t count = 1;
  for (const hsize_t size : sizes) {
    count *= size;
  }
  if (dataset >= 0) {
    H5Ldelete(file, path.c_str(), H5P_DEFAULT);
    H5Olink(dataset, file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT);
    if (write) {
      const std::vector<double> zeros(count + 1, 0.0);
      H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, zeros.data());
    }
    const hid_t scalar = H5Screate(H5S_SCALAR);
    const hid_t rows = H5Acreate2(dataset, "rows", H5T_STD_I64LE, scalar, H5P_DEFAULT, H5P_DEFAULT);
    const std::int64_t number = sizes.empty() ? 1 : static_cast<std::int64_t>(sizes[0]);
    H5Awrite(rows, H5T_NATIVE_INT64, &number);
    H5Aclose(rows);
    H5Sclose(scalar);
    H5Dclose(dataset);
  }
  H5Sclose(space);
}

void resize(hid_t file) {
  const std::string path = one_of(datasets_of(file));
  const hid_t dataset = H5Dopen2(file, path.c_str(), H5P_DEFAULT);
  const hid_t space = H5Dget_space(dataset);
  std::vector<hsize_t> sizes(8, 0);
  H5Sget_simple_extent_dims(space, sizes.data(), nullptr);
  static constexpr std::array<hsize_t, 6> lengths{0, 1, 100, 1'000'000, 1'000'000'000, 1'000'000'000'000'000};
  sizes[0] = below(2) == 0 ? sizes[0] + 1 : one_of(lengths);
  H5Dset_extent(dataset, sizes.data());
  H5Sclose(space);
  H5Dclose(dataset);
}

void change_type(hid_t file) {
  static const std::array<hid_t, 6> types{H5T_IEEE_F32LE, H5T_IEEE_F64BE, H5T_STD_I16LE,
                                          H5T_STD_U64LE,  H5T_STD_I8LE,   H5T_IEEE_F64LE};
  replace(file, one_of(datasets_of(file)), one_of(types), {1 + below(40)}, H5P_DEFAULT, below(2) == 0);
}

void change_shape(hid_t file) {
  std::vector<hsize_t> sizes(below(6));
  for (hsize_t& size : sizes) {
    size = below(7);
  }
  replace(file, one_of(datasets_of(file)), H5T_IEEE_F64LE, sizes, H5P_DEFAULT, below(2) == 0);
}

void change_storage(hid_t file) {
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  const hsize_t chunk = below(2) == 0 ? 5 : 100'000'000;
  const bool is_external = below(3) == 0;
  if (is_external) {
    H5Pset_external(properties, "/etc/passwd", 0, 8 * 20);
  } else {
    H5Pset_chunk(properties, 1, &chunk);
    if (below(2) == 0) {
      H5Pset_nbit(properties);
    } else {
      H5Pset_deflate(properties, 9);
      H5Pset_deflate(properties, 9);
    }
  }
  replace(file, one_of(datasets_of(file)), H5T_IEEE_F64LE, {20}, properties, !is_external);
  H5Pclose(properties);
}

void change_attribute(hid_t file) {
  auto paths = datasets_of(file);
  paths.insert(paths.end(), paths.size() / 2, "/");
  const std::string path = one_of(paths);
  const hid_t object = H5Oopen(file, path.c_str(), H5P_DEFAULT);
  static constexpr std::array<const char*, 3> of_datasets{"rows", "DIMENSION_LABELS", "DIMENSION_LIST"};
  static constexpr std::array<const char*, 7> of_root{"format",  "title",    "problem", "version",
                                                      "threads", "finished", "contents"};
  const std::string name = path == "/" ? one_of(of_root) : one_of(of_datasets);
  H5Adelete(object, name.c_str());
  if (const std::size_t what = below(5); what > 0) {
    const hsize_t count = one_of(std::array<hsize_t, 5>{1, 2, 7, 400, 2000});
    const hid_t space = what == 4 ? H5Screate(H5S_NULL) : H5Screate_simple(1, &count, nullptr);
    const hid_t text = H5Tcopy(H5T_C_S1);
    H5Tset_size(text, what == 1 ? 16 : H5T_VARIABLE);
    const hid_t type = what == 3 ? H5T_STD_I64LE : text;
    const hid_t attribute = H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT);
    if (what == 3) {
      const std::vector<std::int64_t> values(count, 0x4141414141414141);
      H5Awrite(attribute, H5T_NATIVE_INT64, values.data());
    } else if (what == 2) {
      const std::vector<const char*> values(count, "x\x1b[31m");
      H5Awrite(attribute, text, values.data());
    }
    H5Aclose(attribute);
    H5Tclose(text);
    H5Sclose(space);
  }
  H5Oclose(object);
}

void change_link(hid_t file) {
  const auto paths = datasets_of(file);
  const std::string path = one_of(paths), other = one_of(paths);
  H5Ldelete(file, path.c_str(), H5P_DEFAULT);
  switch (below(6)) {
    case 0: H5Lcreate_soft(other.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT); break;
    case 1: H5Lcreate_soft(path.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT); break;
    case 2: H5Lcreate_external("other.h5", other.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT); break;
    case 3: H5Lcreate_hard(file, "/", file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT); break;
    case 4: H5Lcreate_hard(file, "/states", file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT); break;
    default: H5Lcreate_hard(file, other.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT); break;
  }
}

struct Mutation {
  const char* name;
  std::function<void(const fs::path&)> apply;
};

std::function<void(const fs::path&)> in_file(void (*change)(hid_t)) {
  return [change](const fs::path& path) {
    const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    change(file);
    H5Fclose(file);
  };
}

/// What both records say is the same, bit by bit; a record that cannot be read says nothing.
bool same(const fs::path& a, const fs::path& b) {
  try {
    const rubato::record::Reader first(a), second(b);
    return first.header().title == second.header().title && first.header().problem == second.header().problem &&
           first.header().finished == second.header().finished && sample::difference(a, b).empty();
  } catch (const std::exception&) {
    return false;
  }
}

/// How one command took one record; empty if as it should.
std::string judge(const std::string& program, const fs::path& folder, const fs::path& original, const fs::path& mutant,
                  const std::string& command, std::map<int, int>& statuses) {
  const fs::path copy = folder / "mutant.h5";
  fs::copy_file(mutant, copy, fs::copy_options::overwrite_existing);
  std::vector<std::string> arguments{command, copy.string()};
  if (command == "report") {
    arguments.insert(arguments.end(), {"-o", (folder / "page.html").string(), "--force"});
  } else if (command == "export") {
    arguments.insert(arguments.end(), {"-o", (folder / "csv").string(), "--force"});
  } else if (command == "compare") {
    arguments.push_back(original.string());
  } else if (command == "resume") {
    arguments.insert(arguments.end(), {"--until", "3.5", "--quiet"});
  }
  const std::string errors = (folder / "errors").string();
  const auto ended = children::wait_for(children::start(program, arguments, {{}, errors}), std::chrono::seconds(20));
  ++statuses[ended.status];
  const std::string said = children::contents(errors);
  const double most = 10.0 * static_cast<double>(fs::file_size(mutant)) / 1e6 + 200.0;
  const bool is_sanitized = std::getenv("RUBATO_SANITIZED") != nullptr;  // whose own memory would count
  if (!is_sanitized && ended.megabytes > most) {
    return fmt::format("took {:.0f} MB", ended.megabytes);
  }
  if (said.find('\x1b') != std::string::npos) {
    return "an escape sequence reached the terminal: " + said;
  }
  if (ended.status == 0) {
    return same(original, mutant) ? "" : "went on with a record that says something else";
  }
  if (ended.status != 5 && ended.status != 6) {
    return fmt::format("status {}: {}", ended.status, said);
  }
  const std::string name = command == "check" && ended.status == 6 ? "" : "mutant.h5";
  return said.find(name) != std::string::npos && said.find("crashed") == std::string::npos
             ? ""
             : fmt::format("status {} without a reason: {}", ended.status, said);
}

std::vector<fs::path> write_originals(const std::string& program, const fs::path& folder) {
  const std::vector<std::vector<std::string>> runs{
      {"pendulum", "--set", "scheme.until=3"},
      {"kepler", "--set", "scheme.until=3", "--set", "output.every=3"},
      {"sine-gordon", "--set", "scheme.until=0.5", "--set", "grid.x.cells=21"},
  };
  std::vector<fs::path> files;
  for (std::vector<std::string> arguments : runs) {
    files.push_back(folder / fmt::format("original{}.h5", files.size()));
    arguments.insert(arguments.begin(), "run");
    arguments.insert(arguments.end(), {"-o", files.back().string(), "--quiet"});
    if (children::wait_for(children::start(program, arguments)).status != 0) {
      throw std::runtime_error("a record could not be made");
    }
  }
  return files;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print("usage: mutate_records RUBATO COUNT\n");
    return 2;
  }
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  const std::vector<Mutation> mutations{
      {"bits", flip_bits},
      {"bytes", overwrite},
      {"length", change_length},
      {"rows", in_file(resize)},
      {"type", in_file(change_type)},
      {"shape", in_file(change_shape)},
      {"storage", in_file(change_storage)},
      {"attribute", in_file(change_attribute)},
      {"link", in_file(change_link)},
  };
  const std::string program = argv[1];
  const int count = std::atoi(argv[2]);
  const sample::Folder folder;
  int failures = 0;
  std::map<int, int> statuses;
  try {
    const std::vector<fs::path> originals = write_originals(program, folder.path());
    for (int i = 0; i < count; ++i) {
      const fs::path& original = originals[below(originals.size())];
      const Mutation& mutation = mutations[static_cast<std::size_t>(i) % mutations.size()];
      const fs::path mutant = folder / "changed.h5";
      fs::copy_file(original, mutant, fs::copy_options::overwrite_existing);
      mutation.apply(mutant);
      for (const char* command : {"check", "report", "export", "compare", "resume"}) {
        const std::string wrong = judge(program, folder.path(), original, mutant, command, statuses);
        if (!wrong.empty()) {
          ++failures;
          fmt::print("FAILED: mutation {} ({} of {}), {}: {}\n", i, mutation.name, original.filename().string(),
                     command, wrong);
          if (const char* const kept = std::getenv("RUBATO_KEEP_MUTANTS")) {
            fs::copy_file(mutant, fs::path(kept) / fmt::format("{}-{}.h5", i, mutation.name),
                          fs::copy_options::overwrite_existing);
          }
        }
      }
    }
  } catch (const std::exception& error) {
    fmt::print("FAILED: {}\n", error.what());
    return 1;
  }
  for (const auto& [status, times] : statuses) {
    fmt::print("status {}: {} times\n", status, times);
  }
  fmt::print("{} mutations, {} failures\n", count, failures);
  // The alterations are heavy enough to be noticed, mostly.
  return failures == 0 && statuses[5] + statuses[6] > count ? 0 : 1;
}
