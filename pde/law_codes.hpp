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
  NodeCode residuals;  ///< of each law, then J_t of each at the upper level; it reads `of_fluxes` besides
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
    if (out.empty()) {
      out = arrays_of(own_, grid, laws).pointers();
    }
    std::vector<double*> outputs(out.begin(), out.end());
    std::ranges::copy(arrays_of(densities_, grid, laws).pointers(), std::back_inserter(outputs));
    residuals(outputs);
    are_of_step_ = true;
    std::vector<std::span<const double>> rows;
    std::ranges::transform(out, std::back_inserter(rows),
                           [&](const double* row) { return std::span(row, grid.size()); });
    return grids::magnitudes(rows);
  }
  /// Σ ΔV J_t of each law. \param read(code) lets a code read the level, as both levels of a step
  template <class Read>
  std::vector<double> totals(const grids::Grid& grid, std::size_t laws, const Read& read) {
    read(density);
    density(arrays_of(densities_, grid, laws).pointers());
    are_of_step_ = false;
    return grids::integrals(grid, densities_);
  }
  /// The same of the upper level of the step taken last, by what that found, or as totals() has them.
  template <class Read>
  std::vector<double> totals_after(const grids::Grid& grid, std::size_t laws, const Read& read) {
    return are_of_step_ ? grids::integrals(grid, densities_) : totals(grid, laws, read);
  }

private:
  static grids::FieldSet& arrays_of(grids::FieldSet& set, const grids::Grid& grid, std::size_t laws) {
    if (set.fields() == 0) {
      set = grids::FieldSet(static_cast<int>(laws), grid.size());
    }
    return set;
  }
  grids::FieldSet own_;        ///< residuals that nobody else keeps
  grids::FieldSet densities_;  ///< of the level that was asked for last
  bool are_of_step_ = false;   ///< and that is the upper one of the step taken last
};

}  // namespace rubato
