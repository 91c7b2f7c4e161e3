#include <rubato/run/event_check.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace rubato {

/// The rows of one step, dataset by dataset.
class EventCheck::Rows final : public RowSink {
public:
  using RowSink::append;
  explicit Rows(std::size_t datasets) : rows_(datasets) {}

  void append(record::Column column, std::span<const double> row) override {
    rows_.at(column.number).emplace_back(row.begin(), row.end());
  }
  void append(record::Column column, std::span<const std::int64_t> row) override {
    rows_.at(column.number).emplace_back(row.begin(), row.end());
  }
  [[nodiscard]] const std::vector<std::vector<double>>& of(std::size_t dataset) const { return rows_[dataset]; }

private:
  std::vector<std::vector<std::vector<double>>> rows_;
};

EventCheck::EventCheck(const SharedRecord& record, const StoredLevels& levels, const Problem& problem,
                       std::size_t components, Disagreements& findings)
    : levels_(levels),
      findings_(findings),
      clock_(problem.clock()),
      writer_(levels.complete() ? make_events(problem) : nullptr),
      scales_(record.slab(), components) {
  if (writer_ == nullptr) {
    return;
  }
  writer_->describe(layout_);
  for (const std::string& name : writer_->names()) {
    figures_.push_back({name, {}});
  }
  for (const record::Dataset& dataset : layout_.datasets) {
    columns_.emplace_back(record, dataset);
  }
  next_.assign(columns_.size(), 0);
}

void EventCheck::begin(std::span<const double> z) {
  if (writer_ == nullptr) {
    return;
  }
  scales_.see(z);
  Rows sound(columns_.size());
  writer_->begin(sound, z, levels_.t.front(), figures_);
  const std::vector<Rows> none;
  compare(
      sound, [&]() -> const std::vector<Rows>& { return none; }, "from the start");
}

void EventCheck::check_step(std::size_t state_row, std::span<const double> before, std::span<const double> z) {
  if (writer_ == nullptr) {
    return;
  }
  scales_.see(z);
  OutputStep step{.z_0 = before,
                  .z_1 = z,
                  .t_0 = levels_.t[state_row - 1],
                  .t_1 = levels_.t[state_row],
                  .h = levels_.h[state_row - 1],
                  .clock = clock_};
  StateWriter signs_before, signs_after;
  writer_->save(signs_before);
  Rows sound(columns_.size());
  std::vector<EventFigures> after = figures_;
  writer_->append(sound, step, after);
  writer_->save(signs_after);
  // The rows of displaced states: at the same fractions, since a crossing that is located anew hides the rounding of
  // what is zero there; and located anew.
  std::vector<Rows> moved;
  const auto make_moved = [&]() -> const std::vector<Rows>& {
    if (!moved.empty()) {
      return moved;
    }
    for (const bool anew : {false, true}) {
      for (int attempt = 0; attempt < Rounding::displacements; ++attempt) {
        const std::vector<double> z_0 = scales_.displaced(before, attempt, 0), z_1 = scales_.displaced(z, attempt, 1);
        OutputStep other = step;
        other.z_0 = z_0;
        other.z_1 = z_1;
        std::vector<EventFigures> ignored = figures_;
        if (anew) {
          restore(signs_before);
          writer_->append(moved.emplace_back(columns_.size()), other, ignored);
        } else {
          writer_->append_again(moved.emplace_back(columns_.size()), other, ignored);
        }
      }
    }
    restore(signs_after);
    return moved;
  };
  compare(sound, make_moved, "from the levels around it");
  figures_ = std::move(after);
}

void EventCheck::restore(const StateWriter& signs) {
  StateReader reader{std::span<const double>(signs.values())};
  writer_->restore(reader);
}

void EventCheck::compare(const Rows& sound, const std::function<const std::vector<Rows>&()>& moved,
                         const char* reason) {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    const auto& rows = sound.of(i);
    for (std::size_t r = 0; r < rows.size(); ++r, ++next_[i]) {
      if (next_[i] >= columns_[i].rows()) {
        findings_.add({.dataset = columns_[i].path(),
                       .row = next_[i],
                       .recomputed = rows[r].front(),
                       .reason = "the levels have this, and the record has not"});
        continue;
      }
      const std::span<const double> stored = columns_[i].row(next_[i]);
      for (std::size_t k = 0; k < stored.size(); ++k) {
        const auto tolerance = [&] {
          double change = 0.0;
          for (const Rows& other : moved()) {
            // Where rounding decides on whether there is a crossing, it decides on all of it.
            change = other.of(i).size() != rows.size()
                         ? std::numeric_limits<double>::infinity()
                         : std::max(change, std::abs(other.of(i)[r][k] - rows[r][k]) / Rounding::displacement);
          }
          return Rounding::unit * (change + std::abs(rows[r][k]));
        };
        findings_.compare(columns_[i].path(), next_[i], stored.size() == 1 ? std::nullopt : std::optional(k), stored[k],
                          rows[r][k], tolerance, reason);
      }
    }
  }
}

void EventCheck::finish() {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (next_[i] < columns_[i].rows()) {
      findings_.add(
          {.dataset = columns_[i].path(),
           .row = next_[i],
           .stored = columns_[i].row(next_[i]).front(),
           .reason = fmt::format("the record has {} rows; by the levels there are {}", columns_[i].rows(), next_[i])});
    }
  }
}

}  // namespace rubato
