#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <rubato/ode/segment_scheme.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/output.hpp>

/// The states of an orbit as Python reads them.
namespace rubato::python {

/// From the state z of a run to what its user stated: coordinates, then momenta, or velocities if L states the problem.
/// The pair of the time that a driven system and one with time_scale carry in addition is left out.
class Reading {
public:
  explicit Reading(const Problem& problem);

  [[nodiscard]] std::vector<double> operator()(std::span<const double> z);

private:
  std::unique_ptr<OneStepScheme> velocities_;
  bool is_extended_;
};

/// z at times within steps, as a run gives them at its output times.
class Between {
public:
  explicit Between(const Problem& problem);

  /// Not a number where it is not known. Valid until the next call.
  [[nodiscard]] std::span<const double> at(const OutputStep& step, double t);

private:
  class Row final : public RowSink {
  public:
    using RowSink::append;
    void append(record::Column column, std::span<const double> row) override;
    void append(record::Column /*column*/, std::span<const std::int64_t> /*row*/) override {}
    std::vector<double> z = {};
  };

  Problem problem_;
  std::unique_ptr<OutputMaker> output_;
  Row row_;
};

}  // namespace rubato::python
