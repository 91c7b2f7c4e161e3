#include "records.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>

#include <hdf5.h>

#include <rubato/record/reader.hpp>
#include <rubato/study/problem.hpp>

namespace rubato::study_tests {

using namespace rubato::study;

Folder::Folder() {
  std::string name = (std::filesystem::temp_directory_path() / "rubato-study-XXXXXX").string();
  path_ = ::mkdtemp(name.data());
}

Outcome run_problem(const std::string& name, const std::string& file, const std::vector<std::string>& settings,
                    bool tangents) {
  // One thread: others would wait for each other where tests run side by side.
  return run(read_problem(name, settings), {.output = file, .overwrite = true, .threads = 1, .tangents = tangents});
}

Names differences(const Outcome& a, const Outcome& b, double rounding, double least_energy) {
  const Statistics& left = a.statistics;
  const Statistics& right = b.statistics;
  Names found;
  const auto expect = [&](bool same, const std::string& name) {
    if (!same) {
      found.push_back(name);
    }
  };
  const auto near = [&](double x, double y, double scale) { return std::abs(x - y) <= rounding * scale; };
  const double energy = std::max(left.energy_scale(), least_energy);
  expect(left.steps == right.steps, "steps");
  expect(left.t == right.t, "t");
  expect(left.h.min == right.h.min && left.h.max == right.h.max, "h");
  expect(near(left.energy, right.energy, energy), "discrete energy");
  expect(near(left.energy_deviation, right.energy_deviation, energy), "discrete-energy deviation");
  expect(near(left.node_energy.initial, right.node_energy.initial, energy), "initial node energy");
  expect(near(left.node_energy.max, right.node_energy.max, energy), "node-energy deviation");
  expect(left.bridges == right.bridges && left.bridge_steps == right.bridge_steps, "bridges");
  expect(near(left.bridge_deviation, right.bridge_deviation, energy), "bridge deviation");
  const double gamma = std::max({std::abs(left.gamma.min), std::abs(left.gamma.max), least_energy});
  expect(near(left.gamma.min, right.gamma.min, gamma), "least gamma");
  expect(near(left.gamma.max, right.gamma.max, gamma), "largest gamma");
  expect(left.condition == right.condition, "step condition");
  expect(left.iterations == right.iterations && left.most_iterations == right.most_iterations, "iterations");
  const auto compare_deviations = [&](const auto& x, const auto& y, const std::string& kind) {
    expect(x.size() == y.size(), "number of " + kind);
    for (std::size_t i = 0; i < std::min(x.size(), y.size()); ++i) {
      const auto& [name, value] = x[i];
      const double scale = std::max(1.0, std::abs(value.initial));
      expect(
          name == y[i].name && near(value.initial, y[i].value.initial, scale) && near(value.max, y[i].value.max, scale),
          name);
    }
  };
  compare_deviations(left.invariants, right.invariants, "invariants");
  compare_deviations(left.totals, right.totals, "totals");
  for (const auto& [name, value] : left.residuals) {
    const auto other = std::ranges::find(right.residuals, name, &Named<MaxRms>::name);
    expect(other != right.residuals.end() && value.max == other->value.max && value.rms() == other->value.rms() &&
               value.count == other->value.count,
           "residual of " + name);
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

}  // namespace rubato::study_tests
