#include "records.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>

#include <hdf5.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>

namespace rubato::run_tests {

using namespace rubato;

Folder::Folder() {
  std::string name = (std::filesystem::temp_directory_path() / "rubato-run-XXXXXX").string();
  path_ = ::mkdtemp(name.data());
}

Outcome run_problem(const std::string& name, const std::string& file, const std::vector<std::string>& settings,
                    bool tangents) {
  // One thread: others would wait for each other where tests run side by side.
  return run(read_problem(name, settings), {.output = file, .overwrite = true, .threads = 1, .tangents = tangents});
}

Names differences(const Outcome& a, const Outcome& b) {
  const Statistics& left = a.statistics;
  const Statistics& right = b.statistics;
  Names found;
  const auto expect = [&](bool same, const std::string& name) {
    if (!same) {
      found.push_back(name);
    }
  };
  expect(left.steps == right.steps, "steps");
  expect(left.t == right.t, "t");
  expect(left.h.min == right.h.min && left.h.max == right.h.max, "h");
  expect(left.energy() == right.energy(), "discrete energy");
  expect(left.energy_deviation() == right.energy_deviation(), "discrete-energy deviation");
  expect(left.node_energy.initial == right.node_energy.initial, "initial node energy");
  expect(left.node_energy.max() == right.node_energy.max(), "node-energy deviation");
  expect(left.bridges == right.bridges && left.bridge_steps == right.bridge_steps, "bridges");
  expect(left.bridge_deviation() == right.bridge_deviation(), "bridge deviation");
  expect(left.gamma.min == right.gamma.min, "least gamma");
  expect(left.gamma.max == right.gamma.max, "largest gamma");
  expect(left.condition.max == right.condition.max, "step condition");
  expect(left.all_iterations == right.all_iterations && left.iterations.max == right.iterations.max, "iterations");
  const auto compare_deviations = [&](const auto& x, const auto& y, const std::string& kind) {
    expect(x.size() == y.size(), "number of " + kind);
    for (std::size_t i = 0; i < std::min(x.size(), y.size()); ++i) {
      const auto& [name, value] = x[i];
      expect(name == y[i].name && value.has_initial() == y[i].value.has_initial() &&
                 (!value.has_initial() || value.initial == y[i].value.initial) && value.max() == y[i].value.max() &&
                 value.values.undefined == y[i].value.values.undefined,
             name);
    }
  };
  compare_deviations(left.invariants, right.invariants, "invariants");
  compare_deviations(left.totals, right.totals, "totals");
  const auto compare_sizes = [&](const auto& x, const auto& y, const std::string& kind) {
    for (const auto& [name, value] : x) {
      const auto other = std::ranges::find(y, name, &Named<rubato::Spread>::name);
      expect(other != y.end() && value.largest() == other->value.largest() && value.rms() == other->value.rms() &&
                 value.defined == other->value.defined && value.undefined == other->value.undefined,
             kind + name);
    }
  };
  compare_sizes(left.residuals, right.residuals, "residual of ");
  expect(left.errors.size() == right.errors.size(), "number of errors");
  compare_sizes(left.errors, right.errors, "error of ");
  return found;
}

Names different_datasets(const std::string& a, const std::string& b) {
  const record::Reader left(a);
  const record::Reader right(b);
  Names found;
  const auto known = right.datasets();
  for (const record::DatasetInfo& info : left.datasets()) {
    const auto other = std::ranges::find(known, info.path, &record::DatasetInfo::path);
    if (other == known.end() || other->shape != info.shape) {
      found.push_back(info.path);
    } else if (!info.is_text) {
      const std::vector<double> x = left.read(info.path);
      const std::vector<double> y = right.read(info.path);
      if (!x.empty() && std::memcmp(x.data(), y.data(), x.size() * sizeof(double)) != 0) {
        found.push_back(info.path);
      }
    }
  }
  if (known.size() != left.datasets().size()) {
    found.emplace_back("number of datasets");
  }
  return found;
}

void falsify(const std::string& file, const std::string& dataset, std::size_t index, double change) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  REQUIRE(id >= 0);
  const hid_t set = H5Dopen2(id, dataset.c_str(), H5P_DEFAULT);
  const hid_t space = H5Dget_space(set);
  std::vector<double> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  values.at(index) += change;
  H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  H5Sclose(space);
  H5Dclose(set);
  H5Fclose(id);
}

void write_text(hid_t file, const char* attribute, const char* text) {
  REQUIRE(H5Adelete(file, attribute) >= 0);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  const hid_t space = H5Screate(H5S_SCALAR);
  const hid_t id = H5Acreate2(file, attribute, type, space, H5P_DEFAULT, H5P_DEFAULT);
  REQUIRE(H5Awrite(id, type, &text) >= 0);
  H5Aclose(id);
  H5Sclose(space);
  H5Tclose(type);
}

void replace_problem(const std::string& file, const std::string& text) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  REQUIRE(id >= 0);
  write_text(id, "problem", text.c_str());
  H5Fclose(id);
}

}  // namespace rubato::run_tests
