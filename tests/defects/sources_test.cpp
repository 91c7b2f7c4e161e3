// [initial] from and problem files that are damaged, endless, or no files: refused with the reason, without reading on.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include <sys/stat.h>

#include <fmt/format.h>
#include <hdf5.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/csv.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using namespace rubato::defect_tests;
using Catch::Matchers::Contains;
using rubato::tests::Folder;

namespace {

std::string complaint(const std::string& problem, const std::vector<std::string>& settings) {
  try {
    static_cast<void>(read_problem(problem, settings));
  } catch (const FileError& error) {
    return error.what();
  }
  return "no FileError";
}

std::string from(const std::string& file) {
  return fmt::format("initial.from=\"{}\"", file);
}

}  // namespace

TEST_CASE("a sound record is a start", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const std::string problem = defect_file("rel-from-zero.toml");
  REQUIRE(run(read_problem("pendulum", std::vector<std::string>{"scheme.until=1"}), {.output = file, .threads = 1})
              .status == ExitStatus::done);
  CHECK_NOTHROW(read_problem(problem, std::vector{from(file), std::string("scheme.until=3")}));
}

TEST_CASE("what is no regular file is no start and no problem", "[defects]") {
  const Folder folder;
  const std::string problem = defect_file("rel-from-zero.toml");
  for (const char* ending : {"csv", "h5"}) {
    const std::string endless = folder / fmt::format("endless.{}", ending),
                      pipe = folder / fmt::format("pipe.{}", ending), inner = folder / fmt::format("folder.{}", ending);
    std::filesystem::create_symlink("/dev/zero", endless);
    REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
    std::filesystem::create_directory(inner);
    for (const std::string& file : {endless, pipe, inner}) {
      INFO(file);
      CHECK_THAT(complaint(problem, {from(file)}), Contains("from: " + file) && Contains("is not a regular file"));
    }
    CHECK_THAT(complaint(endless, {}), Contains("is not a regular file"));
    CHECK_THAT(complaint(pipe, {}), Contains("is not a regular file"));
  }
  std::ofstream(folder / "one.csv") << "q,p\n0.1,0.2\n";  // the twin
  CHECK_NOTHROW(read_problem(problem, std::vector{from(folder / "one.csv")}));
}

TEST_CASE("a dataset that claims more than its file can hold is no start", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto write = [&](hsize_t size) {
    const hid_t id = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    const hsize_t chunk = 1024;
    for (const char* name : {"q", "p"}) {
      const hid_t space = H5Screate_simple(1, &size, nullptr), properties = H5Pcreate(H5P_DATASET_CREATE);
      if (size > 1) {
        H5Pset_chunk(properties, 1, &chunk);
      }
      const hid_t set = H5Dcreate2(id, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, properties, H5P_DEFAULT);
      const double value = 0.1;
      if (size == 1) {
        H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value);
      }
      H5Dclose(set);
      H5Pclose(properties);
      H5Sclose(space);
    }
    H5Fclose(id);
  };
  write(hsize_t{1} << 45);
  CHECK_THAT(complaint(defect_file("rel-from-zero.toml"), {from(file)}), Contains("bytes, but the file holds"));
  write(1);
  CHECK_NOTHROW(read_problem(defect_file("rel-from-zero.toml"), std::vector{from(file)}));
}

TEST_CASE("a record that is larger than its disk is refused before the run", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto problem = [](std::vector<std::string> more) {
    std::vector<std::string> settings = {"scheme.levels=fixed", "scheme.step=1e-12", "scheme.until=1e4",
                                         "scheme.max_steps=9000000000000000"};
    settings.insert(settings.end(), more.begin(), more.end());
    return read_problem("pendulum", settings);
  };
  CHECK_THROWS_WITH(run(problem({}), {.output = file, .threads = 1}), Contains("GB are free in"));
  CHECK_FALSE(std::filesystem::exists(file));
  // Where an event may end the run before that, it is a warning.
  const Outcome stopped =
      run(problem({"events.late.crossing=\"t > 1e-11\"", "events.late.stop=true"}), {.output = file, .threads = 1});
  CHECK(stopped.status == ExitStatus::done);
  CHECK_THAT(stopped.warnings.front(), Contains("GB are free in"));
  const Outcome small = run(read_problem("pendulum", std::vector<std::string>{"scheme.until=1"}),
                            {.output = file, .overwrite = true, .threads = 1});
  for (const std::string& warning : small.warnings) {
    CHECK_THAT(warning, !Contains("GB are free in"));
  }
}

TEST_CASE("tables of names that differ by case alone are files of their own", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  REQUIRE(run(read_problem("pendulum",
                           std::vector<std::string>{"scheme.until=20", "events.turn.crossing=\"p\"",
                                                    "events.Turn.crossing=\"q\"", "events.other.crossing=\"p\""}),
              {.output = file, .threads = 1})
              .status == ExitStatus::done);
  const auto files = report::export_csv(record::Reader(file), folder / "csv");
  std::set<std::string> names;
  for (const std::filesystem::path& path : files) {
    std::string name = path.filename().string();
    std::ranges::transform(name, name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    CHECK(names.insert(name).second);
    CHECK(std::filesystem::exists(path));
  }
  CHECK(names.contains("events_turn.csv"));
  CHECK(names.contains("events_turn_2.csv"));
  CHECK(names.contains("events_other.csv"));  // a name of its own has no number
}
