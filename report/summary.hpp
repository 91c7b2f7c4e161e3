#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/report/contents.hpp>

namespace rubato::report {

/// What a record says of how well each law held: the figures of the table that a run ends with, computed anew from the
/// numbers per level and per step. Deviations are from the first value; `max` and `rms` are over all steps and cells.
struct Summary {
  struct Range {
    double min = 0.0, max = 0.0;
  };
  struct MaxRms {
    std::string name;
    double max = 0.0, rms = 0.0;
  };
  struct Deviation {
    std::string name;
    double initial = 0.0, max = 0.0;
  };

  std::size_t steps = 0;
  double t_first = 0.0, t_last = 0.0;
  bool finished = false;
  double energy_scale = 0.0;  ///< max(|E_0|, max |H(z_k)|)
  Deviation discrete_energy;  ///< of E_k on the steps that are no bridges
  Deviation node_energy;      ///< of H(z_k)
  Range gamma;
  /// Absent in a record without steps.
  std::optional<Range> h;
  std::size_t bridge_steps = 0;
  double bridge_deviation = 0.0;  ///< of E_k on bridging steps
  double step_condition = 0.0;
  double mean_iterations = 0.0, most_iterations = 0.0;
  std::vector<Deviation> invariants, totals;
  std::vector<MaxRms> residuals;
  std::vector<MaxRms> errors;  ///< at the last stored level, against /exact

  /// A deviation of energy over `energy_scale`.
  [[nodiscard]] double relative(double deviation) const { return deviation == 0.0 ? 0.0 : deviation / energy_scale; }
};

/// \throws record::Error
[[nodiscard]] Summary summarise(const record::Reader& reader, const Contents& contents);

/// A line of the table: what, its value, and a remark or nothing. Headlines are what to look at first.
struct Line {
  std::string label, value, remark;
  bool is_headline = false;
};
[[nodiscard]] std::vector<Line> lines_of(const Summary& summary);

}  // namespace rubato::report
