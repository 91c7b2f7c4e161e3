#include <rubato/grids/slab.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <stdexcept>

#include <fmt/core.h>

#include <rubato/grids/reductions.hpp>

namespace rubato::grids {

namespace {

using ranks::Communicator;

std::size_t planes_of(const Grid& whole) {
  return whole.cells(whole.dimensions() - 1);
}

/// \throws std::invalid_argument if there are more ranks than planes
std::vector<std::size_t> checked(std::vector<std::size_t> first_planes, const Grid& whole, const Communicator& ranks) {
  const std::size_t planes = planes_of(whole), size = static_cast<std::size_t>(ranks.size());
  if (size > planes) {
    throw std::invalid_argument(
        fmt::format("{} ranks cannot share a lattice of {} planes across {}: there has to be one for each; start fewer",
                    ranks.size(), planes, whole.axes().back().name));
  }
  if (first_planes.empty()) {
    for (std::size_t rank = 0; rank <= size; ++rank) {
      first_planes.push_back(planes / size * rank + std::min(rank, planes % size));
    }
  }
  if (first_planes.size() != size + 1 || first_planes.front() != 0 || first_planes.back() != planes ||
      std::ranges::adjacent_find(first_planes, std::greater_equal<>()) != first_planes.end()) {
    throw std::logic_error("the parts of ranks do not make up the lattice");
  }
  return first_planes;
}

/// \param parts the first planes of this rank and of the next
Grid part_of(const Grid& whole, std::span<const std::size_t, 2> parts, Ghosts ghosts) {
  const std::size_t planes = planes_of(whole);
  std::vector<Axis> axes = whole.axes();
  axes.back().of = planes;
  // The first plane is a ghost, beyond the lattice's own first one at rank 0.
  axes.back().first = (parts[0] + planes * (1 + ghosts.before / planes) - ghosts.before) % planes;
  axes.back().cells = parts[1] - parts[0] + ghosts.before + ghosts.after;
  return Grid(std::move(axes));
}

}  // namespace

Slab::Slab(Communicator& ranks, const Grid& whole, Ghosts ghosts, std::vector<std::size_t> first_planes)
    : ranks_(ranks),
      whole_(whole),
      ghosts_(ghosts),
      plane_(whole.size() / planes_of(whole)),
      first_planes_(checked(std::move(first_planes), whole, ranks)),
      grid_(
          part_of(whole, std::span(first_planes_).subspan(static_cast<std::size_t>(ranks.rank())).first<2>(), ghosts)),
      send_(static_cast<std::size_t>(ranks.size())),
      receive_(send_.size()),
      out_(send_.size()),
      in_(send_.size()) {
  const int mine = ranks.rank();
  for (int rank = 0; rank < ranks.size(); ++rank) {
    const std::vector<std::size_t> wanted = ghost_planes(rank);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const int from = owner(wanted[i]);
      const bool is_before = i < ghosts_.before;
      const std::size_t from_edge = is_before ? i : wanted.size() - 1 - i;
      if (from == mine) {
        send_[static_cast<std::size_t>(rank)].push_back({ghosts_.before + wanted[i] - first_plane(mine), from_edge});
      }
      if (rank == mine) {
        const std::size_t place = is_before ? i : planes(mine) + i;
        receive_[static_cast<std::size_t>(from)].push_back({place, from_edge});
      }
    }
  }
}

int Slab::owner(std::size_t plane) const {
  return static_cast<int>(std::ranges::upper_bound(first_planes_, plane) - first_planes_.begin()) - 1;
}

std::vector<std::size_t> Slab::ghost_planes(int rank) const {
  const std::size_t all = planes_of(whole_), around = all * (1 + ghosts_.before / all);
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < ghosts_.before; ++i) {
    result.push_back((first_plane(rank) + around - ghosts_.before + i) % all);
  }
  for (std::size_t i = 0; i < ghosts_.after; ++i) {
    result.push_back((first_plane(rank + 1) + i) % all);
  }
  return result;
}

void Slab::refresh(FieldSet& fields) const {
  std::vector<int> all(static_cast<std::size_t>(fields.fields()));
  std::iota(all.begin(), all.end(), 0);
  refresh(fields, all);
}

void Slab::refresh(FieldSet& fields, std::span<const int> which) const {
  refresh(fields, which, std::max(ghosts_.before, ghosts_.after));
}

void Slab::refresh(FieldSet& fields, std::span<const int> which, std::size_t outer) const {
  begin_refresh(fields, which, outer);
  end_refresh(fields, which, outer);
}

/// Calls copy(values of a plane, their place in a message) for those of the planes that are among the `outer` ones.
template <class Copy>
std::size_t Slab::for_ghosts(const std::vector<GhostPlane>& planes, std::span<const int> which, std::size_t outer,
                             const Copy& copy) const {
  std::size_t at = 0;
  for (const int f : which) {
    for (const GhostPlane& plane : planes) {
      if (plane.from_edge < outer) {
        copy(f, plane.place * plane_, at);
        at += plane_;
      }
    }
  }
  return at;
}

void Slab::begin_refresh(const FieldSet& fields, std::span<const int> which, std::size_t outer) const {
  const auto none = [](int, std::size_t, std::size_t) {};
  std::vector<Communicator::Outgoing> out;
  std::vector<Communicator::Incoming> in;
  for (std::size_t rank = 0; rank < send_.size(); ++rank) {
    out_[rank].resize(for_ghosts(send_[rank], which, outer, none));
    for_ghosts(send_[rank], which, outer, [&](int f, std::size_t place, std::size_t at) {
      std::copy_n(fields.field(f).data() + place, plane_, out_[rank].data() + at);
    });
    if (static_cast<int>(rank) == ranks_.rank()) {
      continue;  // a part so thin, or so few ranks, that it is its own neighbour
    }
    if (!out_[rank].empty()) {
      out.push_back({static_cast<int>(rank), out_[rank]});
    }
    in_[rank].resize(for_ghosts(receive_[rank], which, outer, none));
    if (!in_[rank].empty()) {
      in.push_back({static_cast<int>(rank), in_[rank]});
    }
  }
  ranks_.begin_exchange(out, in);
}

void Slab::end_refresh(FieldSet& fields, std::span<const int> which, std::size_t outer) const {
  ranks_.end_exchange();
  for (std::size_t rank = 0; rank < send_.size(); ++rank) {
    const std::vector<double>& from = static_cast<int>(rank) == ranks_.rank() ? out_[rank] : in_[rank];
    for_ghosts(receive_[rank], which, outer, [&](int f, std::size_t place, std::size_t at) {
      std::copy_n(from.data() + at, plane_, fields.field(f).data() + place);
    });
  }
}

void Slab::take_part(std::span<const double> whole, std::span<double> part) const {
  const Axis& axis = grid_.axes().back();
  for (std::size_t plane = 0; plane < axis.cells; ++plane) {
    std::copy_n(whole.data() + (axis.first + plane) % axis.of * plane_, plane_, part.data() + plane * plane_);
  }
}

Slab::Range Slab::owned_of(Range planes, int rank) const {
  const std::size_t first = std::max(planes.first, first_plane(rank));
  const std::size_t end = std::min(planes.first + planes.count, first_plane(rank + 1));
  return {first, end > first ? end - first : 0};
}

void Slab::gather(std::span<const double> part, const Use& use) const {
  const std::size_t all = planes_of(whole_), some = planes_at_once(plane_);
  for (std::size_t first = 0; first < all; first += some) {
    const std::vector<double> planes = gathered(part, {first, std::min(some, all - first)}, {0, plane_});
    if (leads()) {
      use(planes);
    }
  }
}

void Slab::scatter(std::span<double> part, const Fill& fill) const {
  const std::size_t all = planes_of(whole_), some = planes_at_once(plane_);
  std::vector<double> box;
  for (std::size_t first = 0; first < all; first += some) {
    const Range planes{first, std::min(some, all - first)};
    const Range mine = owned_of(planes, ranks_.rank());
    double* const here = part.data() + (ghosts_.before + mine.first - first_plane(ranks_.rank())) * plane_;
    if (!leads()) {
      if (mine.count > 0) {
        ranks_.exchange({}, std::array{Communicator::Incoming{0, std::span(here, mine.count * plane_)}});
      }
      continue;
    }
    box.resize(planes.count * plane_);
    fill(box);
    std::vector<Communicator::Outgoing> out;
    for (int rank = 0; rank < ranks_.size(); ++rank) {
      const Range theirs = owned_of(planes, rank);
      const auto values = std::span<const double>(box).subspan((theirs.count > 0 ? theirs.first - first : 0) * plane_,
                                                               theirs.count * plane_);
      if (theirs.count > 0 && rank != ranks_.rank()) {
        out.push_back({rank, values});
      } else {
        std::ranges::copy(values, here);
      }
    }
    ranks_.exchange(out, {});
  }
}

std::vector<double> Slab::gathered(std::span<const double> part, Range planes, Range columns) const {
  // What a rank has of these planes is sent as it lies there, if that is all of them.
  const auto planes_of_rank = [&](int rank) { return owned_of(planes, rank); };
  const auto place_of = [&](std::size_t plane) { return (plane - planes.first) * columns.count; };
  const Range mine = planes_of_rank(ranks_.rank());
  const double* from =
      part.data() + (ghosts_.before + mine.first - first_plane(ranks_.rank())) * plane_ + columns.first;
  const auto pack = [&](double* to) {
    for (std::size_t i = 0; i < mine.count; ++i) {
      std::copy_n(from + i * plane_, columns.count, to + i * columns.count);
    }
  };
  if (!leads()) {
    if (mine.count == 0) {
      return {};
    }
    std::span<const double> all(from, mine.count * plane_);
    std::vector<double> packed;
    if (columns.count != plane_) {
      packed.resize(mine.count * columns.count);
      pack(packed.data());
      all = packed;
    }
    ranks_.exchange(std::array{Communicator::Outgoing{0, all}}, {});
    return {};
  }
  std::vector<double> box(planes.count * columns.count);
  if (mine.count > 0) {
    pack(box.data() + place_of(mine.first));
  }
  std::vector<Communicator::Incoming> in;
  for (int rank = 1; rank < ranks_.size(); ++rank) {
    if (const Range theirs = planes_of_rank(rank); theirs.count > 0) {
      in.push_back({rank, std::span(box).subspan(place_of(theirs.first), theirs.count * columns.count)});
    }
  }
  ranks_.exchange({}, in);
  return box;
}

void Slab::exchange_all(const std::vector<std::vector<double>>& out, std::vector<std::vector<double>>& in) const {
  std::vector<Communicator::Outgoing> outgoing;
  std::vector<Communicator::Incoming> incoming;
  for (int rank = 0; rank < ranks_.size(); ++rank) {
    const auto r = static_cast<std::size_t>(rank);
    if (rank == ranks_.rank()) {
      std::ranges::copy(out[r], in[r].begin());
      continue;
    }
    if (!out[r].empty()) {
      outgoing.push_back({rank, out[r]});
    }
    if (!in[r].empty()) {
      incoming.push_back({rank, in[r]});
    }
  }
  ranks_.exchange(outgoing, incoming);
}

void Slab::pass_on(std::span<const double> out, std::span<double> in) const {
  const int size = ranks_.size(), mine = ranks_.rank();
  if (size == 1) {
    std::ranges::copy(out, in.begin());
    return;
  }
  ranks_.exchange(std::array{Communicator::Outgoing{(mine + 1) % size, out}},
                  std::array{Communicator::Incoming{(mine + size - 1) % size, in}});
}

void Slab::in_turn(std::span<double> numbers, const std::function<void()>& add) const {
  pass_along(numbers, add);
  broadcast(numbers, ranks_.size() - 1);
}

void Slab::pass_along(std::span<double> numbers, const std::function<void()>& add) const {
  const int last = ranks_.size() - 1, mine = ranks_.rank();
  if (mine > 0) {
    ranks_.exchange({}, std::array{Communicator::Incoming{mine - 1, numbers}});
  }
  add();
  if (mine < last) {
    ranks_.exchange(std::array{Communicator::Outgoing{mine + 1, numbers}}, {});
  }
}

double Slab::sum_over_ranks(double here) const {
  CompensatedSum sum(here);
  reduce(std::span(&sum, 1), std::span(&here, 1), {});
  return here;
}

double Slab::largest_over_ranks(double here) const {
  reduce({}, {}, std::span(&here, 1));
  return here;
}

std::vector<double> Slab::collected(std::span<const double> few) const {
  if (!leads()) {
    ranks_.exchange(std::array{Communicator::Outgoing{0, few}}, {});
    return {};
  }
  std::vector<double> all(few.size() * static_cast<std::size_t>(ranks_.size()));
  std::ranges::copy(few, all.begin());
  std::vector<Communicator::Incoming> in;
  for (int rank = 1; rank < ranks_.size(); ++rank) {
    in.push_back({rank, std::span(all).subspan(static_cast<std::size_t>(rank) * few.size(), few.size())});
  }
  ranks_.exchange({}, in);
  return all;
}

/// A binomial tree: what a rank gets by the lowest bit of its place, it hands on by every lower one.
void Slab::broadcast(std::span<double> values, int root) const {
  const int size = ranks_.size(), place = (ranks_.rank() - root + size) % size;
  const auto rank_at = [&](int other) { return (other + root) % size; };
  int bit = 1;
  while (bit < size && (place & bit) == 0) {
    bit *= 2;
  }
  if (place != 0) {
    ranks_.exchange({}, std::array{Communicator::Incoming{rank_at(place - bit), values}});
  }
  std::vector<Communicator::Outgoing> out;
  for (bit /= 2; bit > 0; bit /= 2) {
    if (place + bit < size) {
      out.push_back({rank_at(place + bit), values});
    }
  }
  ranks_.exchange(out, {});
}

/// The tree of broadcast(), from its leaves to rank 0 and back; there the sums are numbers that all ranks need.
void Slab::reduce(std::span<CompensatedSum> sums, std::span<double> totals, std::span<double> largest) const {
  const std::size_t numbers = 2 * sums.size();
  sums_.resize(numbers + largest.size());
  const int size = ranks_.size(), mine = ranks_.rank();
  int bit = 1;
  for (; bit < size && (mine & bit) == 0; bit *= 2) {
    if (mine + bit >= size) {
      continue;
    }
    ranks_.exchange({}, std::array{Communicator::Incoming{mine + bit, sums_}});
    for (std::size_t row = 0; row < sums.size(); ++row) {
      sums[row].add(CompensatedSum(sums_[2 * row], sums_[2 * row + 1]));
    }
    for (std::size_t i = 0; i < largest.size(); ++i) {
      const double other = sums_[numbers + i];
      largest[i] = largest[i] != largest[i] || largest[i] > other ? largest[i] : other;
    }
  }
  if (mine != 0) {
    for (std::size_t row = 0; row < sums.size(); ++row) {
      sums_[2 * row] = sums[row].high;
      sums_[2 * row + 1] = sums[row].low;
    }
    std::ranges::copy(largest, sums_.begin() + static_cast<std::ptrdiff_t>(numbers));
    ranks_.exchange(std::array{Communicator::Outgoing{mine - bit, sums_}}, {});
  }
  sums_.resize(totals.size() + largest.size());
  const auto results = std::span(sums_);
  if (mine == 0) {
    std::ranges::transform(sums, sums_.begin(), [](const CompensatedSum& sum) { return sum.value(); });
    std::ranges::copy(largest, results.subspan(totals.size()).begin());
  }
  broadcast(results);
  std::ranges::copy(results.first(totals.size()), totals.begin());
  std::ranges::copy(results.subspan(totals.size()), largest.begin());
}

Spread Slab::magnitudes(std::span<const double> values) const {
  Spread spread;
  for (std::size_t begin = 0; begin < values.size(); begin += size()) {
    gather(values.subspan(begin, size()), [&](std::span<const double> planes) {
      for (const double value : planes) {
        spread.add(std::isfinite(value) ? std::abs(value) : value);
      }
    });
  }
  Spread::visit(spread, [this](double& member) { broadcast(std::span(&member, 1)); });
  return spread;
}

void refresh_ghosts(FieldSet& fields, std::span<const int> which, std::size_t outer) {
  if (const Slab* const slab = Slab::of(fields.size())) {
    slab->refresh(fields, which, outer);
  }
}

void refresh_ghosts(FieldSet& fields, std::span<const int> which) {
  if (const Slab* const slab = Slab::of(fields.size())) {
    slab->refresh(fields, which);
  }
}

void refresh_ghosts(FieldSet& fields) {
  if (const Slab* const slab = Slab::of(fields.size())) {
    slab->refresh(fields);
  }
}

namespace {

std::vector<int> all_of(const FieldSet& fields) {
  std::vector<int> which(static_cast<std::size_t>(fields.fields()));
  std::iota(which.begin(), which.end(), 0);
  return which;
}

}  // namespace

void save_whole(StateWriter& state, const FieldSet& fields) {
  save_whole(state, fields, all_of(fields));
}

void restore_whole(StateReader& state, FieldSet& fields) {
  restore_whole(state, fields, all_of(fields));
}

void save_whole(StateWriter& state, const FieldSet& fields, std::span<const int> which) {
  const Slab* const slab = Slab::of(fields.size());
  for (const int f : which) {
    if (slab == nullptr) {
      state.write(fields.field(f));
    } else if (state.reader() == StateWriter::For::going_back) {
      state.write_part(fields.field(f), slab->whole().size());
    } else {
      save_in_parts(state, *slab, fields.field(f));
    }
  }
}

void restore_whole(StateReader& state, FieldSet& fields, std::span<const int> which) {
  const Slab* const slab = Slab::of(fields.size());
  if (slab == nullptr || state.reader() == StateWriter::For::going_back) {
    for (const int f : which) {
      state.read(fields.field(f));
    }
    return;
  }
  for (const int f : which) {
    restore_in_parts(state, *slab, slab->whole().size(), fields.field(f));
  }
  slab->refresh(fields, which);
}

}  // namespace rubato::grids
