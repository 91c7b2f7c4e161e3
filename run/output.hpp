#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include <rubato/problem/problem.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// A step of a run as its record has it: the states z at both ends (of a lattice all fields, one after the other).
struct OutputStep {
  std::span<const double> z_0, z_1;
  double t_0 = 0.0, t_1 = 0.0;
  double h = 0.0;

  [[nodiscard]] double time(double fraction) const {
    return fraction == 0.0 ? t_0 : fraction == 1.0 ? t_1 : t_0 + fraction * h;
  }
};

/// What a record tells under /output at one time: the state, by dense output of the scheme's own order, and the
/// quantities of the problem. A run and the check of its record make it of the same two levels by the same code.
class OutputMaker {
public:
  virtual ~OutputMaker() = default;

  /// Adds the columns of a row after /output/t.
  virtual void describe(record::Layout& layout) = 0;
  /// Appends one row to each of them: at a time in a step, or at a level. \return whether all could be told; what could
  /// not is not a number
  ///@{
  virtual bool append(RowSink& sink, const OutputStep& step, double t) = 0;
  virtual bool append(RowSink& sink, std::span<const double> z, double t) = 0;
  ///@}
};

/// Nothing where the problem asks for nothing. \throws ProblemError at the place in the problem that is wrong
///@{
[[nodiscard]] std::unique_ptr<OutputMaker> make_output(const Problem& problem);
[[nodiscard]] std::unique_ptr<OutputMaker> make_orbit_output(const Problem& problem);
[[nodiscard]] std::unique_ptr<OutputMaker> make_lattice_output(const Problem& problem);
///@}

/// Where t is in a step, as a share of it; 0 and 1 are the levels themselves.
[[nodiscard]] double fraction_of(const OutputStep& step, double t);

}  // namespace rubato
