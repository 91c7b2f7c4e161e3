#include <rubato/run/stored_lattice.hpp>

#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include <rubato/grids/whole.hpp>

namespace rubato {

StoredLattice::StoredLattice(const SharedRecord& record, const MultisymplecticSystem& system, const NodeTable& exact,
                             const WholeFields& whole_fields, std::size_t nodes, const StoredLevels& levels,
                             Disagreements& findings)
    : system_(system),
      whole_(whole_fields),
      findings_(record.slab(), findings),
      fields_(static_cast<std::size_t>(system.field_count())) {
  const auto open = [&](const std::string& path) {
    SharedRows rows(record, path, nodes);
    record.at_rank_0([&] {
      if (rows.rows() != levels.state_level.size()) {
        throw record::Error(record.reader()->file(),
                            fmt::format("{} has {} rows; {} stored levels do not fit together with that", path,
                                        rows.rows(), levels.state_level.size()));
      }
    });
    return rows;
  };
  for (int f = 0; f < system.field_count(); ++f) {
    const std::string& name = system.fields()[static_cast<std::size_t>(f)];
    const bool at_midpoints = system.structure().at_midpoints(f);
    if (!levels.evolving_alone || is_stored_alone(system, f, exact.names())) {
      fields_[static_cast<std::size_t>(f)] = open((at_midpoints ? "/states/midpoints/" : "/states/") + name);
    }
    if (levels.sparse && !levels.evolving_alone && !at_midpoints) {
      previous_.push_back(open("/states/previous/" + name));
    }
  }
}

bool StoredLattice::load(std::size_t row, grids::FieldSet& level) {
  bool whole = true;
  for (int f = 0; f < system_.field_count(); ++f) {
    if (!is_stored(f)) {
      continue;
    }
    SharedRows& rows = *fields_[static_cast<std::size_t>(f)];
    if (row == 0 && system_.structure().at_midpoints(f)) {
      std::ranges::fill(level.field(f), 0.0);
      findings_.compare(
          rows.path(), row, rows.row(row), [](std::size_t) { return std::numeric_limits<double>::quiet_NaN(); },
          [] { return 0.0; }, "no step led to the start");
    } else {
      whole = copy(rows, row, level.field(f)) && whole;
    }
  }
  whole_.remove(level.all(), [this](int f) { return is_stored(f); });
  grids::refresh_ghosts(level);
  return whole;
}

bool StoredLattice::load_previous(std::size_t row, grids::FieldSet& level) {
  bool whole = true;
  auto rows = previous_.begin();
  for (int f = 0; f < system_.field_count(); ++f) {
    if (system_.structure().at_midpoints(f)) {
      std::ranges::fill(level.field(f), 0.0);
    } else {
      whole = copy(*rows++, row, level.field(f)) && whole;
    }
  }
  whole_.remove(level.all());
  grids::refresh_ghosts(level);
  return whole;
}

bool StoredLattice::copy(SharedRows& rows, std::size_t row, std::span<double> out) {
  const std::span<const double> values = rows.row(row);
  std::ranges::copy(values, out.begin());
  const bool is_finite = findings_.finite(rows.path(), row, values, "a state is finite");
  rows.forget_long_row();
  return is_finite;
}

}  // namespace rubato
