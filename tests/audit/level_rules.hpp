#pragma once

#include <cstddef>
#include <string>

namespace audit {

/// What a problem says of its levels.
struct LevelRules {
  double start = 0.0, until = 0.0;
  double step = 0.0;  ///< the first one; 0 where the run chose it
  double tolerance = 1e-13;
  bool fixed = false;
  std::size_t every = 1;
  int order = 2;           ///< of the scheme
  bool potential = false;  ///< true if a step potential is part of the conserved energy
  double kappa = 0.0;      ///< of one that the problem gives; 0 where the run chose it
  double exponent = 0.0;   ///< the same
};

/// What stands in a problem for its step potential.
struct PotentialRule {
  enum class Kind { unsaid, none, automatic, given };
  Kind kind = Kind::unsaid;
  double kappa = 0.0, exponent = 0.0;  ///< given
  double largest_step = 0.0;           ///< automatic; 0 where nothing is said of it

  [[nodiscard]] std::string toml() const;
};

}  // namespace audit
