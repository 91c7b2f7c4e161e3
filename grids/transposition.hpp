#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/grids/slab.hpp>

namespace rubato::grids {

/// Between the planes of a slab and columns across all planes, for transforms along the last axis. Complex numbers, as
/// pairs of doubles: in planes [field][owned plane][row][place in the row]; in columns [field][plane of the whole][row
/// of this rank][place]. In three dimensions rows are shared out among the ranks, in two the places of the one row,
/// some (`together`) at a time. Places beyond `modes` in a row are padding.
class Transposition {
public:
  struct Shape {
    std::size_t rows;   ///< of a plane
    std::size_t width;  ///< places of a row, a multiple of `together`
    std::size_t modes;  ///< of a row
    std::size_t together;
  };
  Transposition(const Slab& slab, int fields, Shape shape);

  /// What a rank has of each plane.
  struct Part {
    std::size_t first_row = 0, rows = 0;
    std::size_t first_place = 0, width = 0, modes = 0;
    /// Of a plane, with the padding.
    [[nodiscard]] std::size_t size() const { return rows * width; }
  };
  [[nodiscard]] const Part& mine() const { return parts_[static_cast<std::size_t>(slab_.rank())]; }
  [[nodiscard]] const Slab& slab() const { return slab_; }
  [[nodiscard]] bool leads() const { return slab_.leads(); }
  /// Planes of the whole lattice.
  [[nodiscard]] std::size_t planes() const { return planes_; }
  /// Modes that this rank has: numbered by plane, row and place.
  [[nodiscard]] std::size_t modes() const { return planes_ * mine().rows * mine().modes; }

  /// All ranks have to call these, with as many fields.
  ///@{
  void to_columns(std::size_t fields, const double* in_planes, double* in_columns) const;
  void to_planes(std::size_t fields, const double* in_columns, double* in_planes) const;
  ///@}
  [[nodiscard]] std::size_t modes_of_whole() const { return planes_ * shape_.rows * shape_.modes; }
  /// One number for each mode, as Slab has them for nodes: of the whole lattice, by plane, row and place, some planes
  /// at a time, at rank 0; and out of such.
  ///@{
  void gather(std::span<const double> of_modes, const Slab::Use& use) const;
  void scatter(std::span<double> of_modes, const Slab::Fill& fill) const;
  ///@}

private:
  /// Calls copy(rank, place in what is sent, place among all modes of these planes, count) for each row of each.
  template <class Copy>
  void for_rows(std::size_t planes, const Copy& copy) const {
    for (std::size_t rank = 0; rank < parts_.size(); ++rank) {
      const Part& part = parts_[rank];
      for (std::size_t i = 0; i < planes * part.rows; ++i) {
        const std::size_t row = i / part.rows * shape_.rows + part.first_row + i % part.rows;
        copy(rank, i * part.modes, row * shape_.modes + part.first_place, part.modes);
      }
    }
  }
  /// Makes room for what every rank sends to rank 0, or gets from there, of so many planes.
  void make_room(std::vector<std::vector<double>>& of_all, std::vector<std::vector<double>>& of_one,
                 std::size_t planes) const;

  const Slab& slab_;
  Shape shape_;
  std::size_t planes_;
  std::vector<Part> parts_;
  mutable std::vector<std::vector<double>> out_, in_;
};

}  // namespace rubato::grids
