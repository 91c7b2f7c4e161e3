// What a run tells, and what `check` makes of its record alone; and a run that stops at a singular point.

#include <catch2/catch.hpp>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <hdf5.h>

#include <rubato/record/reader.hpp>
#include <rubato/study/check.hpp>
#include <rubato/study/problem.hpp>
#include <rubato/study/run.hpp>

using namespace rubato::study;

namespace {

class Folder {
public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "rubato-study-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() { std::filesystem::remove_all(path_); }
  [[nodiscard]] std::string operator/(const std::string& name) const { return (path_ / name).string(); }

private:
  std::filesystem::path path_;
};

Outcome run_problem(const std::string& name, const std::string& file, const std::vector<std::string>& settings = {}) {
  return run(read_problem(name, settings), {.output = file, .overwrite = true});
}

/// What differs in two tables beyond rounding, by name. E_k is ∂A_k/∂t_k of states rounded to double in one and the
/// solver's own in the other: a few ε of max |H|, as is everything else but the counts, which are the same numbers.
std::vector<std::string> differences(const Outcome& a, const Outcome& b) {
  const Statistics& left = a.statistics;
  const Statistics& right = b.statistics;
  std::vector<std::string> found;
  const auto expect = [&](bool same, const std::string& name) {
    if (!same) {
      found.push_back(name);
    }
  };
  const double rounding = 64.0 * 2.2e-16;
  const auto near = [&](double x, double y, double scale) { return std::abs(x - y) <= rounding * scale; };
  const double energy = left.energy_scale();
  expect(left.steps == right.steps, "steps");
  expect(left.t == right.t, "t");
  expect(left.h.min == right.h.min && left.h.max == right.h.max, "h");
  expect(near(left.energy, right.energy, energy), "discrete energy");
  expect(near(left.energy_deviation, right.energy_deviation, energy), "discrete-energy deviation");
  expect(near(left.node_energy.initial, right.node_energy.initial, energy), "initial node energy");
  expect(near(left.node_energy.max, right.node_energy.max, energy), "node-energy deviation");
  expect(left.bridges == right.bridges && left.bridge_steps == right.bridge_steps, "bridges");
  expect(near(left.bridge_deviation, right.bridge_deviation, energy), "bridge deviation");
  expect(near(left.gamma.min, right.gamma.min, left.gamma.max), "least gamma");
  expect(near(left.gamma.max, right.gamma.max, left.gamma.max), "largest gamma");
  expect(left.condition == right.condition, "step condition");
  expect(left.iterations == right.iterations && left.most_iterations == right.most_iterations, "iterations");
  expect(left.invariants.size() == right.invariants.size(), "number of invariants");
  for (std::size_t i = 0; i < std::min(left.invariants.size(), right.invariants.size()); ++i) {
    const auto& [name, value] = left.invariants[i];
    const double scale = std::max(1.0, std::abs(value.initial));
    expect(name == right.invariants[i].name && near(value.initial, right.invariants[i].value.initial, scale) &&
               near(value.max, right.invariants[i].value.max, scale),
           name);
  }
  expect(left.errors.size() == right.errors.size(), "number of errors");
  for (std::size_t i = 0; i < std::min(left.errors.size(), right.errors.size()); ++i) {
    expect(left.errors[i].name == right.errors[i].name &&
               near(left.errors[i].value.max, right.errors[i].value.max, 1.0) &&
               near(left.errors[i].value.rms(), right.errors[i].value.rms(), 1.0),
           "error of " + left.errors[i].name);
  }
  return found;
}

/// Adds `change` to one number of a record.
void falsify(const std::string& file, const char* dataset, std::size_t index, double change) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  REQUIRE(id >= 0);
  const hid_t set = H5Dopen2(id, dataset, H5P_DEFAULT);
  const hid_t space = H5Dget_space(set);
  std::vector<double> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  values.at(index) += change;
  H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  H5Sclose(space);
  H5Dclose(set);
  H5Fclose(id);
}

using Names = std::vector<std::string>;

}  // namespace

TEST_CASE("check reproduces the table of a run from the record alone") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  for (const char* name :
       {"pendulum", "kepler", "henon-heiles", "double-well", "non-separable", "harmonic-oscillator"}) {
    for (const char* levels : {"variable", "fixed"}) {
      INFO(name << ", " << levels);
      const Outcome ran = run_problem(name, file, {std::string("scheme.levels=") + levels});
      REQUIRE(ran.status == ExitStatus::done);
      const Outcome checked = check(file);
      CHECK(differences(ran, checked) == Names{});
      // What only check tells: the states satisfy (3.3), to rounding of ∂A/∂z, whose terms are below 4.
      REQUIRE(checked.statistics.residuals.size() == 1);
      CHECK(checked.statistics.residuals[0].value.max <= 1e-13);
    }
  }
}

TEST_CASE("check with every = 7 covers the stored steps") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  const Outcome ran = run_problem("pendulum", file, {"output.every=7"});
  const Outcome checked = check(file);
  CHECK(checked.statistics.steps == ran.statistics.steps);
  CHECK(checked.statistics.relative_energy_deviation() <= 1e-13);
  CHECK(checked.statistics.node_energy.max <= ran.statistics.node_energy.max);
  CHECK(checked.statistics.node_energy.max > 0.5 * ran.statistics.node_energy.max);
  CHECK_FALSE(checked.warnings.empty());
}

TEST_CASE("check sees a record that was altered") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  const Outcome ran = run_problem("pendulum", file);
  falsify(file, "/states/p", 100, 1e-9);
  const Outcome checked = check(file);
  CHECK(checked.statistics.relative_energy_deviation() > 1e-11);
  CHECK(checked.statistics.residuals.at(0).value.max > 1e-11);
  CHECK_FALSE(differences(ran, checked) == Names{});
  // The energies that the run stored are not what it reads.
  run_problem("pendulum", file);
  falsify(file, "/levels/energy", 100, 1.0);
  CHECK(differences(ran, check(file)) == Names{});
}

TEST_CASE("Kepler with e = 0.85 stops at the singular set, and says where; its record is whole") {
  // Γ changes its sign on the orbit for e² > 5/8 (theory, section 3).
  const Folder folder;
  const std::string file = folder / "singular.h5";
  const Outcome stopped = run_problem("kepler", file, {"parameters.e=0.85", "scheme.on_singular=stop"});
  CHECK(stopped.status == ExitStatus::singular);
  CHECK_FALSE(stopped.complete);
  CHECK(stopped.statistics.steps > 10);
  const rubato::record::Reader reader(file);
  const std::vector<double> t = reader.read("/levels/t");
  const std::vector<double> gamma = reader.read("/levels/gamma");
  const std::vector<double> h = reader.read("/levels/h");
  CHECK_THAT(stopped.message, Catch::Contains(fmt::format("t = {:.10g}", t.back())));
  CHECK_THAT(stopped.message, Catch::Contains(fmt::format("Gamma = {:.4g}", gamma.back())));
  CHECK_THAT(stopped.message, Catch::Contains(fmt::format("h = {:.4g}", h.back())));
  CHECK(t.size() == stopped.statistics.steps + 1);
  CHECK(h.size() == stopped.statistics.steps);
  CHECK(reader.rows("/states/q") == t.size());
  CHECK(reader.rows("/states/p") == t.size());
  CHECK(t.back() == stopped.statistics.t);
  CHECK_FALSE(reader.header().finished);
  CHECK(differences(stopped, check(file)) == Names{});
  // The twins: e = 0.6 does not stop, and a record one step longer is told apart.
  const Outcome whole = run_problem("kepler", folder / "whole.h5", {"scheme.on_singular=stop"});
  CHECK(whole.status == ExitStatus::done);
  CHECK(whole.message.empty());
  CHECK_FALSE(differences(stopped, whole) == Names{});
}

TEST_CASE("the forward discrete Lagrangian is refused as wrong input, and nothing is written") {
  const Folder folder;
  const std::string file = folder / "forward.h5";
  CHECK_THROWS_WITH(run_problem("pendulum", file, {"scheme.lagrangian=forward"}),
                    Catch::Contains("unstable") && Catch::Contains("allow_unstable"));
  CHECK_FALSE(std::filesystem::exists(file));
  CHECK_NOTHROW(run_problem("pendulum", file, {"scheme.lagrangian=forward", "scheme.until=0.3"}));
  CHECK(std::filesystem::exists(file));
}
