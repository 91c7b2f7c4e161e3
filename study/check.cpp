#include <rubato/study/check.hpp>

#include <fmt/format.h>

#include <rubato/study/lattice_check.hpp>
#include <rubato/study/orbit_check.hpp>

namespace rubato::study {

Outcome check(const std::string& file) {
  const record::Reader reader(file);
  const Problem problem = stored_problem(reader);
  const StoredLevels levels(reader);
  Outcome outcome;
  outcome.title = problem.title;
  outcome.file = file;
  outcome.variable_levels = problem.scheme.levels == Levels::variable;
  outcome.complete = reader.header().finished;
  outcome.statistics = (problem.hamiltonian() != nullptr ? check_orbit : check_lattice)(reader, levels, problem);
  outcome.warnings = outcome.statistics.undefined_quantities();
  if (levels.sparse) {
    outcome.warnings.push_back(
        fmt::format("the record keeps every {}-th state and its predecessor: laws were checked on those steps only",
                    problem.output.every));
  }
  if (const double mismatch = levels.mismatch(); mismatch > 0.0) {
    outcome.warnings.push_back(
        fmt::format("the times in the record do not fit its steps: they differ by up to {:.3g}; it is damaged, or was "
                    "altered",
                    mismatch));
  }
  return outcome;
}

}  // namespace rubato::study
