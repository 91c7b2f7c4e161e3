#include "states.hpp"

#include <algorithm>

#include <rubato/run/orbit_levels.hpp>

namespace rubato::python {

Reading::Reading(const Problem& problem)
    : velocities_(make_velocities(problem)),
      is_extended_(problem.hamiltonian()->driven || problem.hamiltonian()->fictitious_time) {}

std::vector<double> Reading::operator()(std::span<const double> z) {
  const std::size_t pairs = z.size() / 2, stated = is_extended_ ? pairs - 1 : pairs;
  std::vector<double> y(z.begin(), z.begin() + static_cast<std::ptrdiff_t>(stated));
  std::span<const double> second = z.last(pairs);
  if (velocities_ != nullptr) {
    velocities_->restart(z);
    second = velocities_->velocities();
  }
  std::ranges::copy(second.first(stated), std::back_inserter(y));
  return y;
}

namespace {

Problem with_times(Problem problem) {
  problem.output.times = {problem.start()};
  problem.output.interval.reset();
  problem.output.quantities.clear();
  return problem;
}

}  // namespace

Between::Between(const Problem& problem) : problem_(with_times(problem)), output_(make_output(problem_)) {
  record::Layout layout;
  output_->describe(layout);
}

std::span<const double> Between::at(const OutputStep& step, double t) {
  row_.z.clear();
  static_cast<void>(output_->append(row_, step, t));
  return row_.z;
}

void Between::Row::append(record::Column /*column*/, std::span<const double> row) {
  z.insert(z.end(), row.begin(), row.end());
}

}  // namespace rubato::python
