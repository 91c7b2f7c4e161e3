#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/run/law.hpp>
#include <rubato/run/shared_rows.hpp>

namespace rubato {

/// The stored levels of a lattice, one at a time.
class StoredLattice {
public:
  StoredLattice(const SharedRecord& record, const MultisymplecticSystem& system, const NodeTable& exact,
                const WholeFields& whole_fields, std::size_t nodes, const StoredLevels& levels,
                Disagreements& findings);

  /// Of fields at midpoints the value in the middle of the step that led there; 0 at the start, where there is none.
  /// Fields that are not stored stay as they are. \return false, and the findings say so, where it is not finite
  bool load(std::size_t row, grids::FieldSet& level);
  /// The level before it.
  bool load_previous(std::size_t row, grids::FieldSet& level);
  [[nodiscard]] bool is_stored(int field) const { return fields_[static_cast<std::size_t>(field)].has_value(); }
  [[nodiscard]] const std::string& path(int field) const { return fields_[static_cast<std::size_t>(field)]->path(); }
  /// Of the level before, for fields that are at levels.
  [[nodiscard]] std::string previous_path(int field) const {
    return "/states/previous/" + system_.fields()[static_cast<std::size_t>(field)];
  }

private:
  bool copy(SharedRows& rows, std::size_t row, std::span<double> out);

  const MultisymplecticSystem& system_;
  const WholeFields& whole_;  ///< which the record has; levels have the periodic ones
  PartDisagreements findings_;
  std::vector<std::optional<SharedRows>> fields_;
  std::vector<SharedRows> previous_;
};

/// A local law, and where its numbers are stored.
struct StoredLaw {
  const Law& law;
  SharedRows max, rms;
  std::optional<SharedRows> undefined;  ///< not in records of earlier versions
  std::optional<SharedRows> cells;

  StoredLaw(const SharedRecord& record, const Law& of)
      : law(of), max(record, law.max_path()), rms(record, law.rms_path()) {
    if (record.has(law.undefined_path())) {
      undefined.emplace(record, law.undefined_path());
    }
    if (law.has_cells()) {
      cells.emplace(record, law.cells_path(), law.cells().size());
    }
  }
};

}  // namespace rubato
