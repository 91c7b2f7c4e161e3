#pragma once

#include <string>
#include <vector>

#include <rubato/figures/stored.hpp>
#include <rubato/record/reader.hpp>

namespace rubato::report {

/// What a record holds, found by what is in it.
struct Contents {
  enum class Kind { orbit, lattice };

  Kind kind = Kind::orbit;
  std::vector<std::string> coordinates, momenta;  ///< of an orbit
  std::vector<std::string> velocities;            ///< of one that is stated by L
  /// Fields of a lattice with the datasets that hold them, in the order of the record; `midpoints` are known in the
  /// middle of steps only.
  struct Field {
    std::string name, path;
    bool at_midpoints = false;
  };
  std::vector<Field> fields;
  std::string field_group = "field", field_times = "/states/t";  ///< what these are, and the times of their rows
  std::vector<Field> node_quantities;        ///< those of /output/quantities with a value at every node
  std::vector<std::string> axes;             ///< of a lattice's grid, slowest first: "z", "y", "x"
  std::vector<std::string> exact;            ///< names under /exact
  std::vector<std::string> invariants;       ///< names under /laws, one number per level
  std::vector<std::string> totals;           ///< names under /laws/totals
  std::vector<std::string> residuals;        ///< names of /laws/NAME_max and _rms
  std::vector<std::string> residual_fields;  ///< names under /laws/fields
  std::vector<std::string> events;           ///< names under /events
  std::vector<std::string> sections;         ///< those of them with two quantities or more
  std::vector<std::string> quantities;       ///< names under /output/quantities, one number per output time
};

[[nodiscard]] Contents contents_of(const record::Reader& reader);

/// The same record with the node quantities in place of fields, and without errors and residuals.
[[nodiscard]] Contents with_quantities_as_fields(Contents contents);

/// The figures that the run reported, from its record. \throws record::Error
[[nodiscard]] figures::Statistics summarise(const record::Reader& reader, const Contents& contents);

}  // namespace rubato::report
