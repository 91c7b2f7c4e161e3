// Damaged and hostile records: every command that reads them says which dataset or attribute is wrong.

#include <catch2/catch.hpp>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <hdf5.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/error.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/csv.hpp>
#include <rubato/report/page.hpp>
#include <rubato/report/xdmf.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"
#include "record/sample.hpp"

using namespace rubato;
using namespace rubato::defect_tests;
using Catch::Matchers::Contains;

namespace {

std::string complaint(const std::function<void()>& reading) {
  try {
    reading();
  } catch (const record::Error& error) {
    return error.what();
  }
  return "nothing";
}

/// What every reader says of a record.
std::vector<std::string> complaints(const std::string& file, const sample::Folder& folder) {
  const std::string out = (folder / "out").string();
  return {complaint([&] { static_cast<void>(rubato::check(file)); }),
          complaint([&] { static_cast<void>(rubato::resume(file, 12.0, {.threads = 1})); }),
          complaint([&] { static_cast<void>(report::page(record::Reader(file), {})); }),
          complaint([&] { static_cast<void>(report::export_csv(record::Reader(file), out, true)); }), complaint([&] {
            const record::Reader reader(file);
            static_cast<void>(report::compare(reader, reader, {}));
          })};
}

std::string write_orbit(const sample::Folder& folder) {
  const std::string file = (folder / "orbit.h5").string();
  const std::vector<std::string> settings{"scheme.until=3"};
  REQUIRE(rubato::run(rubato::read_problem("pendulum", settings), {.output = file, .overwrite = true, .threads = 1})
              .status == rubato::ExitStatus::done);
  return file;
}

void alter(const std::string& file, const std::function<void(hid_t)>& change) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  REQUIRE(id >= 0);
  change(id);
  REQUIRE(H5Fclose(id) >= 0);
}

}  // namespace

TEST_CASE("a sound record is read by every command", "[defects]") {  // the twin of all below
  const sample::Folder folder;
  for (const std::string& said : complaints(write_orbit(folder), folder)) {
    CHECK(said == "nothing");
  }
}

TEST_CASE("damaged records are refused by every command, with the place", "[defects]") {
  const sample::Folder folder;
  const std::vector<std::pair<std::string, std::string>> files{{"p1.h5", "attribute 'finished'"},
                                                               {"p2.h5", "'/states/u'"},
                                                               {"p3.h5", "'/grid/x_cell'"},
                                                               {"p3b.h5", "'/grid/x'"},
                                                               {"p4.h5", "'/states/p'"},
                                                               {"p6.h5", "'/levels/gamma'"},
                                                               {"p7.h5", "'DIMENSION_LABELS'"},
                                                               {"b36.h5", "'/levels/step_condition'"},
                                                               {"one-dataset.h5", "'/levels/target'"}};
  for (const auto& [name, place] : files) {
    const std::string file = (folder / name).string();
    std::filesystem::copy_file(defect_file(name), file);
    for (const std::string& said : complaints(file, folder)) {
      CHECK_THAT(said, Contains(name) && Contains(place));
    }
  }
}

TEST_CASE("a record reads nothing but itself", "[defects]") {
  const sample::Folder folder;
  const std::string secret = (folder / "secret").string();
  REQUIRE(std::system(("head -c 400 /dev/zero > " + secret).c_str()) == 0);
  const auto external = [&](hid_t file) {
    H5Ldelete(file, "/levels/energy", H5P_DEFAULT);
    const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_external(properties, secret.c_str(), 0, 240);
    const hsize_t rows = 30;
    const hid_t space = H5Screate_simple(1, &rows, nullptr);
    H5Dclose(H5Dcreate2(file, "/levels/energy", H5T_IEEE_F64LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
    H5Sclose(space);
    H5Pclose(properties);
  };
  const auto put = [](const auto& make) {
    return [make](hid_t file) {
      H5Ldelete(file, "/levels/energy", H5P_DEFAULT);
      make(file);
    };
  };
  const std::vector<std::pair<std::function<void(hid_t)>, std::string>> changes{
      {external, "its data are in another file"},
      {put([](hid_t f) { H5Lcreate_external("b.h5", "/x", f, "/levels/energy", H5P_DEFAULT, H5P_DEFAULT); }),
       "'/levels/energy' is a link to a name"},
      {put([](hid_t f) { H5Lcreate_soft("/levels/h", f, "/levels/energy", H5P_DEFAULT, H5P_DEFAULT); }),
       "'/levels/energy' is a link to a name"},
      {put([](hid_t f) { H5Lcreate_hard(f, "/levels", f, "/levels/energy", H5P_DEFAULT, H5P_DEFAULT); }),
       "group '/levels/energy' is reached on two ways"},
      {[](hid_t f) { H5Ldelete(f, "/levels/energy", H5P_DEFAULT); }, "no dataset '/levels/energy'"},
  };
  for (const auto& [change, reason] : changes) {
    const std::string file = write_orbit(folder);
    alter(file, change);
    for (const std::string& said : complaints(file, folder)) {
      CHECK_THAT(said, Contains("orbit.h5") && Contains(reason));
    }
  }
}

TEST_CASE("what the problem in a record claims is compared with its datasets before it is made", "[defects]") {
  const sample::Folder folder;
  const std::string file = (folder / "lattice.h5").string();
  const std::vector<std::string> settings{"scheme.until=0.2", "grid.x.cells=21"};
  REQUIRE(rubato::run(rubato::read_problem("sine-gordon", settings), {.output = file, .threads = 1}).complete);
  std::string problem = record::Reader(file).header().problem;
  const std::size_t place = problem.find("cells = 21");
  REQUIRE(place != std::string::npos);
  problem.replace(place, 10, "cells = 2000000001");
  alter(file, [&](hid_t id) {
    H5Adelete(id, "checksums");  // which would show at once
    H5Adelete(id, "problem");
    const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
    H5Tset_size(type, H5T_VARIABLE);
    H5Tset_cset(type, H5T_CSET_UTF8);
    const hid_t attribute = H5Acreate2(id, "problem", type, space, H5P_DEFAULT, H5P_DEFAULT);
    const char* const text = problem.c_str();
    H5Awrite(attribute, type, &text);
    H5Aclose(attribute);
    H5Sclose(space);
    H5Tclose(type);
  });
  CHECK_THAT(complaint([&] { static_cast<void>(rubato::check(file)); }),
             Contains("lattice.h5: dataset '/grid/x' has 21 values; by the problem it should have 2000000001"));
  CHECK_THAT(complaint([&] { static_cast<void>(rubato::resume(file, {})); }), Contains("'/grid/x' has 21 values"));
}
