#include "records.hpp"

#include <catch2/catch.hpp>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>

#include <hdf5.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>

namespace rubato::run_tests {

using namespace rubato;

Outcome run_problem(const std::string& name, const std::string& file, const std::vector<std::string>& settings,
                    bool tangents) {
  // One thread: others would wait for each other where tests run side by side.
  return run(read_problem(name, settings), {.output = file, .overwrite = true, .threads = 1, .tangents = tangents});
}

EnsembleOutcome interrupt_after(std::size_t count, const Problem& problem, const std::string& file, bool start,
                                int threads) {
  std::atomic<bool> stop = false;
  const std::size_t finished = start ? 0 : record::Reader(file).rows("/members/number");
  const RunOptions options{.output = file,
                           .threads = threads,
                           .interrupt = &stop,
                           .progress = [&](const Progress& progress) { stop = progress.steps >= finished + count; },
                           .progress_interval = {}};
  return start ? run_ensemble(problem, options) : resume_ensemble(file, options);
}

namespace {

bool identical(double x, double y) {
  return x == y;
}

/// Sums of several ranks are rounded once, and so are their differences; figures and fields of the tests are of size 1,
/// and 45 roundings lie above all that follows from them.
bool agree_to_rounding(double x, double y) {
  return x == y || (std::isnan(x) && std::isnan(y)) || std::abs(x - y) <= 1e-14 * std::max(1.0, std::abs(x));
}

Names differences_by(const Outcome& a, const Outcome& b, bool (*same)(double, double)) {
  const Statistics& left = a.statistics;
  const Statistics& right = b.statistics;
  Names found;
  const auto expect = [&](bool is_met, const std::string& name) {
    if (!is_met) {
      found.push_back(name);
    }
  };
  expect(left.steps == right.steps, "steps");
  expect(same(left.t, right.t), "t");
  expect(same(left.h.min, right.h.min) && same(left.h.max, right.h.max), "h");
  expect(same(left.energy(), right.energy()), "discrete energy");
  expect(same(left.energy_deviation(), right.energy_deviation()), "discrete-energy deviation");
  expect(same(left.node_energy.initial, right.node_energy.initial), "initial node energy");
  expect(same(left.node_energy.max(), right.node_energy.max()), "node-energy deviation");
  expect(left.off_law_steps == right.off_law_steps, "steps off the law");
  expect(same(left.off_law_deviation(), right.off_law_deviation()), "deviation off the law");
  expect(same(left.gamma.min, right.gamma.min), "least gamma");
  expect(same(left.gamma.max, right.gamma.max), "largest gamma");
  expect(same(left.condition.max, right.condition.max), "step condition");
  expect(left.all_iterations == right.all_iterations && left.iterations.max == right.iterations.max, "iterations");
  const auto compare_deviations = [&](const auto& x, const auto& y, const std::string& kind) {
    expect(x.size() == y.size(), "number of " + kind);
    for (std::size_t i = 0; i < std::min(x.size(), y.size()); ++i) {
      const auto& [name, value] = x[i];
      expect(name == y[i].name && value.has_initial() == y[i].value.has_initial() &&
                 (!value.has_initial() || same(value.initial, y[i].value.initial)) &&
                 same(value.max(), y[i].value.max()) && value.values.undefined == y[i].value.values.undefined,
             name);
    }
  };
  compare_deviations(left.invariants, right.invariants, "invariants");
  compare_deviations(left.totals, right.totals, "totals");
  const auto compare_sizes = [&](const auto& x, const auto& y, const std::string& kind) {
    for (const auto& [name, value] : x) {
      const auto other = std::ranges::find(y, name, &Named<rubato::Spread>::name);
      expect(other != y.end() && same(value.largest(), other->value.largest()) &&
                 same(value.rms(), other->value.rms()) && value.defined == other->value.defined &&
                 value.undefined == other->value.undefined,
             kind + name);
    }
  };
  compare_sizes(left.residuals, right.residuals, "residual of ");
  expect(left.errors.size() == right.errors.size(), "number of errors");
  compare_sizes(left.errors, right.errors, "error of ");
  return found;
}

Names different_by(const std::string& a, const std::string& b, const std::function<bool(double, double)>& same) {
  const record::Reader left(a);
  const record::Reader right(b);
  Names found;
  const auto known = right.datasets();
  for (const record::DatasetInfo& info : left.datasets()) {
    const auto other = std::ranges::find(known, info.path, &record::DatasetInfo::path);
    if (other == known.end() || other->shape != info.shape) {
      found.push_back(info.path);
    } else if (!info.is_text && !std::ranges::equal(left.read(info.path), right.read(info.path), same)) {
      found.push_back(info.path);
    }
  }
  if (known.size() != left.datasets().size()) {
    found.emplace_back("number of datasets");
  }
  return found;
}

}  // namespace

Names differences(const Outcome& a, const Outcome& b) {
  return differences_by(a, b, identical);
}

Names differences_on_ranks(const Outcome& a, const Outcome& b) {
  return differences_by(a, b, agree_to_rounding);
}

Names different_datasets(const std::string& a, const std::string& b) {
  return different_by(
      a, b, [](double x, double y) { return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y); });
}

Names different_on_ranks(const std::string& a, const std::string& b) {
  Names found = different_by(a, b, agree_to_rounding);
  std::erase_if(found, [](const std::string& path) { return path.starts_with("/checkpoint/"); });
  return found;
}

double largest_distance(const std::vector<double>& a, const std::vector<double>& b) {
  REQUIRE(a.size() == b.size());
  double result = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    result = std::max(result, std::abs(a[i] - b[i]));
  }
  return result;
}

std::vector<double> last_row(const record::Reader& reader, const std::string& path) {
  return reader.read(path, reader.info(path).shape.front() - 1, 1);
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
