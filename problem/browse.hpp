#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rubato {

/// One problem of the catalogue.
struct CatalogueItem {
  std::string name;
  std::string title;
  bool is_lattice = false;  ///< a PDE on a grid, not an ODE
};

/// The catalogue: ODEs first, then PDEs, each in alphabetical order.
[[nodiscard]] std::vector<CatalogueItem> list_catalogue();

/// The complete problem file called `name`.
/// \throws ProblemError with the nearest names if there is none
[[nodiscard]] std::string_view show_catalogue(const std::string& name);

/// "did you mean …?" for the entry of `known` nearest to `word`; empty if none is near.
[[nodiscard]] std::string did_you_mean(std::string_view word, std::span<const std::string> known);

}  // namespace rubato
