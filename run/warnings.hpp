#pragma once

#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/observed_run.hpp>

namespace rubato {

/// The warnings at the end of a run, each one sentence with the remedy. \param statistics of the whole run
[[nodiscard]] std::vector<std::string> warnings_of(const Problem& problem, const ObservedRun& observed,
                                                   const figures::Statistics& statistics);

}  // namespace rubato
