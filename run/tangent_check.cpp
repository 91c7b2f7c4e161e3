#include <rubato/run/tangent_check.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/base/limits.hpp>
#include <rubato/run/kept_row.hpp>

namespace rubato {

TangentCheck::TangentCheck(const record::Reader& reader, const StoredLevels& levels, const Problem& problem,
                           Disagreements& findings)
    : levels_(levels),
      findings_(findings),
      clock_(problem.clock()),
      writer_(levels.complete() ? make_tangents(problem) : nullptr) {
  if (writer_ == nullptr) {
    return;
  }
  writer_->describe(layout_);
  for (const record::Dataset& dataset : layout_.datasets) {
    columns_.emplace_back(reader, dataset.path, record::row_size(layout_, dataset));
  }
}

void TangentCheck::begin() {
  if (writer_ == nullptr) {
    return;
  }
  KeptRow row(columns_.size());
  writer_->append_state(row);
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (!row.at(i).empty()) {
      compare(i, 0, row.at(i), "of the start");
    }
  }
}

void TangentCheck::check_step(std::size_t state_row, std::span<const double> before, std::span<const double> z) {
  if (writer_ == nullptr) {
    return;
  }
  writer_->take({.z_0 = before,
                 .z_1 = z,
                 .t_0 = levels_.t[state_row - 1],
                 .t_1 = levels_.t[state_row],
                 .h = levels_.h[state_row - 1],
                 .clock = clock_});
  for (const double logarithm : writer_->logarithms()) {
    stretch_ = std::max(stretch_, std::exp(std::abs(logarithm)));
  }
  KeptRow row(columns_.size());
  writer_->append_step(row);
  writer_->append_state(row);
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (!row.at(i).empty()) {
      compare(i, layout_.datasets[i].axis == "/levels/step" ? state_row - 1 : state_row, row.at(i),
              "by the tangents of the steps to this level");
    }
  }
}

/// Where the program evaluates formulas with other instructions a tangent errs in its last digits, some in each of the
/// sums of a step; vectors that turn by that are further off after each step, about like the number of steps, and
/// logarithms and derivatives, relative to the largest of them, likewise.
void TangentCheck::compare(std::size_t dataset, std::size_t row, std::span<const double> found, const char* reason) {
  constexpr double digits_of_step = 256.0;
  figures::StoredRows& column = columns_[dataset];
  double largest = 1.0;
  for (const double value : found) {
    largest = std::max(largest, std::abs(value));
  }
  const double allowed = digits_of_step * epsilon * stretch_ * largest * static_cast<double>(writer_->steps() + 1);
  const std::span<const double> stored = column.row(row);
  for (std::size_t k = 0; k < stored.size(); ++k) {
    findings_.compare(
        column.path(), row, stored.size() == 1 ? std::nullopt : std::optional(k), stored[k], found[k],
        [allowed] { return allowed; }, reason);
  }
}

}  // namespace rubato
