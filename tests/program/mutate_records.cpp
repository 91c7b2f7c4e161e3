// mutate_records RUBATO COUNT [FIRST]: records of an orbit and of lattices, altered at random in their bytes or in
// their structure, are read by every command that reads records. None may crash, take more than 20 s or more memory
// than ten times the file and 200 MB; each says what is wrong with which file (status 5 or 6), or goes on where nothing
// that is read has changed. Exits 0 if all of this holds. Mutation i is the same whichever ran before it, so that many
// can be made in parts, side by side: from FIRST on, or from 0.

#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
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

constexpr unsigned seed = 20261121;
std::mt19937 random_bits;

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

void swap(hid_t file) {
  const auto paths = datasets_of(file);
  const std::string path = one_of(paths), other = one_of(paths);
  H5Lmove(file, path.c_str(), file, "/aside", H5P_DEFAULT, H5P_DEFAULT);
  H5Lmove(file, other.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT);
  H5Lmove(file, "/aside", file, other.c_str(), H5P_DEFAULT, H5P_DEFAULT);
}

void change_value(hid_t file) {
  const std::string path = one_of(datasets_of(file));
  const hid_t dataset = H5Dopen2(file, path.c_str(), H5P_DEFAULT), type = H5Dget_type(dataset);
  const hid_t space = H5Dget_space(dataset);
  const hssize_t count = H5Sget_simple_extent_npoints(space);
  if (H5Tget_class(type) != H5T_STRING && count > 0) {
    std::vector<double> values(static_cast<std::size_t>(count));
    H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
    double& value = values[below(values.size())];
    switch (below(3)) {
      case 0: value = value == 0.0 ? 1.0 : -value; break;
      case 1: value = value == 0.0 ? 1.0 : 0.0; break;
      default: value += value < 100.0 ? 1.0 : -1.0; break;
    }
    H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  }
  H5Sclose(space);
  H5Tclose(type);
  H5Dclose(dataset);
}

/// One text of a record becomes another that is as good.
void change_text(hid_t file) {
  auto paths = datasets_of(file);
  paths.insert(paths.end(), paths.size(), "/");
  const std::string path = one_of(paths);
  const hid_t object = H5Oopen(file, path.c_str(), H5P_DEFAULT);
  static constexpr std::array<const char*, 5> of_root{"title", "problem", "version", "compiler", "contents"};
  const std::string name = path == "/" ? one_of(of_root) : "description";
  H5Adelete(object, name.c_str());
  const hid_t text = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
  H5Tset_size(text, H5T_VARIABLE);
  H5Tset_cset(text, H5T_CSET_UTF8);
  const hid_t attribute = H5Acreate2(object, name.c_str(), text, space, H5P_DEFAULT, H5P_DEFAULT);
  static constexpr std::array<const char*, 3> texts{"", "/levels/t", "another"};
  const char* const value = one_of(texts);
  H5Awrite(attribute, text, &value);
  H5Aclose(attribute);
  H5Sclose(space);
  H5Tclose(text);
  H5Oclose(object);
}

/// A group or a dataset of another run of the same problem takes the place of this one's.
void take_from(hid_t file, const fs::path& donor) {
  auto paths = datasets_of(file);
  for (const char* group : {"/levels", "/states", "/laws", "/checkpoint"}) {
    paths.insert(paths.end(), paths.size() / 8 + 1, group);
  }
  const std::string path = one_of(paths);
  const hid_t other = H5Fopen(donor.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (H5Oexists_by_name(file, path.c_str(), H5P_DEFAULT) > 0 &&
      H5Oexists_by_name(other, path.c_str(), H5P_DEFAULT) > 0) {
    H5Ldelete(file, path.c_str(), H5P_DEFAULT);
    H5Ocopy(other, path.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT);
  }
  H5Fclose(other);
}

/// A record, and one of the same problem that ended earlier.
struct Original {
  fs::path file, shorter;
};

struct Mutation {
  const char* name;
  std::function<void(const fs::path&, const Original&)> apply;
};

std::function<void(const fs::path&, const Original&)> in_bytes(void (*change)(const fs::path&)) {
  return [change](const fs::path& path, const Original&) { change(path); };
}

std::function<void(const fs::path&, const Original&)> in_file(void (*change)(hid_t)) {
  return [change](const fs::path& path, const Original&) {
    const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    change(file);
    H5Fclose(file);
  };
}

/// What both records say is the same, bit by bit; a record that cannot be read says nothing.
bool same(const fs::path& a, const fs::path& b) {
  try {
    using rubato::record::Altered, rubato::record::Reader;
    const Reader first(a), second(b, Altered::reported);
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
  const auto ended = children::wait_for(children::start(program, arguments, {{}, errors}), std::chrono::seconds(120));
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

std::vector<Original> write_originals(const std::string& program, const fs::path& folder) {
  struct Kind {
    std::vector<std::string> arguments;
    const char *until, *earlier;
  };
  const std::vector<Kind> kinds{
      {{"pendulum"}, "3", "2.5"},
      {{"kepler", "--set", "output.every=3"}, "3", "2.5"},
      {{"sine-gordon", "--set", "grid.x.cells=21"}, "0.5", "0.4"},
      // With stages, a step potential, events of both kinds, output times and velocities.
      {{"double-pendulum", "--set", "events.turn=a_dot", "--set", "section.crossing=b", "--set",
        "section.quantities=[\"a\", \"p_a\"]", "--set", "output.interval=0.5"},
       "3",
       "2.5"},
      {{"pendulum", "--set", "scheme.lagrangian=splitting", "--set", "scheme.order=4", "--set", "events.stop=p < -10",
        "--set", "events.up=p", "--set", "output.every=2"},
       "3",
       "2.5"},
      {{"sine-gordon", "--set", "grid.x.cells=21", "--set", "scheme.lagrangian=fourier", "--set", "scheme.stages=2",
        "--set", "events.middle={ crossing = \"v\", at = { x = 1 } }", "--set", "output.quantities.mass=integral(u^2)"},
       "0.5",
       "0.4"},
  };
  const auto write = [&](const Kind& kind, const char* until, const std::string& name) {
    std::vector<std::string> arguments{"run"};
    arguments.insert(arguments.end(), kind.arguments.begin(), kind.arguments.end());
    arguments.insert(arguments.end(),
                     {"--set", fmt::format("scheme.until={}", until), "-o", (folder / name).string(), "--quiet"});
    const int status = children::wait_for(children::start(program, arguments)).status;
    if (status != 0 && status != 7) {  // a few coarse steps may be lost: the record is whole
      throw std::runtime_error("a record could not be made");
    }
    return folder / name;
  };
  std::vector<Original> originals;
  for (const Kind& kind : kinds) {
    const std::size_t i = originals.size();
    originals.push_back({write(kind, kind.until, fmt::format("original{}.h5", i)),
                         write(kind, kind.earlier, fmt::format("shorter{}.h5", i))});
  }
  return originals;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3 && argc != 4) {
    fmt::print("usage: mutate_records RUBATO COUNT [FIRST]\n");
    return 2;
  }
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  const std::vector<Mutation> mutations{
      {"bits", in_bytes(flip_bits)},
      {"bytes", in_bytes(overwrite)},
      {"length", in_bytes(change_length)},
      {"rows", in_file(resize)},
      {"type", in_file(change_type)},
      {"shape", in_file(change_shape)},
      {"storage", in_file(change_storage)},
      {"attribute", in_file(change_attribute)},
      {"link", in_file(change_link)},
      {"swap", in_file(swap)},
      {"value", in_file(change_value)},
      {"text", in_file(change_text)},
      {"other",
       [](const fs::path& path, const Original& original) {
         const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
         take_from(file, original.shorter);
         H5Fclose(file);
       }},
  };
  const std::string program = argv[1];
  const int count = std::atoi(argv[2]), first = argc == 4 ? std::atoi(argv[3]) : 0;
  const sample::Folder folder;
  int failures = 0;
  std::map<int, int> statuses;
  try {
    const std::vector<Original> originals = write_originals(program, folder.path());
    for (int i = first; i < first + count; ++i) {
      random_bits.seed(seed + static_cast<unsigned>(i));
      const Original& original = one_of(originals);
      const Mutation& mutation = mutations[static_cast<std::size_t>(i) % mutations.size()];
      const fs::path mutant = folder / "changed.h5";
      fs::copy_file(original.file, mutant, fs::copy_options::overwrite_existing);
      mutation.apply(mutant, original);
      for (const char* command : {"check", "report", "export", "compare", "resume"}) {
        const std::string wrong = judge(program, folder.path(), original.file, mutant, command, statuses);
        if (!wrong.empty()) {
          ++failures;
          fmt::print("FAILED: mutation {} ({} of {}), {}: {}\n", i, mutation.name, original.file.filename().string(),
                     command, wrong);
          if (const char* const kept = std::getenv("RUBATO_KEEP_MUTANTS")) {
            fs::copy_file(mutant, fs::path(kept) / fmt::format("{}-{}.h5", i, mutation.name),
                          fs::copy_options::overwrite_existing);
          }
        }
      }
      if (constexpr int often = 100; (i + 1) % often == 0) {
        fmt::print("{} mutations, {} failures\n", i + 1 - first, failures);
      }
      std::fflush(stdout);  // what was found is known however this ends
    }
  } catch (const std::exception& error) {
    fmt::print("FAILED: {}\n", error.what());
    return 1;
  }
  for (const auto& [status, times] : statuses) {
    fmt::print("status {}: {} times\n", status, times);
  }
  fmt::print("{} mutations from number {}, {} failures\n", count, first, failures);
  // The alterations are heavy enough to be noticed, mostly.
  return failures == 0 && statuses[5] + statuses[6] > count ? 0 : 1;
}
