#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/grids/slab.hpp>

namespace rubato {

/// The number that a node of a part has in the whole lattice, of a ghost that of the node it is a copy of; without a
/// slab the node's own.
[[nodiscard]] std::size_t number_in_whole(const grids::Slab* slab, std::size_t node);

/// The largest magnitudes so far of what a run's states are made of, and states displaced by as much of these as
/// Rounding says: the same of a part as of the whole.
class StateScales {
public:
  /// \param slab null for one process
  /// \param components how many numbers of a state have one scale: a field's, or one
  StateScales(const grids::Slab* slab, std::size_t components) : slab_(slab), components_(components) {}

  /// By all ranks.
  void see(std::span<const double> z);
  [[nodiscard]] std::vector<double> displaced(std::span<const double> z, int attempt, int level) const;

private:
  const grids::Slab* slab_;
  std::size_t components_;
  std::vector<double> scales_;
};

}  // namespace rubato
