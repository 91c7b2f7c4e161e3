#include <rubato/run/output_check.hpp>

#include <algorithm>
#include <cmath>

namespace rubato {

namespace {

/// The rows of one time, dataset by dataset.
class Row final : public RowSink {
public:
  using RowSink::append;
  explicit Row(std::size_t datasets) : values_(datasets) {}

  void append(record::Column column, std::span<const double> row) override {
    values_.at(column.number).assign(row.begin(), row.end());
  }
  void append(record::Column column, std::span<const std::int64_t> row) override {
    values_.at(column.number).assign(row.begin(), row.end());
  }
  [[nodiscard]] const std::vector<double>& at(std::size_t dataset) const { return values_[dataset]; }

private:
  std::vector<std::vector<double>> values_;
};

double largest_of(std::span<const double> values) {
  double largest = 0.0;
  for (const double value : values) {
    largest = std::isfinite(value) ? std::max(largest, std::abs(value)) : largest;
  }
  return largest;
}

}  // namespace

OutputCheck::OutputCheck(const SharedRecord& record, const StoredLevels& levels, const Problem& problem,
                         std::size_t components, Findings& findings)
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
  find_places();
  record::Layout layout;
  maker_->describe(layout);
  for (const record::Dataset& dataset : layout.datasets) {
    columns_.emplace_back(record_, dataset);
    record_.at_rank_0([&] {
      if (columns_.back().rows() != places_.size()) {
        throw figures::Mismatch(record_.reader()->file(), dataset.path,
                                fmt::format("{} has {} rows; by the problem and the levels it should have {}",
                                            dataset.path, columns_.back().rows(), places_.size()));
      }
    });
  }
}

void OutputCheck::find_places() {
  const std::vector<double>& t = levels_.t;
  if (!problem_.output.has_times()) {
    const auto every = static_cast<std::size_t>(problem_.output.every);
    for (std::size_t level = 0; level < t.size(); ++level) {
      if (level % every == 0 || level + 1 == t.size()) {
        places_.push_back({level, t[level]});
      }
    }
    return;
  }
  const OutputTimes times(problem_);
  for (std::size_t level = 0; level < t.size(); ++level) {
    const double h = level == 0 ? 0.0 : levels_.h[level - 1];
    while (const auto time = times.due(places_.size(), t[level], h)) {
      places_.push_back({level, *time});
    }
  }
}

void OutputCheck::check_times() {
  if (maker_ == nullptr) {
    return;
  }
  record_.at_rank_0([&] {
    StoredRows stored(*record_.reader(), "/output/t");
    if (stored.rows() != places_.size()) {
      throw figures::Mismatch(record_.reader()->file(), stored.path(),
                              fmt::format("{} has {} rows; by the problem and the levels it should have {}",
                                          stored.path(), stored.rows(), places_.size()));
    }
    for (std::size_t row = 0; row < places_.size(); ++row) {
      findings_.same(stored.path(), row, {}, stored.at(row), places_[row].t, "[output] of the problem");
    }
  });
}

/// make(sink, attempt): the row, of states that are displaced unless `attempt` is negative.
template <typename Make>
void OutputCheck::compare(std::size_t row, Make&& make) {
  Row sound(columns_.size());
  make(sound, -1);
  // Of a row in parts what this rank has: ghosts are nobody's.
  const grids::Slab* const slab = record_.slab();
  const auto here = [&](std::size_t i, const Row& made) {
    const std::span<const double> values = made.at(i);
    return columns_[i].are_in_parts() ? values.subspan(slab->first_node(), slab->owned()) : values;
  };
  std::vector<double> allowed;
  const auto tolerance = [&](std::size_t dataset) {
    if (allowed.empty()) {
      allowed.assign(columns_.size(), 0.0);
      for (int attempt = 0; attempt < Rounding::displacements; ++attempt) {
        Row moved(columns_.size());
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

void OutputCheck::check_level(std::size_t level, std::span<const double> z) {
  if (maker_ == nullptr) {
    return;
  }
  scales_.see(z);
  if (problem_.output.has_times() && level > 0) {
    return;
  }
  const auto begin = std::ranges::lower_bound(places_, level, {}, &Place::level);
  for (auto place = begin; place != places_.end() && place->level == level; ++place) {
    compare(static_cast<std::size_t>(place - places_.begin()), [&](RowSink& sink, int attempt) {
      static_cast<void>(attempt < 0 ? maker_->append(sink, z, place->t)
                                    : maker_->append(sink, scales_.displaced(z, attempt, 1), place->t));
    });
  }
}

void OutputCheck::check_step(std::size_t level, std::span<const double> before, std::span<const double> z) {
  if (maker_ == nullptr || !problem_.output.has_times()) {
    return;
  }
  OutputStep step{
      .z_0 = before, .z_1 = z, .t_0 = levels_.t[level - 1], .t_1 = levels_.t[level], .h = levels_.h[level - 1]};
  const auto begin = std::ranges::lower_bound(places_, level, {}, &Place::level);
  for (auto place = begin; place != places_.end() && place->level == level; ++place) {
    compare(static_cast<std::size_t>(place - places_.begin()), [&](RowSink& sink, int attempt) {
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
