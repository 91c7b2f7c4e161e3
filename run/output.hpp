#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>

#include <rubato/base/state.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// A step of a run as its record has it: the states z at both ends (of a lattice all fields, one after the other).
struct OutputStep {
  std::span<const double> z_0, z_1;
  double t_0 = 0.0, t_1 = 0.0;
  double h = 0.0;
  std::optional<std::size_t> clock = {};  ///< Problem::clock()

  /// The times of both ends that users read, and of the step: physical ones.
  ///@{
  [[nodiscard]] double begin() const { return clock ? z_0[*clock] : t_0; }
  [[nodiscard]] double end() const { return clock ? z_1[*clock] : t_1; }
  [[nodiscard]] double length() const { return clock ? end() - begin() : h; }
  ///@}

  [[nodiscard]] double time(double fraction) const {
    return fraction == 0.0 ? t_0 : fraction == 1.0 ? t_1 : t_0 + fraction * h;
  }
};

/// What a record shows under /output at one time: the state, by dense output of the scheme's own order, and the
/// quantities of the problem. A run and the check of its record make it of the same two levels by the same code.
class OutputMaker {
public:
  virtual ~OutputMaker() = default;

  /// Adds the columns of a row after /output/t.
  virtual void describe(record::Layout& layout) = 0;
  /// Appends one row to each of them: at a time in a step, or at a level. \return whether all could be reported; what
  /// could not is not a number
  ///@{
  virtual bool append(RowSink& sink, const OutputStep& step, double t) = 0;
  virtual bool append(RowSink& sink, std::span<const double> z, double t) = 0;
  ///@}
  /// What earlier rows left to begin from: after restore() the next row is the same to the bit.
  ///@{
  virtual void save(StateWriter& /*state*/) const {}
  virtual void restore(StateReader& /*state*/) {}
  ///@}
};

/// Nothing where the problem asks for nothing. \throws ProblemError at the place in the problem that is wrong
///@{
[[nodiscard]] std::unique_ptr<OutputMaker> make_output(const Problem& problem);
[[nodiscard]] std::unique_ptr<OutputMaker> make_orbit_output(const Problem& problem);
[[nodiscard]] std::unique_ptr<OutputMaker> make_lattice_output(const Problem& problem);
///@}

/// Where the time t of users is in a step, as a share of its length(); 0 and 1 are the levels themselves.
[[nodiscard]] double fraction_of(const OutputStep& step, double t);

}  // namespace rubato
