#pragma once

#include <vector>

#include <rubato/record/layout.hpp>
#include <rubato/run/run.hpp>
#include <rubato/solve/damped_newton.hpp>

namespace rubato {

/// What the record of a solution has of the iterations of Newton's method.
[[nodiscard]] std::vector<record::Scale> history_scales(const std::vector<solve::NewtonIteration>& history);

/// Measures::halved, and the time there.
struct HalvedMeasure {
  double relative = figures::Measures::none, t = figures::Measures::none;
};

/// run(), whose record has further datasets of fixed extent, and whose verdict a measure of its initial data.
[[nodiscard]] Outcome run_with_scales(const Problem& problem, const RunOptions& options,
                                      std::vector<record::Scale> scales, const HalvedMeasure& halved = {});

}  // namespace rubato
