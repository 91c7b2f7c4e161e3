#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <span>
#include <vector>

#include <rubato/base/spread.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// Local laws by formulas of a node and its neighbours, in two passes: fluxes in space, and residuals, which have the
/// densities of both levels and differences of the fluxes.
struct LawCodes {
  NodeCode density;    ///< J_t of each law
  NodeCode fluxes;     ///< those J_a that are not zero
  NodeCode residuals;  ///< of each law; it reads `of_fluxes` besides
  grids::FieldSet of_fluxes;

  /// sums += D_a J_a. \return the formulas of the fluxes, in the order of their arrays. \param current(a) J_a of all
  /// laws \param difference(array, a) D_a of an array of of_fluxes
  template <class Current, class Difference>
  static std::vector<formula::Expression> add_differences(int dimensions, const Current& current,
                                                          const Difference& difference,
                                                          std::vector<formula::Expression>& sums) {
    std::vector<formula::Expression> fluxes;
    for (int a = 0; a < dimensions; ++a) {
      const std::vector<formula::Expression> currents = current(a);
      for (std::size_t law = 0; law < currents.size(); ++law) {
        if (!currents[law].is_constant() || currents[law].constant_value() != 0.0) {
          sums[law] += difference(static_cast<int>(fluxes.size()), a);
          fluxes.push_back(currents[law]);
        }
      }
    }
    return fluxes;
  }

  /// The residuals of each law into `out` or, if that is empty, nowhere. \param read(code) lets a code read the step
  template <class Read>
  std::vector<Spread> take(const grids::Grid& grid, std::size_t laws, const Read& read, std::span<double* const> out) {
    if (of_fluxes.fields() > 0) {
      read(fluxes);
      fluxes(of_fluxes.pointers());
    }
    read(residuals);
    const std::span<double* const> arrays = out.empty() ? own_arrays(grid, laws).pointers() : out;
    residuals(arrays);
    std::vector<std::span<const double>> rows;
    std::ranges::transform(arrays, std::back_inserter(rows),
                           [&](const double* row) { return std::span(row, grid.size()); });
    return grids::magnitudes(rows);
  }
  /// Σ ΔV J_t of each law. \param read(code) lets a code read the level, as both levels of a step
  template <class Read>
  std::vector<double> totals(const grids::Grid& grid, std::size_t laws, const Read& read) {
    read(density);
    density(own_arrays(grid, laws).pointers());
    return grids::integrals(grid, own_);
  }

private:
  grids::FieldSet& own_arrays(const grids::Grid& grid, std::size_t laws) {
    if (own_.fields() == 0) {
      own_ = grids::FieldSet(static_cast<int>(laws), grid.size());
    }
    return own_;
  }
  grids::FieldSet own_;
};

}  // namespace rubato
