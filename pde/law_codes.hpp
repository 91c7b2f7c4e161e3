#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include <rubato/base/spread.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/variation/level_values.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// Local laws by formulas of a node and its neighbours, in three passes: the densities of a level, kept for the two
/// steps that it is a level of, with what else these have of one level; fluxes in space; and residuals, which are
/// differences of both.
struct LawCodes {
  LevelValues levels;  ///< J_t of each law first
  NodeCode fluxes;     ///< those J_a that are not zero
  NodeCode residuals;  ///< of each law
  grids::FieldSet of_fluxes;

  /// From formulas of each: `formulas` keeps and compiles them (NodeVariation::keep() and code()).
  template <class Formulas>
  LawCodes(Formulas& formulas, const grids::Grid& grid, std::span<const formula::Expression> densities,
           std::vector<formula::Expression> flux, std::vector<formula::Expression> residual)
      : levels(formulas.keep(static_cast<int>(flux.size()), densities, {&flux, &residual})),
        fluxes(formulas.code(flux)),
        residuals(formulas.code(residual)),
        of_fluxes(static_cast<int>(flux.size()), grid.size()) {}
  LawCodes() = default;

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

  /// The residuals of each law into `out` or, if that is empty, nowhere. \param follows `before` is the level that was
  /// `after` of the step taken last, and no other was asked for since \param read_level(code, level) lets a code read a
  /// level, as both of its step, and \param read(code) the step
  template <class ReadLevel, class Read>
  std::vector<Spread> take(const grids::Grid& grid, std::size_t laws, const LatticeLevel& before,
                           const LatticeLevel& after, bool follows, const ReadLevel& read_level, const Read& read,
                           std::span<double* const> out) {
    levels.take(before.fields, after.fields, follows && are_of_step_, read_level);
    if (of_fluxes.fields() > 0) {
      read(fluxes);
      fluxes(of_fluxes.pointers());
    }
    read(residuals);
    if (out.empty()) {
      out = arrays_of(own_, grid, laws).pointers();
    }
    residuals(out);
    are_of_step_ = true;
    std::vector<std::span<const double>> rows;
    for (double* const row : out) {
      std::fill(row + cells_of(grid), row + grid.size(), 0.0);
      rows.emplace_back(row, grid.size());
    }
    return grids::magnitudes(rows);
  }
  /// Σ ΔV J_t of each law.
  template <class ReadLevel>
  std::vector<double> totals(const grids::Grid& grid, std::size_t laws, const LatticeLevel& level,
                             const ReadLevel& read_level) {
    levels.take(level.fields, read_level);
    are_of_step_ = false;
    return of_densities(grid, laws);
  }
  /// The same of the upper level of the step taken last, by what that found, or as totals() has them.
  template <class ReadLevel>
  std::vector<double> totals_after(const grids::Grid& grid, std::size_t laws, const LatticeLevel& level,
                                   const ReadLevel& read_level) {
    return are_of_step_ ? of_densities(grid, laws) : totals(grid, laws, level, read_level);
  }

private:
  /// How many cells have laws, or nodes: on a line between walls the last node has no cell.
  [[nodiscard]] static std::size_t cells_of(const grids::Grid& grid) {
    return grid.has_walls() ? grid.axis(0).cell_count() : grid.size();
  }
  [[nodiscard]] std::vector<double> of_densities(const grids::Grid& grid, std::size_t laws) const {
    std::vector<std::span<const double>> rows;
    for (std::size_t law = 0; law < laws; ++law) {
      rows.push_back(levels.upper().field(static_cast<int>(law)).first(cells_of(grid)));
    }
    std::vector<double> totals(laws);
    grids::sums(rows, totals);
    for (double& total : totals) {
      total *= grid.cell_volume();
    }
    return totals;
  }
  static grids::FieldSet& arrays_of(grids::FieldSet& set, const grids::Grid& grid, std::size_t laws) {
    if (set.fields() == 0) {
      set = grids::FieldSet(static_cast<int>(laws), grid.size());
    }
    return set;
  }
  grids::FieldSet own_;       ///< residuals that nobody else keeps
  bool are_of_step_ = false;  ///< the upper level's values are those of the step taken last
};

}  // namespace rubato
