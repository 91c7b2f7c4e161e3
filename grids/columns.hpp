#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/grids/slab.hpp>

namespace rubato::grids {

/// The lines across all planes of a slab's lattice, whole, each at one rank: for what is done line by line along the
/// last axis. One line for each node of a plane, of as many values as there are planes; they are shared out as evenly
/// as can be. There and back a rank sends what others have of its nodes' lines, (P-1)/P of what it owns on P ranks, and
/// nothing else. All ranks have to call the same; the slab has to outlive this.
class Columns {
public:
  explicit Columns(const Slab& slab);

  /// Values of a line, and lines of this rank.
  ///@{
  [[nodiscard]] std::size_t planes() const { return places_.size(); }
  [[nodiscard]] std::size_t count() const { return mine_; }
  ///@}
  /// Takes the lines of some fields, arrays of the part, of which the owned nodes are read.
  void take(std::span<const double* const> fields);
  /// What this rank's lines have of a field taken in a plane of the whole, to read and to change.
  [[nodiscard]] double* row(std::size_t field, std::size_t plane) {
    const Place& place = places_[plane];
    return columns_[place.rank].data() + (field * place.planes + place.plane) * mine_;
  }
  /// Puts the lines back into as many fields; ghosts stay as they were.
  void put(std::span<double* const> fields);

private:
  /// Where a plane is: whose, of how many, and its number there.
  struct Place {
    std::size_t rank, planes, plane;
  };
  /// The nodes of a plane whose lines a rank has.
  [[nodiscard]] std::size_t first_of(std::size_t rank) const;
  template <class Copy>
  void for_rows(std::size_t fields, const Copy& copy);

  const Slab& slab_;
  std::size_t plane_, mine_;
  std::vector<Place> places_;
  std::vector<std::vector<double>> pieces_;   ///< of each rank's lines what this rank has: [field][owned plane][line]
  std::vector<std::vector<double>> columns_;  ///< of this rank's lines what each has: the same
};

}  // namespace rubato::grids
