#include <rubato/run/solution_measures.hpp>

#include <numeric>

#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/solve.hpp>
#include <rubato/run/solution_rows.hpp>
#include <rubato/run/verdict_meter.hpp>

namespace rubato {

namespace {

NodesOfOrbit first_half_of(const NodesOfOrbit& orbit) {
  NodesOfOrbit half = orbit;
  half.h.resize(orbit.segments() / 2);
  half.z.resize((half.segments() + 1) * orbit.dimension);
  return half;
}

/// Of closed orbits with neither period nor energy given, and of such connections, one direction is meant to be open.
std::size_t beyond_wish(const StatedSolve& stated, const OpenDirections& open) {
  const bool one_is_meant = stated.ends != StatedSolve::Ends::conditions && !stated.duration && !stated.has_energy();
  return open.count > 0 && one_is_meant ? open.count - 1 : open.count;
}

}  // namespace

SolutionMeasures measure_solution(const Problem& problem, const NodesOfOrbit& orbit, bool rests) {
  using Ends = StatedSolve::Ends;
  const StatedSolve& stated = *problem.solve;
  SolutionMeasures result;
  figures::Measures& measures = result.measures;
  measures.accepted = accepted_reasons(problem);
  measures.rest = rests ? 1.0 : 0.0;
  if (rests) {
    return result;
  }
  const Hamiltonian hamiltonian = make_hamiltonian(problem);
  const EndConditions ends = make_end_conditions(problem, hamiltonian);
  BoundaryValueOptions options = make_boundary_value_options(problem);
  const bool half = stated.ends == Ends::symmetric;
  if (half && options.duration) {
    options.duration = 0.5 * *options.duration;
  }
  const NodesOfOrbit& solved = half ? first_half_of(orbit) : orbit;
  result.error = step_error(hamiltonian, ends, solved, options);
  StepError& error = *result.error;
  if (half) {
    error.duration *= 2.0;
  }
  measures.halved = error.relative;
  measures.halved_t =
      problem.start() +
      std::accumulate(solved.h.begin(), solved.h.begin() + static_cast<std::ptrdiff_t>(error.level), 0.0);
  if (error.halved.found()) {
    result.open = open_directions(hamiltonian, ends, solved, error.halved.orbit, options,
                                  stated.ends == Ends::conditions ? OpenAlong::any : OpenAlong::duration_or_energy);
    measures.open = static_cast<double>(beyond_wish(stated, result.open));
    measures.open_duration = result.open.duration ? 1.0 : 0.0;
    measures.open_energy = result.open.energy ? 1.0 : 0.0;
  }
  return result;
}

}  // namespace rubato
