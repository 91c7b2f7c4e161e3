// [initial] from datasets of other programs, and random data.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <hdf5.h>

#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

/// A file as another program might write it.
class DataFile {
public:
  explicit DataFile(const std::string& name) : file_(H5Fcreate(name.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)) {
    REQUIRE(file_ >= 0);
  }
  ~DataFile() { H5Fclose(file_); }
  DataFile(const DataFile&) = delete;
  DataFile& operator=(const DataFile&) = delete;

  void group(const std::string& name) {
    H5Gclose(H5Gcreate2(file_, name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  }
  void put(const std::string& name, const std::vector<hsize_t>& shape, const std::vector<double>& values,
           hid_t type = H5T_IEEE_F64LE) {
    const hid_t space = H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr);
    const hid_t set = H5Dcreate2(file_, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    REQUIRE(H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) >= 0);
    H5Dclose(set);
    H5Sclose(space);
  }

private:
  hid_t file_;
};

const std::string plane = R"toml([multisymplectic]
fields = ["u", "v", "w", "s"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
K.y = [["u", "s", 1]]
S = "(v^2 - w^2 - s^2)/2 + 1 - cos(u)"
[grid]
x = { from = 0, to = 6, cells = 9 }
y = { from = -1, to = 1, cells = 7 }
[initial]
INITIAL
[scheme]
lagrangian = "splitting"
levels = "fixed"
step = 0.1
until = 10
[laws]
every = "off"
)toml";

double wave(double x, double y) {
  return 0.3 + std::cos(2.0 * std::numbers::pi * (x / 6.0)) * std::sin(std::numbers::pi * (y + 1.0));
}

/// u = wave(1 + level) on [level][y][x].
std::vector<double> waves_on(std::size_t levels, std::size_t rows, std::size_t columns) {
  std::vector<double> values;
  for (std::size_t level = 0; level < levels; ++level) {
    for (std::size_t j = 0; j < rows; ++j) {
      for (std::size_t i = 0; i < columns; ++i) {
        const double x = 6.0 * static_cast<double>(i) / static_cast<double>(columns);
        const double y = -1.0 + 2.0 * static_cast<double>(j) / static_cast<double>(rows);
        values.push_back(wave(x, y) * static_cast<double>(1 + level));
      }
    }
  }
  return values;
}

std::vector<double> start_of(const std::string& initial, const std::string& file, const std::string& cells = "9") {
  const Problem problem = parse_problem(replaced(plane, "INITIAL", initial), "t.toml",
                                        std::vector{"grid.x.cells=" + cells, std::string("scheme.max_steps=1")});
  static_cast<void>(run(problem, {.output = file}));
  return record::Reader(file).read("/states/u", 0, 1);
}

std::string refused(const std::string& text, const Folder& folder) {
  try {
    static_cast<void>(run(parse_problem(text, "t.toml"), {.output = folder / "never.h5"}));
  } catch (const ProblemError& error) {
    CHECK_FALSE(std::filesystem::exists(folder / "never.h5"));
    return error.what();
  }
  return "";
}

double farthest(const std::vector<double>& u, double factor) {
  double result = 0.0;
  for (std::size_t j = 0; j < 7; ++j) {
    for (std::size_t i = 0; i < 9; ++i) {
      const double x = 6.0 * static_cast<double>(i) / 9.0, y = -1.0 + 2.0 * static_cast<double>(j) / 7.0;
      result = std::max(result, std::abs(u[9 * j + i] - factor * wave(x, y)));
    }
  }
  return result;
}

}  // namespace

TEST_CASE("fields start from datasets of another program, by waves where the grids differ") {
  const Folder folder;
  const std::string data = folder / "data.h5";
  {
    DataFile file(data);
    file.put("u", {3, 5, 12}, waves_on(3, 5, 12));
    file.put("t", {3}, {0.0, 1.0, 2.5});
    file.put("rest", {4}, {1, 2, 3, 4});
    file.group("final");
    file.put("final/u", {7, 9}, waves_on(1, 7, 9));
    file.put("final/x", {9}, {0, 0.66667, 1.33333, 2, 2.66667, 3.33333, 4, 4.66667, 5.33333}, H5T_IEEE_F32LE);
  }
  // One wave along each axis is resolved by 5 and 12 nodes: what differs is rounding.
  CHECK(farthest(start_of(fmt::format("from = \"{}\"\nv = 0", data), folder / "last.h5"), 3.0) < 1e-14);
  CHECK(record::Reader(folder / "last.h5").read("/states/t", 0, 1).front() == 2.5);
  CHECK(farthest(start_of(fmt::format("from = \"{}\"\nat = 0.8\nv = 0", data), folder / "at.h5"), 2.0) < 1e-14);
  CHECK(farthest(start_of(fmt::format("from = \"{}\"\nat = 0.8\nt = 0\nv = 0", data), folder / "t.h5"), 3.0) > 0.1);
  CHECK(record::Reader(folder / "t.h5").read("/states/t", 0, 1).front() == 0.0);
  CHECK(farthest(start_of(fmt::format("from = \"{}:/final\"\nv = 0", data), folder / "group.h5"), 1.0) < 1e-14);
  std::filesystem::remove(data);
  CHECK(check(folder / "at.h5").status != ExitStatus::contradiction);  // the record does not need the data
  CHECK(resume(folder / "at.h5", std::nullopt, {}).status != ExitStatus::file_error);
}

TEST_CASE("orbits start from datasets of another program") {
  const Folder folder;
  const std::string data = folder / "data.h5";
  {
    DataFile file(data);
    file.put("r", {2, 2}, {1, 2, 3, 4});
    file.put("p1", {2}, {5, 6});
    file.put("p2", {2}, {7, 8}, H5T_STD_I32LE);
    file.put("t", {2}, {0.5, 1.5});
  }
  const std::string text = fmt::format(R"toml([hamiltonian]
q = ["r[2]"]
p = ["p[2]"]
H = "dot(p, p)/2 + norm(r)^2"
[initial]
from = "{}"
[scheme]
step = 0.1
until = 5
)toml",
                                       data);
  const Problem last = parse_problem(text, "t.toml");
  CHECK(last.hamiltonian()->initial.q == std::vector<double>{3, 4});
  CHECK(last.hamiltonian()->initial.p == std::vector<double>{6, 8});
  CHECK(last.hamiltonian()->initial.t == 1.5);
  const Problem first = parse_problem(replaced(text, "[scheme]", "at = 0.4999999999\nr2 = 9\n[scheme]"), "t.toml");
  CHECK(first.hamiltonian()->initial.q == std::vector<double>{1, 9});
  CHECK(first.hamiltonian()->initial.p == std::vector<double>{5, 7});
}

TEST_CASE("one number starts all components of a vector") {
  const std::string text = R"toml([hamiltonian]
q = ["r[3]", "s"]
p = ["p[3]", "w"]
H = "(dot(p, p) + w^2)/2 + norm(r)^2 + s^2"
[initial]
r = 0.25
s = 2
p = 0
w = 1
[scheme]
step = 0.1
until = 5
)toml";
  const Problem one = parse_problem(text, "t.toml");
  CHECK(one.hamiltonian()->initial.q == std::vector<double>{0.25, 0.25, 0.25, 2});
  CHECK(one.hamiltonian()->initial.p == std::vector<double>{0, 0, 0, 1});
  CHECK(parse_problem(replaced(text, "r = 0.25", "r = [1, 2, 3]"), "t.toml").hamiltonian()->initial.q[1] == 2.0);
  CHECK_THROWS_WITH(parse_problem(replaced(text, "r = 0.25", "r = 0.25\nr2 = 1"), "t.toml"), Contains("given twice"));
  CHECK_THROWS_WITH(parse_problem(replaced(text, "r = 0.25", "r = [1, 2]"), "t.toml"),
                    Contains("declared as r[3]: give 3, one number for all"));
  CHECK_THROWS_WITH(parse_problem(replaced(text, "p = 0\n", ""), "t.toml"), Contains("p1"));
}

TEST_CASE("data that do not fit are refused with the reason, and nothing is written") {
  const Folder folder;
  const std::string data = folder / "data.h5";
  {
    DataFile file(data);
    file.put("u", {5, 12}, waves_on(1, 5, 12));
    file.put("v", {12}, std::vector<double>(12, 0.0));
    file.group("places");
    file.put("places/u", {5, 12}, waves_on(1, 5, 12));
    file.put("places/x", {12}, {0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5.1, 5.5});
    file.group("undefined");
    file.put("undefined/u", {5, 12}, std::vector<double>(60, std::nan("")));
    file.group("levels");
    file.put("levels/u", {2, 5, 12}, waves_on(2, 5, 12));
    file.put("levels/t", {3}, {0, 1, 2});
    file.group("other");
    file.put("other/psi", {3}, {0, 1, 2});
  }
  const auto from = [&](const std::string& group, const std::string& rest) {
    return refused(replaced(plane, "INITIAL", fmt::format("from = \"{}{}\"\n{}", data, group, rest)), folder);
  };
  CHECK(from("", "v = 0").empty());  // the twin: these can be used
  std::filesystem::remove(folder / "never.h5");
  CHECK_THAT(from("", ""), Contains("v has 1 indices, and a field on this grid 2"));
  CHECK_THAT(from("", "at = 1\nv = 0"), Contains("has no dataset t, and so no levels"));
  CHECK_THAT(from(":/places", "v = 0"), Contains("x[10] = 5.1") && Contains("t.toml:11:9"));
  CHECK_THAT(from(":/undefined", "v = 0"), Contains("u has a value that is not finite"));
  CHECK_THAT(from(":/levels", "v = 0"), Contains("u has 2 levels, and t 3"));
  CHECK_THAT(from(":/levels", "at = 7\nv = 0"), Contains("at = 7 is outside of"));
  CHECK_THAT(from(":/other", "v = 0"), Contains("has no dataset of a name that is needed here; it has psi"));
  CHECK_THAT(from(":/nothing", "v = 0"), Contains("has no group /nothing"));
  CHECK_THAT(from(":/u", "v = 0"), Contains("not a group"));
}

TEST_CASE("random waves are the same function on every grid, of mean 0 and deviation 1") {
  const Folder folder;
  const std::string initial = "u = \"noise(5, 3)\"\nv = \"noise(6, 3)\"";
  const std::vector<double> coarse = start_of(initial, folder / "9.h5"),
                            fine = start_of(initial, folder / "27.h5", "27");
  double sum = 0.0, squares = 0.0, largest = 0.0;
  for (std::size_t j = 0; j < 7; ++j) {
    for (std::size_t i = 0; i < 9; ++i) {
      const double u = coarse[9 * j + i];
      CHECK(u == Approx(fine[27 * j + 3 * i]).margin(1e-13));
      sum += u;
      squares += u * u;
      largest = std::max(largest, std::abs(u));
    }
  }
  CHECK(std::abs(sum / 63.0) < 1e-13);  // no constant, and 3 waves are resolved by 7 and 9 nodes
  // Of 24 pairs of amplitudes: the mean square has deviation sqrt(2/48), four of which are 0.82.
  CHECK(squares / 63.0 == Approx(1.0).margin(0.82));
  CHECK(largest > 0.5);
  CHECK(start_of("u = \"noise(7, 3)\"\nv = 0", folder / "other.h5") != coarse);
  CHECK(start_of(initial, folder / "again.h5") == coarse);
}

TEST_CASE("random numbers by their seed, and what is wrong with noise") {
  const Folder folder;
  const auto with = [](const std::string& q) {
    return parse_problem(replaced(pendulum, "q = 0", "q = " + q), "t.toml");
  };
  const auto number = [&](const std::string& q) { return with(q).hamiltonian()->initial.q.front(); };
  CHECK(number("\"noise(1)\"") == number("\"noise(2 - 1)\""));
  CHECK(number("\"noise(1)\"") != number("\"noise(2)\""));
  CHECK(number("\"sum(i, 1, 1000, noise(i)^2)/1000\"") == Approx(1.0).margin(4.0 * std::sqrt(2.0 / 1000.0)));
  CHECK(number("\"sum(i, 1, 1000, noise(i))/1000\"") == Approx(0.0).margin(4.0 / std::sqrt(1000.0)));
  const auto refusal = [&](const std::string& u) {
    return refused(replaced(plane, "INITIAL", "u = \"" + u + "\"\nv = 0"), folder);
  };
  CHECK_THAT(refusal("noise(x, 2)"), Contains("t.toml:11:12") && Contains("the seed of noise has to be an integer"));
  CHECK_THAT(refusal("noise(1, 0)"), Contains("t.toml:11:6") && Contains("from 1 on"));
  CHECK_THAT(refusal("noise(1, 200)"), Contains("at most 5000"));
  CHECK_THAT(refusal("noise(1, 2, 3)"), Contains("separates the arguments"));
  CHECK_THAT(refused(replaced(pendulum, "q = 0", "q = \"noise(1, 2)\""), folder), Contains("noise(seed) is a number"));
}

TEST_CASE("[laws] every may be off, as it may be false") {
  const auto with = [](const std::string& every) {
    return parse_problem(pendulum, "t.toml", std::vector<std::string>{"laws.every=" + every}).laws.every;
  };
  CHECK(with("off") == 0);
  CHECK(with("false") == 0);
  CHECK(with("2") == 2);
  CHECK_THROWS_WITH(with("on"), Contains("every"));
}
