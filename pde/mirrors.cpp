#include <rubato/pde/mirrors.hpp>

#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>

#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/random_points.hpp>

namespace rubato {

namespace {

using grids::End;

/// Relative to S and its terms, at random points.
constexpr double same_in_mirror = 1e-9;
constexpr Eigen::Index mirror_samples = 8;

grids::Axis ring_of(const grids::Axis& axis, bool is_mixed) {
  if (!axis.has_walls()) {
    return axis;
  }
  const std::size_t between = axis.cells - 1, copies = is_mixed ? 4 : 2;
  return {.name = axis.name,
          .from = axis.from,
          .to = axis.from + static_cast<double>(copies) * axis.length(),
          .cells = copies * between,
          .mirrored = between};
}

grids::Axis with_ghosts(const grids::Axis& axis, std::size_t ghosts) {
  grids::Axis ring = axis;
  ring.mirrored = axis.cells - 1;
  ring.ghosts = ghosts;
  ring.cells += 2 * ghosts;
  return ring;
}

}  // namespace

Mirrors::Mirrors(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
                 std::size_t ghosts, grids::Ghosts of_ranks)
    : grid_(grid), ring_(grid), mirrors_(system, grid, collocation) {
  const grids::Slab* const between = grids::Slab::of(grid);
  std::vector<grids::Axis> axes;
  for (const grids::Axis& axis : between == nullptr ? grid.axes() : between->whole().axes()) {
    const int a = static_cast<int>(axes.size());
    if (!axis.has_walls()) {
      axes.push_back(axis);
    } else if (ghosts > 0) {
      axes.push_back(with_ghosts(axis, ghosts));
      first_.at(static_cast<std::size_t>(a)) = ghosts;
    } else {
      bool is_mixed = false;
      for (int f = 0; f < system.field_count(); ++f) {
        is_mixed = is_mixed || sign(a, f, axis.left) != sign(a, f, axis.right);
      }
      axes.push_back(ring_of(axis, is_mixed));
      copies_ *= is_mixed ? 4.0 : 2.0;
    }
  }
  ring_ = grids::Grid(std::move(axes));
  if (between != nullptr) {
    share_ring(*between, of_ranks);
  }
  if (ghosts > 0) {
    ghosts_.emplace(mirrors_, ring_);
  }
  held_ = mirrors_.held(grid_);
  held_values_.resize(held_.size());
}

/// A rank has the same nodes of the ring as of the space between the walls, and beside a wall its ghosts.
void Mirrors::share_ring(const grids::Slab& between, grids::Ghosts of_ranks) {
  std::size_t& first = first_.at(static_cast<std::size_t>(ring_.dimensions() - 1));
  std::vector<std::size_t> parts{0};
  for (int rank = 1; rank < between.ranks(); ++rank) {
    parts.push_back(between.first_plane(rank) + first);
  }
  parts.push_back(ring_.axes().back().cells);
  slab_ = std::make_shared<grids::Slab>(between.communicator(), ring_, of_ranks, std::move(parts));
  ring_ = slab_->grid();
  first = of_ranks.before + (between.leads() ? first : 0);
}

/// Continues what stands at the first places of an axis to its end; a place is a block of values.
void Mirrors::extend_blocks(int axis, int field, std::size_t block, std::span<double> values) const {
  const grids::Axis& of = grid_.axis(axis);
  const int shift = offset(axis, field);
  const std::size_t places = values.size() / block, between = of.cells - 1;
  const auto at = [&](std::size_t place) { return values.data() + place * block; };
  const auto mirror = [&](std::size_t wall, End end) {
    const bool is_even = sign(axis, field, end) > 0;
    const std::size_t first = shift > 0 ? 0 : 1, last = shift > 0 ? wall - 1 : wall;
    for (std::size_t j = first; j <= last && wall + j < places; ++j) {
      const double* const from = at(shift == 0 ? wall - j : shift > 0 ? wall - 1 - j : wall + 1 - j);
      const double* const held = shift == 0 && wall < places ? at(wall) : from;
      double* const to = at(wall + j);
      for (std::size_t i = 0; i < block; ++i) {
        to[i] = is_even ? from[i] : shift == 0 ? 2.0 * held[i] - from[i] : -from[i];
      }
    }
  };
  if (shift < 0) {
    const double factor = sign(axis, field, of.left) > 0 ? 1.0 : -1.0;
    std::transform(at(1), at(2), at(0), [factor](double value) { return factor * value; });
  }
  mirror(between, of.right);
  if (places > 2 * between) {
    mirror(2 * between, of.left);
  }
}

void Mirrors::extend(int field, std::span<const double> between, std::span<double> ring) const {
  if (ghosts_) {
    for_each_line([&](std::size_t from, std::size_t to) {
      std::copy_n(between.data() + from, grid_.cells(0), ring.data() + to);
    });
    ghosts_->renew(field, ring);
    return;
  }
  int last = grid_.dimensions() - 1;
  while (!grid_.axis(last).has_walls()) {
    --last;
  }
  std::size_t stride = 1, lines = between.size();
  for (int a = 0; a <= last; ++a) {
    const std::size_t n = grid_.cells(a), m = ring_.cells(a);
    lines /= n;
    if (grid_.axis(a).has_walls()) {
      std::vector<double>& room = extended_along_[static_cast<std::size_t>(a)];
      room.resize(a == last ? 0 : stride * m * lines);
      const std::span<double> out = a == last ? ring : std::span<double>(room);
      for (std::size_t line = 0; line < lines; ++line) {
        const std::span<double> of_line = out.subspan(line * m * stride, m * stride);
        std::copy_n(between.begin() + static_cast<std::ptrdiff_t>(line * n * stride), std::min(n, m) * stride,
                    of_line.begin());
        extend_blocks(a, field, stride, of_line);
      }
      between = room;
    }
    stride *= m;
  }
}

void Mirrors::extend(const grids::FieldSet& between, grids::FieldSet& ring) const {
  for (int f = 0; f < between.fields(); ++f) {
    extend(f, between.field(f), ring.field(f));
  }
  if (slab_ != nullptr) {
    slab_->refresh(ring);
  }
}

LatticeLevel Mirrors::extended(const LatticeLevel& between) const {
  LatticeLevel level{grids::FieldSet(between.fields.fields(), ring_.size()), between.slopes};
  extend(between.fields, level.fields);
  return level;
}

LatticeLevel Mirrors::extended_without_slope(const LatticeLevel& between) const {
  LatticeLevel level = between;
  for (int a = 0; a < grid_.dimensions(); ++a) {
    const grids::Axis& axis = grid_.axis(a);
    for (int f = 0; axis.has_walls() && f < level.fields.fields(); ++f) {
      if (offset(a, f) != 0 || sign(a, f, axis.left) > 0 || sign(a, f, axis.right) > 0) {
        continue;
      }
      const std::span<double> values = level.fields.field(f);
      const std::size_t stride = grid_.stride(a), last = axis.cells - 1;
      for (std::size_t node = 0; node < values.size(); ++node) {
        if (grid_.place(node)[static_cast<std::size_t>(a)] == 0) {
          const double rise = values[node + last * stride] - values[node];
          for (std::size_t i = 1; i <= last && rise != 0.0; ++i) {
            values[node + i * stride] -= rise * static_cast<double>(i) / static_cast<double>(last);
          }
        }
      }
    }
  }
  return extended(level);
}

template <class Use>
void Mirrors::for_each_line(const Use& use) const {
  const std::size_t n = grid_.cells(0), lines = grid_.size() / n;
  for (std::size_t line = 0; line < lines; ++line) {
    const auto [_, j, k] = grid_.place(line * n);
    use(line * n, ring_.index(first_[0], j + first_[1], k + first_[2]));
  }
}

void Mirrors::restrict(std::span<const double> ring, std::span<double> between) const {
  for_each_line(
      [&](std::size_t to, std::size_t from) { std::copy_n(ring.data() + from, grid_.cells(0), between.data() + to); });
}

void Mirrors::restrict(const grids::FieldSet& ring, grids::FieldSet& between) const {
  for (int f = 0; f < ring.fields(); ++f) {
    restrict(ring.field(f), between.field(f));
  }
}

void Mirrors::restrict_within(const grids::FieldSet& ring, grids::FieldSet& between) const {
  for (std::size_t i = 0; i < held_.size(); ++i) {
    held_values_[i] = between.field(held_[i].first)[held_[i].second];
  }
  restrict(ring, between);
  for (std::size_t i = 0; i < held_.size(); ++i) {
    between.field(held_[i].first)[held_[i].second] = held_values_[i];
  }
}

std::optional<formula::ChangedTerm> find_changed_term(const MultisymplecticSystem& system, std::span<const int> signs,
                                                      std::span<const double> centre) {
  formula::ImageTest test(system.expression(), system.variables());
  for (const PotentialSample& sample : samples_of(system, mirror_samples)) {
    const Eigen::VectorXd& point = sample.point;
    Eigen::VectorXd mirrored = point;
    for (std::size_t f = 0; f < signs.size(); ++f) {
      const auto i = static_cast<Eigen::Index>(f);
      mirrored(i) = signs[f] > 0 ? mirrored(i) : 2.0 * centre[f] - mirrored(i);
    }
    const auto size = static_cast<std::size_t>(point.size());
    if (auto changed = test.find_changed_term({point.data(), size}, {mirrored.data(), size}, same_in_mirror)) {
      return changed;
    }
  }
  return std::nullopt;
}

}  // namespace rubato
