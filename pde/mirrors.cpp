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

Mirrors::Image Mirrors::image(int axis, int field, std::size_t place) const {
  const grids::Axis& of = grid_.axis(axis);
  const std::size_t between = of.cells - 1;
  const int shift = offset(axis, field);
  const auto beyond = [&](std::size_t wall, End end) {
    // Of fields half a cell after or before their nodes the mirror lies that much beside the wall's node.
    Image image = this->image(axis, field, shift == 0 ? 2 * wall - place : 2 * wall - place - (shift > 0 ? 1 : -1));
    if (sign(axis, field, end) > 0) {
      return image;
    }
    image = {image.place, -image.sign, -image.of_first, -image.of_last};
    if (shift == 0) {
      const Image held = this->image(axis, field, wall);
      image.of_first += 2.0 * (held.of_first + (held.place == 0 ? held.sign : 0.0));
      image.of_last += 2.0 * (held.of_last + (held.place == 0 ? 0.0 : held.sign));
    }
    return image;
  };
  const auto is_beyond = [&](std::size_t wall) { return shift > 0 ? place >= wall : place > wall; };
  if (is_beyond(2 * between)) {
    return beyond(2 * between, of.left);
  }
  if (is_beyond(between)) {
    return beyond(between, of.right);
  }
  if (shift < 0 && place == 0) {
    return {1, sign(axis, field, of.left) > 0 ? 1.0 : -1.0, 0.0, 0.0};
  }
  return {place, 1.0, 0.0, 0.0};
}

bool Mirrors::holds_both_ends(int axis, int field) const {
  const grids::Axis& of = grid_.axis(axis);
  return of.has_walls() && offset(axis, field) == 0 && sign(axis, field, of.left) < 0 &&
         sign(axis, field, of.right) < 0;
}

void Mirrors::read_line(int field, std::span<const double> between, int axis, std::size_t first, Slope slope,
                        std::span<double> line) const {
  // Across the line: what of which places of the space between the walls.
  std::array<std::array<std::pair<std::size_t, double>, 3>, 3> parts{};
  const auto at = ring_.place(first);
  for (int a = 0; a < 3; ++a) {
    auto& of_axis = parts[static_cast<std::size_t>(a)];
    of_axis[0] = {at[static_cast<std::size_t>(a)], 1.0};
    if (a == axis || a >= grid_.dimensions() || !grid_.axis(a).has_walls()) {
      continue;
    }
    Image one = image(a, field, at[static_cast<std::size_t>(a)]);
    const std::size_t last = grid_.cells(a) - 1;
    if (slope == Slope::left_out && holds_both_ends(a, field)) {
      const double rise = one.sign * static_cast<double>(one.place) / static_cast<double>(last);
      one = {one.place, one.sign, one.of_first + one.of_last + rise, -rise};
    }
    of_axis = {{{one.place, one.sign}, {0, one.of_first}, {last, one.of_last}}};
  }
  const std::size_t cells = grid_.cells(axis), stride = grid_.stride(axis);
  const std::span<double> own = line.first(cells);
  std::ranges::fill(own, 0.0);
  for (const auto& [k, of_k] : parts[2]) {
    for (const auto& [j, of_j] : parts[1]) {
      for (const auto& [i, of_i] : parts[0]) {
        if (const double factor = of_i * of_j * of_k; factor != 0.0) {
          const double* const from = between.data() + grid_.index(i, j, k);
          for (std::size_t n = 0; n < cells; ++n) {
            own[n] += factor * from[n * stride];
          }
        }
      }
    }
  }
  if (grid_.axis(axis).has_walls()) {
    continue_line(axis, field, slope, line);
  }
}

/// What stands at the first places of a line goes on in mirrors to its end.
void Mirrors::continue_line(int axis, int field, Slope slope, std::span<double> line) const {
  const std::size_t between = grid_.cells(axis) - 1;
  const int shift = offset(axis, field);
  if (slope == Slope::left_out && holds_both_ends(axis, field)) {
    const double rise = line[between] - line[0];
    for (std::size_t i = 1; i <= between && rise != 0.0; ++i) {
      line[i] -= rise * static_cast<double>(i) / static_cast<double>(between);
    }
  }
  if (shift < 0) {
    line[0] = image(axis, field, 0).sign * line[1];
  }
  const double first = line[0], last = line[between];
  for (std::size_t begin = shift > 0 ? between : between + 1; begin < line.size(); begin += between) {
    const std::size_t count = std::min(between, line.size() - begin);
    const Image one = image(axis, field, begin);
    const bool descends = count > 1 && image(axis, field, begin + 1).place < one.place;
    const double held = one.of_first * first + one.of_last * last;
    double* const to = line.data() + begin;
    const double* const from = line.data() + one.place;
    for (std::size_t i = 0; i < count; ++i) {
      to[i] = one.sign * (descends ? *(from - i) : from[i]) + held;
    }
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
  const std::size_t n = ring_.cells(0);
  for (std::size_t first = 0; first < ring.size(); first += n) {
    read_line(field, between, 0, first, Slope::kept, ring.subspan(first, n));
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
