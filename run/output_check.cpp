#include <rubato/run/output_check.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <rubato/run/kept_row.hpp>

namespace rubato {

namespace {

double largest_of(std::span<const double> values) {
  double largest = 0.0;
  for (const double value : values) {
    largest = std::isfinite(value) ? std::max(largest, std::abs(value)) : largest;
  }
  return largest;
}

}  // namespace

OutputCheck::OutputCheck(const SharedRecord& record, const StoredLevels& levels, const Problem& problem,
                         std::size_t components, Disagreements& findings)
    : record_(record),
      levels_(levels),
      problem_(problem),
      findings_(findings),
      parts_(record.slab(), findings),
      maker_(make_output(problem)),
      scales_(record.slab(), components) {
  if (maker_ == nullptr) {
    return;
  }
  record::Layout layout;
  maker_->describe(layout);
  for (const record::Dataset& dataset : layout.datasets) {
    columns_.emplace_back(record_, dataset);
  }
  const std::size_t rows = columns_.front().rows();
  const bool fits = find_places(rows);
  for (const SharedRows& column : columns_) {
    record_.at_rank_0([&] {
      if (!fits || column.rows() != rows) {
        throw figures::Mismatch(record_.reader()->file(), column.path(),
                                fmt::format("{} has {} rows, which the problem and the levels do not lead to",
                                            column.path(), column.rows()));
      }
    });
  }
}

bool OutputCheck::find_places(std::size_t rows) {
  return problem_.output.has_times() ? find_times(rows) : find_levels(rows);
}

bool OutputCheck::find_levels(std::size_t rows) {
  const auto levels = every_nth(rows, static_cast<std::size_t>(problem_.output.every), levels_.last);
  if (!levels) {
    return false;
  }
  std::size_t state = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    const std::size_t level = (*levels)[row];
    while (state < levels_.state_level.size() && levels_.state_level[state] < level) {
      ++state;
    }
    if (const auto at = levels_.row_of(level)) {
      places_.push_back({level, levels_.clock[*at], row});
    } else if (state < levels_.state_level.size() && levels_.state_level[state] == level && !problem_.clock()) {
      places_.push_back({level, levels_.state_t[state], row});
    }
  }
  return true;
}

bool OutputCheck::find_times(std::size_t rows) {
  // Whether a time so near to the level before belongs to this step depends on the length of the step before.
  constexpr double doubtful = 1e-6;
  const OutputTimes times(problem_);
  std::size_t next = 0;
  for (std::size_t row = 0; row < levels_.t.size(); ++row) {
    const bool follows = row == 0 || levels_.level[row - 1] + 1 == levels_.level[row];
    const double t = levels_.clock[row];
    double h = row == 0 ? 0.0 : levels_.h[row - 1];
    if (problem_.clock()) {  // of a step from a level without a row it is not known
      h = row > 0 && follows ? t - levels_.clock[row - 1] : 0.0;
    }
    for (; const auto time = times.due(next, t, h); ++next) {
      if (follows || std::abs(*time - t) < (1.0 - doubtful) * std::abs(h)) {
        places_.push_back({levels_.level[row], *time, next});
      }
    }
  }
  // Behind the last level with a row there may be more.
  if (levels_.level.back() != levels_.last) {
    return rows >= next;
  }
  const bool may_have_one_more = problem_.clock() && !levels_.complete();
  return rows == next || (may_have_one_more && rows == next + 1);
}

void OutputCheck::check_times() {
  if (maker_ == nullptr) {
    return;
  }
  record_.at_rank_0([&] {
    StoredRows stored(*record_.reader(), "/output/t");
    constexpr const char* reason = "[output] of the problem";
    if (stored.rows() != columns_.front().rows()) {
      throw figures::Mismatch(record_.reader()->file(), stored.path(),
                              fmt::format("{} has {} rows, and {} has {}", stored.path(), stored.rows(),
                                          columns_.front().path(), columns_.front().rows()));
    }
    if (!problem_.output.has_times()) {
      for (const Place& place : places_) {
        findings_.same(stored.path(), place.row, {}, stored.at(place.row), place.t, reason);
      }
      return;
    }
    const OutputTimes times(problem_);
    for (std::size_t row = 0; row < stored.rows(); ++row) {
      constexpr double none = std::numeric_limits<double>::quiet_NaN();
      findings_.same(stored.path(), row, {}, stored.at(row), times.time(row).value_or(none), reason);
    }
  });
}

/// make(sink, attempt): the row, of states that are displaced unless `attempt` is negative.
template <typename Make>
void OutputCheck::compare(std::size_t row, Make&& make) {
  KeptRow sound(columns_.size());
  make(sound, -1);
  // Of a row in parts what this rank has: ghosts are nobody's.
  const grids::Slab* const slab = record_.slab();
  const auto here = [&](std::size_t i, const KeptRow& made) {
    const std::span<const double> values = made.at(i);
    return columns_[i].are_in_parts() ? values.subspan(slab->first_node(), slab->owned()) : values;
  };
  std::vector<double> allowed;
  const auto tolerance = [&](std::size_t dataset) {
    if (allowed.empty()) {
      allowed.assign(columns_.size(), 0.0);
      for (int attempt = 0; attempt < Rounding::displacements; ++attempt) {
        KeptRow moved(columns_.size());
        make(moved, attempt);
        for (std::size_t i = 0; i < columns_.size(); ++i) {
          const auto before = here(i, sound), after = here(i, moved);
          for (std::size_t k = 0; k < before.size(); ++k) {
            const double change = std::abs(after[k] - before[k]) / Rounding::displacement;
            allowed[i] = change > allowed[i] ? change : allowed[i];
          }
        }
      }
      for (std::size_t i = 0; i < columns_.size(); ++i) {
        double largest = largest_of(here(i, sound));
        if (slab != nullptr) {
          allowed[i] = slab->largest_over_ranks(allowed[i]);
          largest = slab->largest_over_ranks(largest);
        }
        allowed[i] = Rounding::unit * (allowed[i] + largest);
      }
    }
    return allowed[dataset];
  };
  constexpr const char* reason = "from the levels around that time";
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    const std::span<const double> stored = columns_[i].row(row);
    if (columns_[i].are_in_parts()) {
      parts_.compare(
          columns_[i].path(), row, stored, [&](std::size_t k) { return sound.at(i)[k]; }, [&] { return tolerance(i); },
          reason);
      continue;
    }
    for (std::size_t k = 0; k < stored.size(); ++k) {
      findings_.compare(
          columns_[i].path(), row, stored.size() == 1 ? std::nullopt : std::optional(k), stored[k], sound.at(i)[k],
          [&] { return tolerance(i); }, reason);
    }
  }
}

void OutputCheck::check_level(std::size_t state_row, std::span<const double> z) {
  if (maker_ == nullptr) {
    return;
  }
  scales_.see(z);
  const std::size_t level = levels_.state_level[state_row];
  if (problem_.output.has_times() && level > 0) {
    return;
  }
  const auto begin = std::ranges::lower_bound(places_, level, {}, &Place::level);
  for (auto place = begin; place != places_.end() && place->level == level; ++place) {
    compare(place->row, [&](RowSink& sink, int attempt) {
      static_cast<void>(attempt < 0 ? maker_->append(sink, z, place->t)
                                    : maker_->append(sink, scales_.displaced(z, attempt, 1), place->t));
    });
  }
}

void OutputCheck::check_step(std::size_t state_row, std::span<const double> before, std::span<const double> z) {
  const auto step_row = levels_.step_to(state_row);
  if (maker_ == nullptr || !problem_.output.has_times() || !step_row) {
    return;
  }
  const std::size_t level = levels_.state_level[state_row];
  OutputStep step{.z_0 = before,
                  .z_1 = z,
                  .t_0 = levels_.t_before(state_row),
                  .t_1 = levels_.state_t[state_row],
                  .h = levels_.h[*step_row],
                  .clock = problem_.clock()};
  const auto begin = std::ranges::lower_bound(places_, level, {}, &Place::level);
  for (auto place = begin; place != places_.end() && place->level == level; ++place) {
    compare(place->row, [&](RowSink& sink, int attempt) {
      if (attempt < 0) {
        static_cast<void>(maker_->append(sink, step, place->t));
        return;
      }
      const std::vector<double> z_0 = scales_.displaced(before, attempt, 0), z_1 = scales_.displaced(z, attempt, 1);
      OutputStep moved = step;
      moved.z_0 = z_0;
      moved.z_1 = z_1;
      static_cast<void>(maker_->append(sink, moved, place->t));
    });
  }
}

}  // namespace rubato
