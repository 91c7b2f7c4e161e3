#include <rubato/grids/transposition.hpp>

#include <algorithm>

namespace rubato::grids {

Transposition::Transposition(const Slab& slab, int fields, Shape shape)
    : slab_(slab),
      shape_(shape),
      planes_(slab.whole().cells(slab.whole().dimensions() - 1)),
      out_(static_cast<std::size_t>(slab.ranks())),
      in_(out_.size()) {
  const auto ranks = static_cast<std::size_t>(slab.ranks());
  const bool by_rows = shape.rows > 1;
  const std::size_t units = by_rows ? shape.rows : shape.width / shape.together;
  const auto first = [&](std::size_t rank) { return units / ranks * rank + std::min(rank, units % ranks); };
  for (std::size_t rank = 0; rank < ranks; ++rank) {
    const std::size_t begin = first(rank), end = first(rank + 1);
    if (by_rows) {
      parts_.push_back({begin, end - begin, 0, shape.width, shape.modes});
    } else {
      const std::size_t place = begin * shape.together, width = (end - begin) * shape.together;
      parts_.push_back(
          {0, width == 0 ? 0U : 1U, place, width, std::min(width, shape.modes - std::min(place, shape.modes))});
    }
  }
  for (std::size_t rank = 0; rank < ranks; ++rank) {
    const auto all = static_cast<std::size_t>(fields);
    out_[rank].reserve(2 * all * slab.planes(slab.rank()) * parts_[rank].size());
    in_[rank].reserve(2 * all * slab.planes(static_cast<int>(rank)) * mine().size());
  }
}

void Transposition::to_columns(std::size_t fields, const double* in_planes, double* in_columns) const {
  const std::size_t planes = slab_.planes(slab_.rank());
  for (std::size_t rank = 0; rank < parts_.size(); ++rank) {
    const Part& part = parts_[rank];
    out_[rank].resize(2 * fields * planes * part.size());
    in_[rank].resize(2 * fields * slab_.planes(static_cast<int>(rank)) * mine().size());
    double* to = out_[rank].data();
    for (std::size_t plane = 0; plane < fields * planes; ++plane) {
      for (std::size_t row = 0; row < part.rows; ++row, to += 2 * part.width) {
        const std::size_t from = (plane * shape_.rows + part.first_row + row) * shape_.width + part.first_place;
        std::copy_n(in_planes + 2 * from, 2 * part.width, to);
      }
    }
  }
  slab_.exchange_all(out_, in_);
  const std::size_t size = 2 * mine().size();
  for (std::size_t rank = 0; rank < parts_.size(); ++rank) {
    const std::size_t first = slab_.first_plane(static_cast<int>(rank)), count = slab_.planes(static_cast<int>(rank));
    for (std::size_t field = 0; field < fields; ++field) {
      std::copy_n(in_[rank].data() + field * count * size, count * size, in_columns + (field * planes_ + first) * size);
    }
  }
}

void Transposition::to_planes(std::size_t fields, const double* in_columns, double* in_planes) const {
  const std::size_t planes = slab_.planes(slab_.rank()), size = 2 * mine().size();
  for (std::size_t rank = 0; rank < parts_.size(); ++rank) {
    const std::size_t first = slab_.first_plane(static_cast<int>(rank)), count = slab_.planes(static_cast<int>(rank));
    out_[rank].resize(fields * count * size);
    in_[rank].resize(2 * fields * planes * parts_[rank].size());
    for (std::size_t field = 0; field < fields; ++field) {
      std::copy_n(in_columns + (field * planes_ + first) * size, count * size,
                  out_[rank].data() + field * count * size);
    }
  }
  slab_.exchange_all(out_, in_);
  for (std::size_t rank = 0; rank < parts_.size(); ++rank) {
    const Part& part = parts_[rank];
    const double* from = in_[rank].data();
    for (std::size_t plane = 0; plane < fields * planes; ++plane) {
      for (std::size_t row = 0; row < part.rows; ++row, from += 2 * part.width) {
        const std::size_t to = (plane * shape_.rows + part.first_row + row) * shape_.width + part.first_place;
        std::copy_n(from, 2 * part.width, in_planes + 2 * to);
      }
    }
  }
}

void Transposition::make_room(std::vector<std::vector<double>>& of_all, std::vector<std::vector<double>>& of_one,
                              std::size_t planes) const {
  for (std::size_t rank = 0; rank < parts_.size(); ++rank) {
    of_all[rank].resize(slab_.leads() ? planes * parts_[rank].rows * parts_[rank].modes : 0);
    of_one[rank].clear();
  }
  of_one[0].resize(planes * mine().rows * mine().modes);
}

void Transposition::gather(std::span<const double> of_modes, const Slab::Use& use) const {
  const std::size_t some = Slab::planes_at_once(shape_.rows * shape_.modes), here = mine().rows * mine().modes;
  std::vector<double> whole;
  for (std::size_t first = 0; first < planes_; first += some) {
    const std::size_t planes = std::min(some, planes_ - first);
    make_room(in_, out_, planes);
    std::ranges::copy(of_modes.subspan(first * here, planes * here), out_[0].begin());
    slab_.exchange_all(out_, in_);
    if (slab_.leads()) {
      whole.resize(planes * shape_.rows * shape_.modes);
      for_rows(planes, [&](std::size_t rank, std::size_t from, std::size_t to, std::size_t count) {
        std::copy_n(in_[rank].data() + from, count, whole.data() + to);
      });
      use(whole);
    }
  }
}

void Transposition::scatter(std::span<double> of_modes, const Slab::Fill& fill) const {
  const std::size_t some = Slab::planes_at_once(shape_.rows * shape_.modes), here = mine().rows * mine().modes;
  std::vector<double> whole;
  for (std::size_t first = 0; first < planes_; first += some) {
    const std::size_t planes = std::min(some, planes_ - first);
    make_room(out_, in_, planes);
    if (slab_.leads()) {
      whole.resize(planes * shape_.rows * shape_.modes);
      fill(whole);
      for_rows(planes, [&](std::size_t rank, std::size_t to, std::size_t from, std::size_t count) {
        std::copy_n(whole.data() + from, count, out_[rank].data() + to);
      });
    }
    slab_.exchange_all(out_, in_);
    std::ranges::copy(in_[0], of_modes.begin() + static_cast<std::ptrdiff_t>(first * here));
  }
}

}  // namespace rubato::grids
