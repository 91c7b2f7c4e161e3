// Records that were altered, and quantities that are not defined: both are reported, and neither passes for a number.

#include <catch2/catch.hpp>

#include <algorithm>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include <hdf5.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/error.hpp>
#include <rubato/record/run_shape.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

/// Opens a file of HDF5, changes it, and closes it.
void alter(const std::string& file, const std::function<void(hid_t)>& change) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  REQUIRE(id >= 0);
  change(id);
  REQUIRE(H5Fclose(id) >= 0);
}

void shorten(hid_t file, const char* path, std::vector<hsize_t> sizes) {
  const hid_t id = H5Dopen2(file, path, H5P_DEFAULT);
  REQUIRE(H5Dset_extent(id, sizes.data()) >= 0);
  H5Dclose(id);
}

/// What reading a record throws; empty if nothing. Whatever is wrong with it is wrong with the file, not with the
/// input.
std::string complaint(const std::function<void()>& reading) {
  try {
    reading();
  } catch (const rubato::record::Error& error) {
    return error.what();
  }
  return {};
}

Outcome run_text(const std::string& text, const std::string& file) {
  return run(parse_problem(text, "f.toml"), {.output = file, .overwrite = true, .threads = 1});
}

}  // namespace

TEST_CASE("a record that does not fit its own problem is a file that cannot be read", "[run]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto check_and_resume = [&](const std::function<void(hid_t)>& change) {
    REQUIRE(run_text(pendulum, file).status == ExitStatus::done);
    alter(file, change);
    return std::array{complaint([&] { static_cast<void>(check(file)); }),
                      complaint([&] { static_cast<void>(resume(file, 12.0, {.threads = 1})); })};
  };
  for (const std::string& said : check_and_resume([](hid_t) {})) {
    CHECK(said.empty());  // the twin
  }
  const auto of_earlier_version = [](const std::function<void(hid_t)>& change) {
    return [change](hid_t id) {
      REQUIRE(H5Adelete(id, "checksums") >= 0);
      change(id);
    };
  };
  const auto another_problem = [](hid_t id) { write_text(id, "problem", "[scheme]\nstpe = 1"); };
  CHECK_THAT(check_and_resume(another_problem)[1], Contains("a.h5: attribute 'problem' is not what was written"));
  for (const std::string& said : check_and_resume(of_earlier_version(another_problem))) {
    CHECK_THAT(said, Contains("a.h5: the problem in it cannot be read") && Contains("none of [hamiltonian]"));
  }
  CHECK_THAT(check_and_resume([](hid_t id) {
               shorten(id, "/states/q", {3, 1});
             })[0],
             Contains("dataset '/states/q': it should have") && Contains("rows, but has 3"));
  CHECK_THAT(check_and_resume([](hid_t id) { H5Ldelete(id, "/checkpoint/state", H5P_DEFAULT); })[1],
             Contains("cannot be continued"));
  const auto replace_checkpoint = [](hid_t id) {
    H5Ldelete(id, "/checkpoint/state", H5P_DEFAULT);
    const hsize_t one = 1;
    const hid_t space = H5Screate_simple(1, &one, nullptr);
    const hid_t data =
        H5Dcreate2(id, "/checkpoint/state", H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    const double number = 0.0;
    H5Dwrite(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, &number);
    H5Dclose(data);
    H5Sclose(space);
  };
  CHECK_THAT(check_and_resume(replace_checkpoint)[1], Contains("cannot be continued"));
  const auto fewer_rows = [](hid_t id) {
    const hid_t data = H5Dopen2(id, "/levels/h", H5P_DEFAULT);
    const hid_t rows = H5Aopen(data, "rows", H5P_DEFAULT);
    REQUIRE(rows >= 0);
    const std::int64_t number = 5;
    H5Awrite(rows, H5T_NATIVE_INT64, &number);
    H5Aclose(rows);
    H5Dclose(data);
  };
  CHECK_THAT(check_and_resume(fewer_rows)[1], Contains("dataset '/levels/h' is not what was written"));
  CHECK_THAT(check_and_resume(of_earlier_version(fewer_rows))[1], Contains("rows, but '/levels/h' has 5"));
}

TEST_CASE("a record with another version's states is checked but for its checkpoint, and not resumed", "[run]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  REQUIRE(run_text(pendulum, file).status == ExitStatus::done);
  const auto warns = [&] {
    const Outcome outcome = check(file);
    CHECK(outcome.status == ExitStatus::done);
    return std::ranges::any_of(outcome.warnings, [](const std::string& warning) {
      return warning.find("written by an earlier version") != std::string::npos;
    });
  };
  CHECK_FALSE(warns());  // the twin
  alter(file, [](hid_t id) {
    REQUIRE(H5Adelete(id, "checksums") >= 0);
    const hid_t checkpoint = H5Gopen2(id, "/checkpoint", H5P_DEFAULT);
    H5Adelete(checkpoint, "checksum");
    H5Ldelete(checkpoint, record::state_version_name, H5P_DEFAULT);
    H5Gclose(checkpoint);
  });
  CHECK(warns());
  CHECK_THAT(complaint([&] { static_cast<void>(resume(file, 12.0, {.threads = 1})); }),
             Contains("an earlier version wrote it") && Contains("run its problem again"));
}

TEST_CASE("an invariant or an exact solution that is not defined is told, and is no number", "[run]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto with = [](const std::string& tables) { return replaced(pendulum, "[scheme]", tables + "[scheme]"); };
  const auto outcomes = [&](const std::string& text) { return std::array{run_text(text, file), check(file)}; };
  for (const Outcome& sound : outcomes(with("[invariants]\nI = \"log(q + 5)\"\n[exact]\nq = \"t\"\n"))) {
    CHECK(sound.warnings.empty());
    CHECK_THAT(to_json(sound), Contains("\"I\": {\"initial\": ") && Contains("\"error\": {\"q\": {"));
  }
  // The angle passes 1 on its way; log is undefined from the start, in the middle, and at the end of the run.
  for (const char* formula : {"log(q - 5)", "log(1 - q)"}) {
    for (const Outcome& outcome : outcomes(with(std::string("[invariants]\nI = \"") + formula + "\"\n"))) {
      CHECK(outcome.status == ExitStatus::done);
      REQUIRE(outcome.warnings.size() == 1);
      CHECK_THAT(outcome.warnings.front(), Contains("the invariant I is not defined"));
      CHECK_THAT(to_json(outcome), Contains("\"undefined\": ") && !Contains("nan"));
      CHECK_THAT(to_table(outcome), Contains("no value in") && !Contains("nan"));
    }
  }
  for (const Outcome& outcome : outcomes(with("[exact]\nq = \"log(5 - t)\"\n"))) {
    REQUIRE(outcome.warnings.size() == 1);
    CHECK_THAT(outcome.warnings.front(), Contains("the exact solution of q is not defined at t = 10."));
    CHECK_THAT(to_json(outcome), Contains("\"error\": {\"q\": {\"undefined\": 1, \"count\": 1}}") && !Contains("nan"));
    CHECK_THAT(to_table(outcome), Contains("undefined at the last level"));
  }
}

TEST_CASE("a run warns of steps off the law, with the reason and the remedy", "[run]") {
  const Folder folder;
  const std::string until = "scheme.until=20", generating = "scheme.lagrangian=generating";
  for (const auto& settings : {std::vector{until}, std::vector{until, generating, std::string("scheme.order=4")}}) {
    const Outcome outcome = run_problem("pendulum-rotation", folder / "a.h5", settings);
    REQUIRE(outcome.statistics.off_law_steps > 0);
    REQUIRE(outcome.warnings.size() == 1);
    CHECK_THAT(outcome.warnings.front(), Contains("changes sign") && Contains("step_potential = \"auto\""));
    CHECK_THAT(to_table(outcome), Contains("steps off the law"));
  }
  // The twin: with a step potential there are none, and no word of them but in the JSON.
  const Outcome none = run_problem("pendulum-rotation", folder / "a.h5", {until, "scheme.step_potential=auto"});
  CHECK(none.warnings.empty());
  CHECK_THAT(to_table(none), !Contains("off the law"));
  CHECK_THAT(to_json(none), Contains("\"off_law\": {\"steps\": 0, \"max_deviation\": 0}"));
  // With H linear in q and p every step conserves it, and Γ is 0 throughout.
  const Outcome linear = run_text(
      replaced(replaced(pendulum, "p^2/2 - cos(q)", "2*q + 3*p"), "[scheme]", "[scheme]\nstep_potential = \"none\""),
      folder / "a.h5");
  REQUIRE(linear.warnings.size() == 1);
  CHECK_THAT(linear.warnings.front(), Contains("on 100 of 100 steps the discrete energy is the same to rounding"));
}
