#include <rubato/study/stored.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace rubato::study {

namespace {

/// Values of one dataset in memory: many rows of a small grid, so that no chunk is read again and again.
constexpr std::size_t values_at_once = std::size_t{1} << 18;

}  // namespace

StoredRows::StoredRows(const record::Reader& reader, std::string path, std::size_t row_size)
    : reader_(reader), path_(std::move(path)), row_size_(row_size) {
  if (!reader.has(path_)) {
    throw record::Error(reader.file(), fmt::format("there is no dataset {}", path_));
  }
  const record::DatasetInfo info = reader.info(path_);
  if (info.is_text || info.shape.empty() || info.row_size() != row_size) {
    throw record::Error(reader.file(), fmt::format("a row of {} has {} values; by the problem it should have {}", path_,
                                                   info.row_size(), row_size));
  }
  rows_ = info.shape.front();
  block_ = std::max<std::size_t>(1, values_at_once / std::max<std::size_t>(1, row_size));
}

std::span<const double> StoredRows::row(std::size_t row) {
  if (row < first_ || row >= first_ + values_.size() / row_size_) {
    first_ = row - row % block_;
    values_ = reader_.read(path_, first_, std::min(block_, rows_ - std::min(rows_, first_)));
  }
  return std::span<const double>(values_).subspan((row - first_) * row_size_, row_size_);
}

StoredLevels::StoredLevels(const record::Reader& reader)
    : t(reader.read("/levels/t")),
      h(reader.read("/levels/h")),
      bridged(reader.read("/levels/bridged")),
      crossing(reader.read("/levels/crossing")),
      condition(reader.read("/levels/step_condition")),
      state_t(reader.read("/states/t")),
      sparse(reader.has("/states/previous/t")) {
  for (const double level : reader.read("/states/level")) {
    state_level.push_back(static_cast<std::size_t>(level));
  }
  const bool ascending = std::ranges::adjacent_find(state_level, std::ranges::greater_equal()) == state_level.end() &&
                         !state_level.empty() && state_level.front() == 0 && state_level.back() < t.size() &&
                         (sparse || state_level.size() == state_level.back() + 1);
  if (t.size() != h.size() + 1 || bridged.size() != h.size() || crossing.size() != h.size() ||
      condition.size() != h.size() || state_t.size() != state_level.size() || !ascending) {
    throw record::Error(reader.file(), fmt::format("{} levels, {} steps and {} stored states do not fit together",
                                                   t.size(), h.size(), state_level.size()));
  }
}

double StoredLevels::mismatch() const {
  // Either time, or start + k·step with both terms, is rounded.
  const double rounding =
      4.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(t.front()), std::abs(t.back()));
  double worst = 0.0;
  const auto compare = [&](double a, double b) {
    const double difference = std::abs(a - b);
    worst = difference <= rounding ? worst : std::max(worst, difference);
  };
  for (std::size_t k = 0; k < h.size(); ++k) {
    compare(t[k + 1], t[k] + h[k]);
  }
  for (std::size_t row = 0; row < state_t.size(); ++row) {
    compare(state_t[row], t[state_level[row]]);
  }
  return worst;
}

Problem stored_problem(const record::Reader& reader) {
  try {
    return parse_problem(reader.header().problem, reader.file().string());
  } catch (const ProblemError& error) {
    throw record::Error(reader.file(), fmt::format("the problem in it cannot be read ({})", error.what()));
  }
}

void copy_counts(const record::Reader& reader, const StoredLevels& levels, Statistics& statistics) {
  statistics.steps = levels.h.size();
  statistics.t = levels.t.back();
  for (const double h : levels.h) {
    statistics.h.add(h);
  }
  for (std::size_t k = 0; k < levels.h.size(); ++k) {
    const bool bridge = levels.bridged[k] != 0.0;
    statistics.bridge_steps += bridge ? 1 : 0;
    statistics.bridges += levels.crossing[k] != 0.0 ? 1 : 0;
    statistics.condition = std::max(statistics.condition, bridge ? 0.0 : levels.condition[k]);
  }
  for (const double iterations : reader.read("/levels/iterations")) {
    statistics.iterations += iterations;
    statistics.most_iterations = std::max(statistics.most_iterations, iterations);
  }
}

}  // namespace rubato::study
