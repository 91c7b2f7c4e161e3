#include <rubato/grids/whole.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <rubato/grids/slab.hpp>

namespace rubato::grids {

const Grid& whole_of(const Grid& grid) {
  const Slab* const slab = Slab::of(grid.size());
  return slab == nullptr ? grid : slab->whole();
}

bool agreed_by_all(const Grid& grid, bool said) {
  const Slab* const slab = Slab::of(grid.size());
  return slab == nullptr ? said : slab->largest_over_ranks(said ? 0.0 : 1.0) == 0.0;
}

bool agreed(const Grid& grid, bool said) {
  double number = said ? 1.0 : 0.0;
  if (const Slab* const slab = Slab::of(grid.size())) {
    slab->broadcast(std::span(&number, 1));
  }
  return number != 0.0;
}

std::vector<double> values_at(const FieldSet& fields, std::size_t node) {
  const Slab* const slab = Slab::of(fields.size());
  std::vector<double> values(static_cast<std::size_t>(fields.fields()));
  if (slab == nullptr || slab->owner_of(node) == slab->rank()) {
    for (int f = 0; f < fields.fields(); ++f) {
      values[static_cast<std::size_t>(f)] = fields.field(f)[slab == nullptr ? node : slab->node_of(node)];
    }
  }
  if (slab != nullptr) {
    slab->broadcast(values, slab->owner_of(node));
  }
  return values;
}

std::pair<std::size_t, std::size_t> extreme_nodes(std::span<const double> values) {
  const Slab* const slab = Slab::of(values.size());
  const auto mine = slab == nullptr ? values : values.subspan(slab->first_node(), slab->owned());
  const std::size_t number = slab == nullptr ? 0 : slab->number_of_first();
  const auto [least, greatest] = std::ranges::minmax_element(mine);
  // Value and node of the least and of the greatest: whole numbers below 2^53.
  std::array<double, 4> found = {*least, static_cast<double>(number + static_cast<std::size_t>(least - mine.begin())),
                                 *greatest,
                                 static_cast<double>(number + static_cast<std::size_t>(greatest - mine.begin()))};
  if (slab != nullptr) {
    const std::vector<double> all = slab->collected(found);
    for (std::size_t rank = 0; rank < all.size(); rank += found.size()) {
      if (all[rank] < found[0]) {
        std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(rank), 2, found.begin());
      }
      if (all[rank + 2] >= found[2]) {
        std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(rank) + 2, 2, found.begin() + 2);
      }
    }
    slab->broadcast(found);
  }
  return {static_cast<std::size_t>(found[1]), static_cast<std::size_t>(found[3])};
}

std::optional<std::pair<std::size_t, double>> first_undefined(std::span<const double> values) {
  const Slab* const slab = Slab::of(values.size());
  const auto mine = slab == nullptr ? values : values.subspan(slab->first_node(), slab->owned());
  const auto wrong = std::ranges::find_if(mine, [](double value) { return !std::isfinite(value); });
  // Whether there is one, its value and its node.
  std::array<double, 3> found{};
  if (wrong != mine.end()) {
    found = {1.0, *wrong,
             static_cast<double>((slab == nullptr ? 0 : slab->number_of_first()) +
                                 static_cast<std::size_t>(wrong - mine.begin()))};
  }
  if (slab != nullptr) {
    const std::vector<double> all = slab->collected(found);
    for (std::size_t rank = 0; rank < all.size() && found[0] == 0.0; rank += found.size()) {
      std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(rank), found.size(), found.begin());
    }
    slab->broadcast(found);
  }
  if (found[0] == 0.0) {
    return std::nullopt;
  }
  return std::pair(static_cast<std::size_t>(found[2]), found[1]);
}

void for_each_line(const Grid& grid, int axis, std::span<const double> values,
                   const std::function<void(const double*, const Line&, std::size_t)>& use) {
  const Slab* const slab = Slab::of(grid.size());
  if (slab == nullptr) {
    for (const Line& line : lines_along(grid, axis)) {
      use(values.data(), line, line.first);
    }
    return;
  }
  const Grid& whole = slab->whole();
  const int last = whole.dimensions() - 1;
  const std::size_t planes = whole.cells(last), plane = whole.size() / planes;
  if (axis == last) {  // the lines of some columns
    const std::size_t most = Slab::planes_at_once(planes);
    for (std::size_t first = 0; first < plane; first += most) {
      const std::size_t count = std::min(most, plane - first);
      const std::vector<double> box = slab->gathered(values, {0, planes}, {first, count});
      for (std::size_t column = 0; column < count && slab->leads(); ++column) {
        use(box.data(), {column, count}, first + column);
      }
    }
    return;
  }
  const std::size_t most = Slab::planes_at_once(plane), stride = whole.stride(axis);
  for (std::size_t first = 0; first < planes; first += most) {
    const std::size_t count = std::min(most, planes - first);
    const std::vector<double> box = slab->gathered(values, {first, count}, {0, plane});
    for (std::size_t block = 0; block < box.size(); block += stride * whole.cells(axis)) {
      for (std::size_t offset = 0; offset < stride; ++offset) {
        use(box.data(), {block + offset, stride}, first * plane + block + offset);
      }
    }
  }
}

}  // namespace rubato::grids
