#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <rubato/ode/hamiltonian.hpp>

namespace rubato {

/// J H_zz of chains and other Hamiltonians of which few degrees of freedom meet in an entry of H_zz: with the degrees
/// of freedom numbered so that those which meet are close together (solve::reverse_cuthill_mckee), and each coordinate
/// beside its momentum, the entries lie in a band. What is solved with such a matrix takes work and memory like n.
struct HessianBand {
  /// (J H_zz)_row,column, in the numbering of the band, is sign times the entry of H_zz of that number among
  /// Hamiltonian::hessian_places().
  struct Entry {
    int row, column;
    std::size_t number;
    double sign;
  };

  std::vector<int> places;  ///< of q, then of p, in the numbering of the band
  int width = 0;            ///< entries vanish unless |row - column| <= width
  std::vector<Entry> entries;

  /// None where elimination in the band would not take less work than in the whole matrix by far.
  [[nodiscard]] static std::optional<HessianBand> of(const Hamiltonian& hamiltonian);
};

}  // namespace rubato
