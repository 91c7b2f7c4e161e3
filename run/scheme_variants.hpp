#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rubato/pde/lattice_method.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// Entries of [scheme] with their values as TOML.
using SchemeEntries = std::vector<std::pair<std::string, std::string>>;

/// A scheme to try: a method with its stages or its order.
struct SchemeVariant {
  std::string family;  ///< the method and its derivatives in space, which the variants of a family share
  SchemeEntries entries;
  double stages = 1.0;  ///< of a step, up to a factor that the family has in common
  std::optional<LatticeMethodChoice> lattice = {};

  [[nodiscard]] SchemeVariant with(Levels levels) const;
};

/// The one-step schemes to try on a problem, from the tables orbit_methods(), lattice_methods() and compositions(),
/// with orders from 2 to 8. Which of them take the problem is left to its reader.
[[nodiscard]] std::vector<SchemeVariant> scheme_variants(const Problem& problem);

/// A value as TOML, without quotes.
[[nodiscard]] std::string unquoted(const std::string& value);

/// The text of a problem without the entries that choose its scheme.
[[nodiscard]] std::string without_scheme(const Problem& problem);

}  // namespace rubato
