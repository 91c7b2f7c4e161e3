#include <rubato/run/gathering_sink.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <string>
#include <utility>

#include <rubato/record/error.hpp>
#include <rubato/record/together.hpp>
#include <rubato/run/lattice_ranks.hpp>
#include <rubato/run/shared_rows.hpp>

namespace rubato {

namespace {

/// What a rank says of its part of a row, as numbers.
struct PartSaid {
  static constexpr std::size_t size = 4;
  double undefined_place = -1.0;  ///< in the row, of the first number that is not finite
  double undefined_value = 0.0;
  std::uint64_t checksum = 0;

  [[nodiscard]] std::array<double, size> numbers() const {
    return {undefined_place, undefined_value, static_cast<double>(checksum >> 32),
            static_cast<double>(checksum & 0xFFFFFFFF)};
  }
  static PartSaid of(std::span<const double, size> numbers) {
    return {numbers[0], numbers[1],
            (static_cast<std::uint64_t>(numbers[2]) << 32) | static_cast<std::uint64_t>(numbers[3])};
  }
};

}  // namespace

template <typename Append>
void GatheringSink::to_sink(const Append& append) {
  if (sink_ != nullptr && !thrown_) {
    try {
      append(*sink_);
    } catch (...) {
      thrown_ = std::current_exception();
    }
  }
}

void GatheringSink::append(record::Column column, std::span<const double> row) {
  const record::Dataset& dataset = layout_.datasets[column.number];
  if (!has_nodes(dataset)) {
    to_sink([&](RowSink& sink) { sink.append(column, row); });
  } else if (record::is_long(layout_, dataset)) {
    waiting_.push_back({column, {row.begin(), row.end()}});
  } else {
    gather(column, row);
  }
}

void GatheringSink::append(record::Column column, std::span<const std::int64_t> row) {
  to_sink([&](RowSink& sink) { sink.append(column, row); });
}

void GatheringSink::gather(record::Column column, std::span<const double> part) {
  std::size_t left = slab_.whole().size();
  slab_.gather(part, [&](std::span<const double> planes) {
    left -= planes.size();
    to_sink([&](RowSink& sink) { sink.append_part(column, planes, left == 0); });
  });
}

void GatheringSink::finish() {
  if (waiting_.empty()) {
    return;
  }
  const InParts agreed = wish();
  if (agreed.wanted == InParts::Wanted::numbers) {
    for (const Row& row : waiting_) {
      gather(row.column, row.part);
    }
  } else {
    const std::vector<Checksum> checksums = judged(agreed);
    double goes_on = thrown_ ? 0.0 : 1.0;
    slab_.broadcast(std::span(&goes_on, 1));
    if (goes_on != 0.0 && agreed.wanted == InParts::Wanted::written) {
      write(agreed);
    }
    for (std::size_t i = 0; i < checksums.size(); ++i) {
      to_sink([&](RowSink& sink) { sink.append_checksum(waiting_[i].column, checksums[i]); });
    }
  }
  waiting_.clear();
}

RowSink::InParts GatheringSink::wish() {
  using Wanted = InParts::Wanted;
  InParts wish{.wanted = Wanted::checksum, .file = {}, .rows = {}};
  to_sink([&](RowSink& sink) {
    std::vector<record::Column> columns;
    for (const Row& row : waiting_) {
      columns.push_back(row.column);
    }
    wish = sink.in_parts(columns);
  });
  const std::string file = wish.file.string();
  std::array<double, 2> head = {static_cast<double>(static_cast<int>(wish.wanted)), static_cast<double>(file.size())};
  slab_.broadcast(head);
  wish.wanted = static_cast<Wanted>(static_cast<int>(head[0]));
  if (wish.wanted == Wanted::written) {
    std::vector<double> others(file.begin(), file.end());
    others.insert(others.end(), wish.rows.begin(), wish.rows.end());
    const auto characters = static_cast<std::size_t>(head[1]);
    others.resize(characters + waiting_.size());
    slab_.broadcast(others);
    const auto rows = others.begin() + static_cast<std::ptrdiff_t>(characters);
    std::string name;
    std::transform(others.begin(), rows, std::back_inserter(name), [](double c) { return static_cast<char>(c); });
    wish.file = name;
    wish.rows.assign(rows, others.end());
    if (slab_.largest_over_ranks(record::can_write_together(slab_.communicator(), wish.file) ? 0.0 : 1.0) > 0.0) {
      wish.wanted = Wanted::numbers;
    }
  }
  return wish;
}

std::vector<Checksum> GatheringSink::judged(const InParts& wish) {
  std::vector<double> said;
  for (const Row& row : waiting_) {
    const std::span<const double> values = owned(row);
    PartSaid part;
    const auto undefined = std::ranges::find_if_not(values, [](double value) { return std::isfinite(value); });
    if (undefined != values.end()) {
      part.undefined_place =
          static_cast<double>(slab_.number_of_first()) + static_cast<double>(undefined - values.begin());
      part.undefined_value = *undefined;
    }
    Checksum checksum;
    checksum.add(std::as_bytes(values));
    part.checksum = checksum.value();
    const auto numbers = part.numbers();
    said.insert(said.end(), numbers.begin(), numbers.end());
  }
  const std::vector<double> all = slab_.collected(said);
  std::vector<Checksum> checksums;
  const grids::Grid& whole = slab_.whole();
  const std::size_t plane_bytes = whole.size() / whole.cells(whole.dimensions() - 1) * sizeof(double);
  for (std::size_t i = 0; i < waiting_.size() && !all.empty(); ++i) {
    const record::Dataset& dataset = layout_.datasets[waiting_[i].column.number];
    Checksum row;
    for (int rank = 0; rank < slab_.ranks(); ++rank) {
      const std::size_t place = static_cast<std::size_t>(rank) * said.size() + i * PartSaid::size;
      const auto part = PartSaid::of(std::span(all).subspan(place).first<PartSaid::size>());
      row.append(Checksum(part.checksum, slab_.planes(rank) * plane_bytes));
      if (!wish.rows.empty() && !thrown_ && !dataset.may_be_undefined && part.undefined_place >= 0.0) {
        thrown_ = std::make_exception_ptr(record::NotFinite(
            dataset, wish.rows[i], static_cast<std::size_t>(part.undefined_place), part.undefined_value));
      }
    }
    checksums.push_back(row);
  }
  return checksums;
}

void GatheringSink::write(const InParts& wish) const {
  std::vector<record::RowPart> parts;
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    parts.push_back({.dataset = layout_.datasets[waiting_[i].column.number].path,
                     .row = wish.rows[i],
                     .first = slab_.first_plane(slab_.rank()),
                     .values = owned(waiting_[i])});
  }
  try {
    record::write_together(slab_.communicator(), wish.file, parts);
  } catch (const record::Error& error) {
    // Others may wait inside of the library, as this process would at its end: the launcher has to end them.
    end_job(slab_.communicator(), error, ExitStatus::file_error);
  }
}

void GatheringSink::rethrow() {
  if (thrown_) {
    std::rethrow_exception(std::exchange(thrown_, nullptr));
  }
}

}  // namespace rubato
