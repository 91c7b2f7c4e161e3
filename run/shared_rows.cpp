#include <rubato/run/shared_rows.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <limits>
#include <stdexcept>
#include <utility>

namespace rubato {

void SharedRecord::at_rank_0(const std::function<void()>& read, std::span<double> values) const {
  std::exception_ptr thrown;
  if (reader_ != nullptr) {
    try {
      read();
    } catch (...) {
      thrown = std::current_exception();
    }
  }
  if (slab_ != nullptr) {
    std::vector<double> all(values.begin(), values.end());
    all.push_back(thrown ? 1.0 : 0.0);
    slab_->broadcast(all);
    std::copy_n(all.begin(), values.size(), values.begin());
    if (all.back() != 0.0 && !thrown) {
      throw std::invalid_argument("rank 0 cannot read the record");
    }
  }
  if (thrown) {
    std::rethrow_exception(thrown);
  }
}

bool SharedRecord::has(const std::string& path) const {
  double has = 0.0;
  at_rank_0([&] { has = reader_->has(path) ? 1.0 : 0.0; }, std::span(&has, 1));
  return has != 0.0;
}

StoredLevels shared_levels(const SharedRecord& record, const StoredLevels* levels) {
  StoredLevels shared;
  if (levels != nullptr) {
    shared = *levels;
  }
  const auto share = [&](auto& values) {
    auto count = static_cast<double>(values.size());
    record.slab()->broadcast(std::span(&count, 1));
    std::vector<double> numbers(values.begin(), values.end());
    numbers.resize(static_cast<std::size_t>(count));
    record.slab()->broadcast(numbers);
    values.assign(numbers.begin(), numbers.end());
  };
  share(shared.level);
  share(shared.reported_step);
  share(shared.t);
  share(shared.clock);
  share(shared.h);
  share(shared.off_law);
  share(shared.potential);
  share(shared.state_t);
  share(shared.state_level);
  share(shared.reported_level);
  share(shared.previous_t);
  std::array<double, 5> others = {static_cast<double>(shared.every), static_cast<double>(shared.rows_every),
                                  static_cast<double>(shared.last), shared.sparse ? 1.0 : 0.0,
                                  shared.evolving_alone ? 1.0 : 0.0};
  record.slab()->broadcast(others);
  shared.every = static_cast<std::size_t>(others[0]);
  shared.rows_every = static_cast<std::size_t>(others[1]);
  shared.last = static_cast<std::size_t>(others[2]);
  shared.sparse = others[3] != 0.0;
  shared.evolving_alone = others[4] != 0.0;
  return shared;
}

namespace {

/// Numbers of a row, of this rank's part where they are those of nodes.
std::size_t numbers_of_row(const SharedRecord& record, const record::Dataset& dataset) {
  if (record.slab() != nullptr && has_nodes(dataset)) {
    return record.slab()->size();
  }
  double numbers = 1.0;
  record.at_rank_0(
      [&] {
        for (const std::string& scale : dataset.dimensions) {
          numbers *= static_cast<double>(record.reader()->rows(scale));
        }
      },
      std::span(&numbers, 1));
  return static_cast<std::size_t>(numbers);
}

}  // namespace

bool has_nodes(const record::Dataset& dataset) {
  return std::ranges::any_of(dataset.dimensions, [](const std::string& scale) { return scale.starts_with("/grid/"); });
}

SharedRows::SharedRows(const SharedRecord& record, std::string path, std::size_t row_size)
    : SharedRows(record, std::move(path), row_size, record.slab() != nullptr && row_size == record.slab()->size()) {}

SharedRows::SharedRows(const SharedRecord& record, const record::Dataset& dataset)
    : SharedRows(record, dataset.path, numbers_of_row(record, dataset),
                 record.slab() != nullptr && has_nodes(dataset)) {}

SharedRows::SharedRows(const SharedRecord& record, std::string path, std::size_t row_size, bool in_parts)
    : record_(record), path_(std::move(path)), in_parts_(in_parts) {
  const grids::Slab* const slab = record.slab();
  double rows = 0.0;
  record.at_rank_0(
      [&] {
        stored_.emplace(*record.reader(), path_, in_parts ? slab->whole().size() : row_size);
        rows = static_cast<double>(stored_->rows());
      },
      std::span(&rows, 1));
  rows_ = static_cast<std::size_t>(rows);
  if (in_parts) {
    stored_.reset();
  }
  if (slab != nullptr) {
    row_.resize(row_size);
  }
}

std::span<const double> SharedRows::row(std::size_t row) {
  if (record_.slab() == nullptr) {
    return stored_->row(row);
  }
  if (!in_parts_) {
    record_.at_rank_0([&] { std::ranges::copy(stored_->row(row), row_.begin()); }, row_);
    return row_;
  }
  std::size_t first = 0;
  const grids::Slab& slab = *record_.slab();
  const std::size_t plane = slab.whole().size() / slab.whole().cells(slab.whole().dimensions() - 1);
  std::exception_ptr thrown;  // others wait for what was announced
  slab.scatter(row_, [&](std::span<double> planes) {
    std::ranges::fill(planes, 0.0);
    try {
      if (!thrown) {
        const auto values = record_.reader()->read_part(path_, row, first, planes.size() / plane);
        std::ranges::copy(values, planes.begin());
      }
    } catch (...) {
      thrown = std::current_exception();
    }
    first += planes.size() / plane;
  });
  record_.at_rank_0([&] {
    if (thrown) {
      std::rethrow_exception(thrown);
    }
  });
  return row_;
}

double SharedRows::at(std::size_t row) {
  double value = 0.0;
  record_.at_rank_0([&] { value = stored_->at(row); }, std::span(&value, 1));
  return value;
}

bool PartDisagreements::finite(const std::string& path, std::size_t row, std::span<const double> stored,
                               std::string_view reason) {
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  if (slab_ == nullptr) {
    bool all = true;
    for (std::size_t i = 0; i < stored.size(); ++i) {
      if (!std::isfinite(stored[i])) {
        all = false;
        findings_.add({.dataset = path, .row = row, .index = i, .stored = stored[i], .reason = std::string(reason)});
      }
    }
    return all;
  }
  if (!any([&](std::size_t i) { return !std::isfinite(stored[i]); })) {
    return true;
  }
  write(path, row, reason, [&](std::size_t i) {
    return std::isfinite(stored[i]) ? std::nullopt : std::optional(Numbers{stored[i], none, 0.0});
  });
  return false;
}

bool PartDisagreements::any(const std::function<bool(std::size_t)>& is) const {
  bool here = false;
  for (std::size_t i = slab_->first_node(); i < slab_->first_node() + slab_->owned() && !here; ++i) {
    here = is(i);
  }
  return slab_->largest_over_ranks(here ? 1.0 : 0.0) > 0.0;
}

void PartDisagreements::write(const std::string& path, std::size_t row, std::string_view reason,
                              const std::function<std::optional<Numbers>(std::size_t)>& find) {
  constexpr std::size_t each = 1 + std::tuple_size_v<Numbers>, room = 1 + each * Disagreements::most_listed;
  std::vector<double> reported = {0.0};  // how many there are; of the first of them their places, and numbers
  for (std::size_t i = 0; i < slab_->owned(); ++i) {
    if (const auto found = find(slab_->first_node() + i)) {
      if (reported.size() < room) {
        reported.push_back(static_cast<double>(slab_->number_of_first() + i));
        reported.insert(reported.end(), found->begin(), found->end());
      }
      reported[0] += 1.0;
    }
  }
  reported.resize(room);
  const std::vector<double> all = slab_->collected(reported);
  for (auto rest = std::span(all); !rest.empty(); rest = rest.subspan(room)) {
    const auto count = static_cast<std::size_t>(rest[0]), listed = std::min(count, Disagreements::most_listed);
    for (std::size_t n = 0; n < listed; ++n) {
      const auto found = rest.subspan(1 + each * n, each);
      findings_.add({.dataset = path,
                     .row = row,
                     .index = static_cast<std::size_t>(found[0]),
                     .stored = found[1],
                     .recomputed = found[2],
                     .tolerance = found[3],
                     .reason = std::string(reason)});
    }
    findings_.add_unlisted(path, count - listed);
  }
}

}  // namespace rubato
