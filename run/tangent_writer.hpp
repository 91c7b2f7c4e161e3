#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/ode/sensitivities.hpp>
#include <rubato/ode/tangent_vectors.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/output.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// What a record shows under /tangents: of every step ln r_ii of the tangent vectors and the defect of the two-form, at
/// every stored level the state-transition matrix and the derivatives by parameters. A run and the check of its record
/// make it of the same levels by the same code.
class TangentWriter {
public:
  /// \throws ProblemError at [scheme] tangents, if the scheme has no tangent of what is asked for
  explicit TangentWriter(const Problem& problem);

  /// What the tangent vectors are called.
  [[nodiscard]] std::vector<std::string> names() const;

  /// Adds the columns of all rows.
  void describe(record::Layout& layout);
  /// Takes the step, which follows the one taken last. What cannot be taken is not a number from then on.
  void take(const OutputStep& step);
  /// Of the step taken last.
  ///@{
  [[nodiscard]] std::span<const double> logarithms() const;
  [[nodiscard]] double defect() const;
  void append_step(RowSink& sink) const;
  void add_to(figures::Statistics& statistics, const OutputStep& step) const;
  ///@}
  /// At the level that it led to, or at the start.
  void append_state(RowSink& sink) const;

  /// How large numbers are in what is appended for a state, and for a step, and how many steps were taken: for those
  /// who compare.
  [[nodiscard]] std::size_t steps() const { return steps_; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  const Problem& problem_;
  std::optional<TangentVectors> vectors_;
  std::optional<Sensitivities> sensitivities_;
  std::vector<record::Column> growth_;
  record::Column defect_, matrix_, derivatives_;
  std::size_t steps_ = 0;
};

/// Nothing where the problem asks for none.
[[nodiscard]] std::unique_ptr<TangentWriter> make_tangents(const Problem& problem);

}  // namespace rubato
