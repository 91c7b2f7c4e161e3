#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

/// \file
/// Work against accuracy: for each error asked for, the cheapest run of each kind of method that reaches it, measured
/// again in turns with those of all other kinds.

namespace comparison {

/// What is an error: of a field; of the energy at nodes, and of the last position.
inline constexpr std::size_t most_measures = 2;

struct Outcome {
  std::array<double, most_measures> errors = {};
  double seconds = 0.0;  ///< CPU time of the steps
  double before = 0.0;   ///< of these, what was spent before the first step (the look-ahead of variable levels)
  long steps = 0;        ///< that were taken, where `effort` is not their number
};

/// What rows of the table are of. The first three are peers.
enum class Class { peer, odeint, sundials, ours, with_laws, with_levels };
[[nodiscard]] inline bool is_peer(Class kind) {
  return kind <= Class::sundials;
}

/// A method on one grid: a run with so much effort, which is the number of steps, or of what a tolerance is made.
struct Method {
  std::string name;
  Class kind = Class::peer;
  std::size_t nodes = 0;  ///< 0 for orbits
  int first = 1;          ///< effort to begin with
  /// With what a run costs comes what it errs by, unless it is only to be timed.
  std::function<Outcome(int effort, bool timed_only)> run;
};

struct Study {
  std::string title;
  std::vector<std::string> measures;  ///< at most most_measures
  std::vector<double> targets;        ///< falling
  std::string by_hand = "by hand";    ///< how the rows of Class::peer are called
  double longest_search = 2.0;        ///< seconds that a method on one grid may search for
  double longest_run = 1.0;           ///< and of one run
  double growth_of_levels = 1.41421;  ///< of the effort from run to run of a search with variable levels
  double shortest_measurement = 0.0;  ///< seconds; a shorter run is repeated in its turn, and the mean taken
  /// True if an error is reached only if the next finer run that was tried reaches twice of it, too: where errors pass
  /// through zero.
  bool steadily = false;
};

/// Searches, measures the cheapest of each kind again in turns, and prints.
void report(const Study& study, const std::vector<Method>& methods, int repeats);

}  // namespace comparison
