#include <rubato/run/output.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/base/limits.hpp>

namespace rubato {

std::unique_ptr<OutputMaker> make_output(const Problem& problem) {
  if (!problem.output.any()) {
    return nullptr;
  }
  return problem.hamiltonian() != nullptr ? make_orbit_output(problem) : make_lattice_output(problem);
}

double fraction_of(const OutputStep& step, double t) {
  // Times of levels and times asked for are both rounded: those that differ by that alone are the same.
  const double rounding = 4.0 * epsilon * std::max(std::abs(step.begin()), std::abs(step.end()));
  if (std::abs(t - step.end()) <= rounding) {
    return 1.0;
  }
  return std::abs(t - step.begin()) <= rounding ? 0.0 : (t - step.begin()) / step.length();
}

}  // namespace rubato
