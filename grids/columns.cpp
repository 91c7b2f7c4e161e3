#include <rubato/grids/columns.hpp>

#include <algorithm>

namespace rubato::grids {

Columns::Columns(const Slab& slab)
    : slab_(slab),
      plane_(slab.size() / slab.grid().axes().back().cells),
      mine_(first_of(static_cast<std::size_t>(slab.rank()) + 1) - first_of(static_cast<std::size_t>(slab.rank()))),
      pieces_(static_cast<std::size_t>(slab.ranks())),
      columns_(pieces_.size()) {
  for (int rank = 0; rank < slab.ranks(); ++rank) {
    for (std::size_t plane = 0; plane < slab.planes(rank); ++plane) {
      places_.push_back({static_cast<std::size_t>(rank), slab.planes(rank), plane});
    }
  }
}

std::size_t Columns::first_of(std::size_t rank) const {
  const auto ranks = static_cast<std::size_t>(slab_.ranks());
  return plane_ / ranks * rank + std::min(rank, plane_ % ranks);
}

/// Calls copy(field, node of the part, its place in pieces_, count) for what each rank has lines of in each owned
/// plane.
template <class Copy>
void Columns::for_rows(std::size_t fields, const Copy& copy) {
  const std::size_t planes = slab_.planes(slab_.rank());
  for (std::size_t rank = 0; rank < pieces_.size(); ++rank) {
    const std::size_t first = first_of(rank), count = first_of(rank + 1) - first;
    pieces_[rank].resize(fields * planes * count);
    columns_[rank].resize(fields * slab_.planes(static_cast<int>(rank)) * mine_);
    double* piece = pieces_[rank].data();
    for (std::size_t field = 0; field < fields; ++field) {
      for (std::size_t plane = 0; plane < planes; ++plane, piece += count) {
        copy(field, slab_.first_node() + plane * plane_ + first, piece, count);
      }
    }
  }
}

void Columns::take(std::span<const double* const> fields) {
  for_rows(fields.size(), [&](std::size_t field, std::size_t node, double* piece, std::size_t count) {
    std::copy_n(fields[field] + node, count, piece);
  });
  slab_.exchange_all(pieces_, columns_);
}

void Columns::put(std::span<double* const> fields) {
  slab_.exchange_all(columns_, pieces_);
  for_rows(fields.size(), [&](std::size_t field, std::size_t node, const double* piece, std::size_t count) {
    std::copy_n(piece, count, fields[field] + node);
  });
}

}  // namespace rubato::grids
