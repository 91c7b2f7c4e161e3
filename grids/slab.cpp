#include <rubato/grids/slab.hpp>

#include <algorithm>
#include <cmath>
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
Grid part_of(const Grid& whole, const Communicator& ranks, std::size_t first, std::size_t count, std::size_t ghosts) {
  const std::size_t planes = planes_of(whole);
  if (static_cast<std::size_t>(ranks.size()) > planes) {
    throw std::invalid_argument(
        fmt::format("{} ranks cannot share a lattice of {} planes across {}: there has to be one for each; start fewer",
                    ranks.size(), planes, whole.axes().back().name));
  }
  std::vector<Axis> axes = whole.axes();
  axes.back().of = planes;
  // The first plane is a ghost, beyond the lattice's own first one at rank 0.
  axes.back().first = (first + planes * (1 + ghosts / planes) - ghosts) % planes;
  axes.back().cells = count + 2 * ghosts;
  return Grid(std::move(axes));
}

std::size_t first_of(const Grid& whole, const Communicator& ranks, int rank) {
  const std::size_t planes = planes_of(whole), size = static_cast<std::size_t>(ranks.size()),
                    r = static_cast<std::size_t>(rank);
  return planes / size * r + std::min(r, planes % size);
}

}  // namespace

Slab::Slab(Communicator& ranks, const Grid& whole, std::size_t ghosts)
    : ranks_(ranks),
      whole_(whole),
      ghosts_(ghosts),
      plane_(whole.size() / planes_of(whole)),
      grid_(part_of(whole, ranks, first_of(whole, ranks, ranks.rank()),
                    first_of(whole, ranks, ranks.rank() + 1) - first_of(whole, ranks, ranks.rank()), ghosts)),
      send_(static_cast<std::size_t>(ranks.size())),
      receive_(send_.size()),
      out_(send_.size()),
      in_(send_.size()) {
  const int mine = ranks.rank();
  for (int rank = 0; rank < ranks.size(); ++rank) {
    const std::vector<std::size_t> wanted = ghost_planes(rank);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const int from = owner(wanted[i]);
      if (from == mine) {
        send_[static_cast<std::size_t>(rank)].push_back(ghosts_ + wanted[i] - first_plane(mine));
      }
      if (rank == mine) {
        // The first half are those before what is owned.
        const std::size_t place = i < ghosts_ ? i : planes(mine) + i;
        receive_[static_cast<std::size_t>(from)].push_back(place);
      }
    }
  }
}

std::size_t Slab::first_plane(int rank) const {
  return first_of(whole_, ranks_, rank);
}

int Slab::owner(std::size_t plane) const {
  int rank = 0;
  while (first_plane(rank + 1) <= plane) {
    ++rank;
  }
  return rank;
}

std::vector<std::size_t> Slab::ghost_planes(int rank) const {
  const std::size_t all = planes_of(whole_), around = all * (1 + ghosts_ / all);
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < ghosts_; ++i) {
    result.push_back((first_plane(rank) + around - ghosts_ + i) % all);
  }
  for (std::size_t i = 0; i < ghosts_; ++i) {
    result.push_back((first_plane(rank + 1) + i) % all);
  }
  return result;
}

void Slab::refresh(FieldSet& fields) const {
  const auto copy = [&](const std::vector<std::size_t>& planes, std::vector<double>& buffer, bool into_buffer) {
    buffer.resize(planes.size() * plane_ * static_cast<std::size_t>(fields.fields()));
    double* at = buffer.data();
    for (int f = 0; f < fields.fields(); ++f) {
      for (const std::size_t plane : planes) {
        double* const values = fields.field(f).data() + plane * plane_;
        into_buffer ? std::copy_n(values, plane_, at) : std::copy_n(at, plane_, values);
        at += plane_;
      }
    }
  };
  std::vector<Communicator::Outgoing> out;
  std::vector<Communicator::Incoming> in;
  const auto mine = static_cast<std::size_t>(ranks_.rank());
  for (std::size_t rank = 0; rank < send_.size(); ++rank) {
    copy(send_[rank], out_[rank], true);
    if (rank == mine) {
      copy(receive_[rank], out_[rank], false);  // a part so thin, or so few ranks, that it is its own neighbour
      continue;
    }
    if (!send_[rank].empty()) {
      out.push_back({static_cast<int>(rank), out_[rank]});
    }
    if (!receive_[rank].empty()) {
      in_[rank].resize(receive_[rank].size() * plane_ * static_cast<std::size_t>(fields.fields()));
      in.push_back({static_cast<int>(rank), in_[rank]});
    }
  }
  ranks_.exchange(out, in);
  for (std::size_t rank = 0; rank < send_.size(); ++rank) {
    if (rank != mine) {
      copy(receive_[rank], in_[rank], false);
    }
  }
}

void Slab::take_part(std::span<const double> whole, std::span<double> part) const {
  const Axis& axis = grid_.axes().back();
  for (std::size_t plane = 0; plane < axis.cells; ++plane) {
    std::copy_n(whole.data() + (axis.first + plane) % axis.of * plane_, plane_, part.data() + plane * plane_);
  }
}

std::vector<double> Slab::gathered(std::span<const double> part) const {
  const std::span<const double> mine = part.subspan(first_node(), owned());
  if (!leads()) {
    ranks_.exchange(std::array{Communicator::Outgoing{0, mine}}, {});
    return {};
  }
  std::vector<double> whole(whole_.size());
  std::ranges::copy(mine, whole.begin());
  std::vector<Communicator::Incoming> in;
  for (int rank = 1; rank < ranks_.size(); ++rank) {
    in.push_back({rank, std::span(whole).subspan(first_plane(rank) * plane_, planes(rank) * plane_)});
  }
  ranks_.exchange({}, in);
  return whole;
}

void Slab::broadcast(std::span<double> values) const {
  if (!leads()) {
    ranks_.exchange({}, std::array{Communicator::Incoming{0, values}});
    return;
  }
  std::vector<Communicator::Outgoing> out;
  for (int rank = 1; rank < ranks_.size(); ++rank) {
    out.push_back({rank, values});
  }
  ranks_.exchange(out, {});
}

/// Blocks are numbers 0, 1, … of values 0, …, count - 1 of the whole: m arrays of all nodes one after the other, of
/// each of which this rank owns a stretch. What a stretch has of a block that began before it follows when the partial
/// sums have come from the rank that had the value before. Every rank goes through its stretches in ascending order, so
/// that none waits for itself.
CompensatedSum Slab::sum(std::size_t count, AddPiece add, const void* function) const {
  const std::size_t nodes = whole_.size(), arrays = count / size(), total = arrays * nodes;
  const ReductionBlocks pieces(total);
  const int size = ranks_.size(), mine = ranks_.rank();
  const int before = (mine + size - 1) % size, after = (mine + 1) % size;
  const auto end_of = [&](std::size_t b) { return std::min((b + 1) * pieces.block, total); };

  std::array<double, 16> carried{};
  const auto send = [&](const LaneSums& sums) {
    std::ranges::copy(sums.high, carried.begin());
    std::ranges::copy(sums.low, carried.begin() + 8);
    ranks_.exchange(std::array{Communicator::Outgoing{after, carried}}, {});
  };
  const auto receive = [&] {
    ranks_.exchange({}, std::array{Communicator::Incoming{before, carried}});
    LaneSums sums;
    std::copy_n(carried.begin(), 8, sums.high.begin());
    std::copy_n(carried.begin() + 8, 8, sums.low.begin());
    return sums;
  };

  std::vector<double> finished;  // two numbers for each block that ends here
  LaneSums local;                // handed over without a message, where there is one rank
  const auto finish = [&](std::size_t b, std::size_t high_end, const LaneSums& sums, std::vector<double>& into) {
    if (high_end != end_of(b)) {
      size == 1 ? static_cast<void>(local = sums) : send(sums);
      return;
    }
    CompensatedSum part;
    for (std::size_t l = 0; l < sums.high.size(); ++l) {
      part.add(sums.high[l]);
      part.low += sums.low[l];
    }
    into.insert(into.end(), {part.high, part.low});
  };
  for (std::size_t array = 0; array < arrays; ++array) {
    const std::size_t begin = array * nodes + first_plane(mine) * plane_, end = begin + owned();
    const std::size_t shift = array * this->size() + first_node();  // of `begin`, in the part
    std::vector<double> here;
    std::size_t first = begin / pieces.block;
    const bool continues = begin != first * pieces.block;
    for (std::size_t b = first + (continues ? 1 : 0); b * pieces.block < end; ++b) {
      LaneSums sums;
      const std::size_t from = b * pieces.block, to = std::min(end_of(b), end);
      add(function, sums, 0, shift + (from - begin), shift + (to - begin));
      finish(b, to, sums, here);
    }
    if (continues) {
      LaneSums sums = size == 1 ? local : receive();
      const std::size_t to = std::min(end_of(first), end);
      add(function, sums, begin - first * pieces.block, shift, shift + (to - begin));
      finish(first, to, sums, finished);
    }
    finished.insert(finished.end(), here.begin(), here.end());
  }

  // The blocks in their order, at rank 0: each ended where its last value is.
  CompensatedSum result;
  if (leads()) {
    std::vector<std::vector<double>> all(static_cast<std::size_t>(size));
    const auto owner_of_end = [&](std::size_t b) {
      return static_cast<std::size_t>(owner((end_of(b) - 1) % nodes / plane_));
    };
    std::vector<std::size_t> counts(all.size(), 0);
    for (std::size_t b = 0; b < pieces.blocks; ++b) {
      ++counts[owner_of_end(b)];
    }
    std::vector<Communicator::Incoming> in;
    for (std::size_t rank = 1; rank < all.size(); ++rank) {
      all[rank].resize(2 * counts[rank]);
      if (counts[rank] > 0) {
        in.push_back({static_cast<int>(rank), all[rank]});
      }
    }
    ranks_.exchange({}, in);
    all[0] = std::move(finished);
    std::vector<std::size_t> taken(all.size(), 0);
    for (std::size_t b = 0; b < pieces.blocks; ++b) {
      const std::size_t rank = owner_of_end(b), at = 2 * taken[rank]++;
      result.add(all[rank][at]);
      result.low += all[rank][at + 1];
    }
  } else if (!finished.empty()) {
    ranks_.exchange(std::array{Communicator::Outgoing{0, finished}}, {});
  }
  std::array<double, 2> both = {result.high, result.low};
  broadcast(both);
  return CompensatedSum(both[0], both[1]);
}

double Slab::largest(double here) const {
  if (!leads()) {
    ranks_.exchange(std::array{Communicator::Outgoing{0, std::span<const double>(&here, 1)}}, {});
  } else {
    std::vector<double> others(static_cast<std::size_t>(ranks_.size() - 1));
    std::vector<Communicator::Incoming> in;
    for (std::size_t i = 0; i < others.size(); ++i) {
      in.push_back({static_cast<int>(i) + 1, std::span(others).subspan(i, 1)});
    }
    ranks_.exchange({}, in);
    for (const double other : others) {
      here = here != here || here > other ? here : other;
    }
  }
  broadcast(std::span(&here, 1));
  return here;
}

Spread Slab::magnitudes(std::span<const double> values) const {
  Spread spread;
  for (std::size_t begin = 0; begin < values.size(); begin += size()) {
    for (const double value : gathered(values.subspan(begin, size()))) {
      spread.add(std::isfinite(value) ? std::abs(value) : value);
    }
  }
  Spread::visit(spread, [this](double& member) { broadcast(std::span(&member, 1)); });
  return spread;
}

void refresh_ghosts(FieldSet& fields) {
  if (const Slab* const slab = Slab::of(fields.size())) {
    slab->refresh(fields);
  }
}

void save_whole(StateWriter& state, const FieldSet& fields) {
  const Slab* const slab = Slab::of(fields.size());
  if (slab == nullptr) {
    state.write(fields.all());
    return;
  }
  for (int f = 0; f < fields.fields(); ++f) {
    state.write(slab->gathered(fields.field(f)));
  }
}

void restore_whole(StateReader& state, FieldSet& fields) {
  const Slab* const slab = Slab::of(fields.size());
  if (slab == nullptr) {
    state.read(fields.all());
    return;
  }
  std::vector<double> whole(slab->whole().size());
  for (int f = 0; f < fields.fields(); ++f) {
    state.read(std::span(whole));
    slab->take_part(whole, fields.field(f));
  }
}

}  // namespace rubato::grids
