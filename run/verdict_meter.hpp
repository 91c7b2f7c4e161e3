#pragma once

#include <cstddef>

#include <rubato/base/state.hpp>
#include <rubato/figures/verdict.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/energy_exchange.hpp>
#include <rubato/run/pole_watch.hpp>
#include <rubato/run/simulation.hpp>

namespace rubato {

/// Measures::accepted of a problem.
[[nodiscard]] double accepted_reasons(const Problem& problem);

/// Takes the measures of the verdict along a run. It looks at a sample of the levels, so that its cost is small beside
/// that of the steps: each of the first ones, fewer of a large system, then levels at distances in proportion to their
/// number, and on a lattice all that are stored, if these are few. Poles of H are looked for in every step. A lattice
/// that ranks share is not measured: its verdict rests on the energy law alone.
class VerdictMeter {
public:
  explicit VerdictMeter(const Problem& problem);

  /// The level that the simulation looks at, in order from number 0.
  /// \param rounding a bound of the rounding error of E_k of the step to it; 0 at the start
  void add_level(Simulation& simulation, std::size_t number, double node_energy, double rounding);
  /// Of the levels so far.
  [[nodiscard]] figures::Measures measures() const;
  /// The same and the present level, if that is not in the sample.
  [[nodiscard]] figures::Measures measures_to(Simulation& simulation, std::size_t number) const;

  /// Measures::halved of a solution that the run begins from.
  void set_halved(double relative, double t);
  /// The run failed at t, and was to end at `until`: it is not good, until it is continued (restore()).
  void end_early(double t, double until);

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  [[nodiscard]] bool samples(std::size_t number) const;
  void take(Simulation& simulation, std::size_t number, double node_energy, double rounding);

  std::size_t dense_;   ///< the first so many levels are all in the sample
  std::size_t stored_;  ///< and every n-th
  EnergyExchange energy_;
  PoleWatch poles_;
  figures::Measures measures_;
};

}  // namespace rubato
