#include <rubato/variation/level_forecasts.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numbers>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/variation/power_of.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning;
constexpr double two_pi = 2.0 * std::numbers::pi;

constexpr std::size_t wide = 8;
using V [[gnu::vector_size(64)]] = double;
using Mask [[gnu::vector_size(64)]] = std::int64_t;

/// Forecasts side by side; of a mask each number is 0 or -1.
struct Block {
  // Of the job.
  V strength, per_length, slope_of_one, side, exponent, factor, turn, in_turn, limit;
  Mask one_less;  ///< than the exponent, if that is whole
  Mask broken;    ///< if it is not
  // Of what was foreseen so far.
  V h, last, time, here, defect, first_defect, steps, shortest, longest, potential, energy;
  Mask countdown, live;
  // Of the stride, which is a step or many that are alike, and what it set out from.
  V stride, time_before, here_before, defect_before, steps_before, of_order_before;
  V between;  ///< a half of what of it is neither the first step nor the last
  // The piece of η that the time is in, how long strides are there, and the doubt.
  V end, begin, per_piece, eta, rise, bend, twist, alike, doubt;
  std::array<std::size_t, wide> at;  ///< its number
  Mask solved, odd;
  int lanes;  ///< that are live: a block without any stands still
};

/// A piece of η, and how long strides are in it: as many numbers as there are lanes.
struct Strides {
  double end, begin, per_length, eta, rise, bend, twist, alike;
};
static_assert(sizeof(Strides) == sizeof(V));

/// So many blocks that one goes on while another waits for a division.
constexpr std::size_t blocks = 2;
constexpr std::size_t width = blocks * wide;

struct Lanes {
  std::array<Block, blocks> block{};
  int bits = 0;  ///< of the largest whole exponent, less one
  bool any_broken = false;
};

[[gnu::always_inline]] inline bool any(const Mask& mask) {
  std::int64_t all = 0;
  for (std::size_t i = 0; i < wide; ++i) {
    all |= mask[i];
  }
  return all != 0;
}

/// power = (h/length)^p and less = (h/length)^(p-1).
[[gnu::always_inline]] inline void raise(const Block& block, const Lanes& lanes, V& power, V& less) {
  const V one = V{} + 1.0, x = block.h * block.per_length;
  V square = x;
  less = one;
  for (int bit = 0; bit < lanes.bits; ++bit) {
    const std::int64_t this_bit = std::int64_t{1} << bit;
    less *= (block.one_less & this_bit) != 0 ? square : one;
    square *= square;
  }
  if (lanes.any_broken) {
    for (std::size_t i = 0; i < wide; ++i) {
      less[i] = block.broken[i] != 0 ? std::pow(x[i], block.exponent[i] - 1.0) : less[i];
    }
  }
  power = less * x;
}

/// h^n.
[[gnu::always_inline]] inline void raise_whole(const V& h, int n, V& power) {
  V square = h;
  for (power = V{} + 1.0; n > 0; n /= 2, square *= square) {
    if (n % 2 != 0) {
      power *= square;
    }
  }
}

/// |x|, in its place.
[[gnu::always_inline]] inline void make_positive(V& x) {
  x = x < 0.0 ? -x : x;
}

[[gnu::always_inline]] inline void make_least(const V& x, V& least) {
  least = x < least ? x : least;
}

/// Newton's iteration from the last step, on the branch where the energy grows to the side of the potential.
RUBATO_WIDE_VECTORS void solve(Lanes& lanes, int s, double resolved) {
  const double one_more = s + 1.0, both = s * (s + 1.0);
  std::array<Mask, blocks> going;
  for (std::size_t k = 0; k < blocks; ++k) {
    Block& block = lanes.block[k];
    block.last = block.h;
    block.solved = Mask{};
    going[k] = block.live;
  }
  std::array<bool, blocks> waits;
  for (std::size_t k = 0; k < blocks; ++k) {
    waits[k] = lanes.block[k].lanes > 0;
  }
  for (int iteration = 0; iteration < 20; ++iteration) {
    Mask still{};
    for (std::size_t k = 0; k < blocks; ++k) {
      if (!waits[k]) {
        continue;
      }
      Block& block = lanes.block[k];
      V power, less, of_order;
      raise(block, lanes, power, less);
      raise_whole(block.h, s - 1, of_order);
      const V h = block.h;
      const V miss = one_more * of_order * h * block.here + block.strength * power - block.defect;
      const V slope = both * of_order * block.here + block.slope_of_one * less;
      const V moved = h - miss / slope, low = 0.5 * h, high = 2.0 * h;
      const V bounded = moved < low ? low : (high < moved ? high : moved);
      const Mask goes = going[k] & (slope * block.side * h > resolved);
      V change = bounded - h;
      make_positive(change);
      const Mask ends = goes & (change < last_forecast_move * h);  // the next would be about the square
      block.h = goes != 0 ? bounded : h;
      block.solved |= ends;
      going[k] = goes & ~ends;
      waits[k] = any(going[k]);
      still |= going[k];
    }
    if (!any(still)) {
      return;
    }
  }
}

/// Which lanes have something unusual about their new step. \return whether any has
RUBATO_WIDE_VECTORS bool judge(Lanes& lanes, double most) {
  // ln 0.82 = -0.198, ln 1.22 = 0.199
  static_assert(believed_change == 0.2);
  Mask all{};
  for (Block& block : lanes.block) {
    block.countdown -= 1;
    // One comparison: GCC 12 does several that are joined one number after the other.
    const V longer = block.stride - block.last;
    V room = block.h - (longer > 0.0 ? V{} + (1.0 - alike_change) : V{} + 0.82) * block.last;
    make_least((longer > 0.0 ? V{} + (1.0 + alike_change) : V{} + 1.22) * block.last - block.h, room);
    make_least(most - block.steps, room);
    make_least(block.limit - block.potential, room);
    const Mask sound = block.countdown != 0 ? block.solved : Mask{};
    block.odd = room > 0.0 ? block.live & ~sound : block.live;
    all |= block.odd;
  }
  return any(all);
}

/// All to the ends of their strides. \return whether any leaves its piece of η
RUBATO_WIDE_VECTORS bool move(Lanes& lanes) {
  Mask leave{};
  for (Block& block : lanes.block) {
    block.time_before = block.time;
    block.stride = block.h < block.alike ? block.alike : block.h;
    block.time += block.stride;
    leave |= block.live & (block.end < block.time);
  }
  return any(leave);
}

/// What the steps make of the rest. \return whether any is at the end
RUBATO_WIDE_VECTORS bool take(Lanes& lanes, int s, double end) {
  Mask ended{};
  for (Block& block : lanes.block) {
    if (block.lanes == 0) {
      continue;
    }
    const V part = (block.time - block.begin) * block.per_piece;
    const V seen = block.eta + part * (block.rise + (1.0 - part) * ((1.0 - part) * block.bend + part * block.twist));
    const V there = block.doubt * seen;
    V power, less, of_order;
    raise(block, lanes, power, less);
    raise_whole(block.h, s, of_order);
    // Of n steps that change evenly D += h^s Δη makes, beyond that of n like the first, (1 - 1/n)/2 of how h^s changed.
    const V in_stride = block.h / block.stride;
    block.defect += block.between * (of_order - block.of_order_before) * (block.here - block.here_before);
    block.between = 0.5 * (1.0 - in_stride);
    block.of_order_before = of_order;
    block.defect_before = block.defect;
    block.here_before = block.here;
    block.steps_before = block.steps;
    block.defect += of_order * (there - block.here);
    block.here = there;
    block.steps += block.stride / block.h;
    V potential = block.strength * power, energy = block.defect - block.first_defect;
    make_positive(potential);
    make_positive(energy);
    block.potential = block.potential < potential ? potential : block.potential;
    block.energy = block.energy < energy ? energy : block.energy;
    block.shortest = block.h < block.shortest ? block.h : block.shortest;
    block.longest = block.longest < block.h ? block.h : block.longest;
    ended |= block.live & ~(block.time < end);  // no >=, as above
  }
  return any(ended);
}

/// Rows of eight to columns of eight, in place.
[[gnu::always_inline]] inline void transpose(std::array<V, wide>& rows) {
  const auto exchange = [&rows](std::size_t half, const Mask& from_low, const Mask& from_high) {
#pragma GCC unroll 8
    for (std::size_t i = 0; i < wide; ++i) {
      if ((i & half) == 0) {
        const V low = rows[i], high = rows[i + half];
        rows[i] = __builtin_shuffle(low, high, from_low);
        rows[i + half] = __builtin_shuffle(low, high, from_high);
      }
    }
  };
  exchange(1, Mask{0, 8, 2, 10, 4, 12, 6, 14}, Mask{1, 9, 3, 11, 5, 13, 7, 15});
  exchange(2, Mask{0, 1, 8, 9, 4, 5, 12, 13}, Mask{2, 3, 10, 11, 6, 7, 14, 15});
  exchange(4, Mask{0, 1, 2, 3, 8, 9, 10, 11}, Mask{4, 5, 6, 7, 12, 13, 14, 15});
}

/// Each lane in the piece whose number it has.
RUBATO_WIDE_VECTORS void stand_in(const Strides* pieces, Block& block) {
  std::array<V, wide> rows;
#pragma GCC unroll 8
  for (std::size_t i = 0; i < wide; ++i) {
    std::memcpy(&rows[i], pieces + block.at[i], sizeof(V));
  }
  transpose(rows);
  block.end = rows[0];
  block.begin = rows[1];
  block.per_piece = rows[2];
  block.eta = rows[3];
  block.rise = rows[4];
  block.bend = rows[5];
  block.twist = rows[6];
  block.alike = rows[7] < block.in_turn ? rows[7] : block.in_turn;
}

class Forecasts {
public:
  Forecasts(const Scouting& scouting, const EtaPieces& pieces, ForecastQueue& queue)
      : scouting_(scouting),
        first_(pieces.pieces().front()),
        queue_(queue),
        period_(queue.period() > 0 ? static_cast<std::int64_t>(queue.period()) : std::int64_t{1} << 60) {
    pieces_.reserve(pieces.pieces().size());
    for (const EtaPieces::Piece& piece : pieces.pieces()) {
      pieces_.push_back({.end = piece.end,
                         .begin = piece.begin,
                         .per_length = 1.0 / piece.length,
                         .eta = piece.eta,
                         .rise = piece.rise,
                         .bend = piece.bend,
                         .twist = piece.twist,
                         .alike = (std::min(piece.end, scouting.duration) - piece.begin) / strides_in_piece});
    }
  }

  void operator()() {
    const double end = scouting_.duration, most = 20.0 * end / scouting_.step;
    const double resolved = scouting_.resolved_slope();
    load_all();
    while (live_ > 0) {
      bool has_room = false;
      solve(lanes_, scouting_.order, resolved);
      if (judge(lanes_, most)) {
        for (std::size_t l = 0; l < width; ++l) {
          if (const auto [block, i] = lane(l); block.odd[i] != 0 && !goes_on(l, most)) {
            finish(l, false);
            has_room = true;
          }
        }
      }
      if (move(lanes_)) {
        for (Block& block : lanes_.block) {
          find_pieces(block);
        }
      }
      for (std::size_t l = 0; l < width && any_turns_; ++l) {
        const auto [block, i] = lane(l);
        block.doubt[i] = doubt(l);
      }
      if (take(lanes_, scouting_.order, end)) {
        for (std::size_t l = 0; l < width; ++l) {
          const auto [block, i] = lane(l);
          if (block.live[i] != 0 && !(block.time[i] < end)) {
            finish(l, true);
            has_room = true;
          }
        }
      }
      if (has_room) {
        load_all();
      }
    }
  }

private:
  /// The next jobs that there are; without one a lane stands still.
  void load_all() {
    for (std::size_t l = 0; l < width; ++l) {
      const auto [block, i] = lane(l);
      if (block.live[i] == 0) {
        const std::optional<ForecastQueue::Next> next = queue_.next();
        if (!next) {
          return;
        }
        load(l, *next);
      }
    }
  }
  void load(std::size_t l, const ForecastQueue::Next& next) {
    const auto [block, i] = lane(l);
    const StepPotential& potential = next.job.potential;
    const EtaDoubt& job_doubt = next.job.doubt;
    const int whole = static_cast<int>(potential.exponent);
    const bool is_whole = whole == potential.exponent && whole > 0;
    block.strength[i] = potential.strength;
    block.per_length[i] = 1.0 / potential.length;
    block.exponent[i] = potential.exponent;
    block.slope_of_one[i] = potential.strength * potential.exponent / potential.length;
    block.side[i] = std::copysign(1.0, potential.strength);
    block.factor[i] = job_doubt.factor;
    block.turn[i] = job_doubt.turn;
    block.in_turn[i] =
        job_doubt.turn > 0.0 ? job_doubt.turn / strides_in_turn : std::numeric_limits<double>::infinity();
    block.limit[i] = std::nextafter(next.job.limit, std::numeric_limits<double>::infinity());
    block.one_less[i] = is_whole ? whole - 1 : 0;
    block.broken[i] = is_whole ? 0 : -1;
    lanes_.any_broken = lanes_.any_broken || !is_whole;
    for (; is_whole && ((whole - 1) >> lanes_.bits) > 0; ++lanes_.bits) {
    }
    const double h = scouting_.step;
    const double energy = potential.strength * (is_whole ? power_of(h / potential.length, whole)
                                                         : std::pow(h / potential.length, potential.exponent));
    block.h[i] = block.last[i] = block.shortest[i] = block.longest[i] = h;
    block.time[i] = 0.0;
    block.stride[i] = h;
    block.between[i] = 0.0;
    block.at[i] = 0;
    stand(block);
    any_turns_ = any_turns_ || job_doubt.turn > 0.0;
    block.doubt[i] = doubt(l);
    const double here = doubt(l) * first_(0.0);
    block.here[i] = here;
    block.defect[i] = block.first_defect[i] = (scouting_.order + 1.0) * power_of(h, scouting_.order) * here + energy;
    block.steps[i] = block.energy[i] = 0.0;
    block.potential[i] = std::abs(energy);
    block.countdown[i] = period_;
    block.live[i] = -1;
    block.lanes += 1;
    live_ += 1;
    job_[l] = next.number;
  }
  [[nodiscard]] double doubt(std::size_t l) {
    const auto [block, i] = lane(l);
    return block.turn[i] > 0.0 ? block.factor[i] * std::cos(two_pi * block.time[i] / block.turn[i]) : block.factor[i];
  }
  [[nodiscard]] LevelForecast so_far(std::size_t l) {
    const auto [block, i] = lane(l);
    return {.complete = true,
            .steps = block.steps[i],
            .shortest = block.shortest[i],
            .longest = block.longest[i],
            .energy = block.energy[i],
            .potential = block.potential[i]};
  }
  /// Of a lane with something unusual, whether there is no more to it than that, or that its steps were not alike.
  [[nodiscard]] bool goes_on(std::size_t l, double most) {
    const auto [block, i] = lane(l);
    if (block.stride[i] > block.last[i] &&
        !(block.solved[i] != 0 && std::abs(block.h[i] - block.last[i]) <= alike_change * block.last[i])) {
      go_back(l);
      return true;
    }
    bool goes = block.solved[i] != 0 && std::abs(std::log(block.h[i] / block.last[i])) <= believed_change &&
                block.steps[i] < most && block.potential[i] < block.limit[i];
    if (block.countdown[i] == 0) {
      block.countdown[i] = period_;
      goes = goes && !queue_.too_much(job_[l], so_far(l));
    }
    return goes;
  }
  /// To where the last stride set out from, which is a single step now.
  void go_back(std::size_t l) {
    const auto [block, i] = lane(l);
    block.h[i] = block.last[i];
    block.time[i] = block.time_before[i];
    block.defect[i] = block.defect_before[i];
    block.here[i] = block.here_before[i];
    block.steps[i] = block.steps_before[i];
    block.between[i] = 0.0;
    while (block.at[i] > 0 && pieces_[block.at[i] - 1].end >= block.time[i]) {
      --block.at[i];
    }
    stand(block);
    block.alike[i] = 0.0;
  }
  void finish(std::size_t l, bool complete) {
    const auto [block, i] = lane(l);
    LevelForecast result = so_far(l);
    result.complete = complete;
    if (complete) {
      // As many as the stretch needs, a part of the last one left out.
      result.steps -= (block.time[i] - scouting_.duration) / block.h[i];
    }
    block.live[i] = 0;
    block.lanes -= 1;
    live_ -= 1;
    queue_.finished(job_[l], result);
  }
  void find_pieces(Block& block) const {
    std::array<double, wide> time{};
    std::memcpy(time.data(), &block.time, sizeof(block.time));
    const Strides* const pieces = pieces_.data();
    bool any = true;
    for (int next = 0; next < 2 && any; ++next) {  // mostly, and then there is nothing to foresee for the processor
      any = false;
      for (std::size_t i = 0; i < wide; ++i) {
        const bool leaves = pieces[block.at[i]].end < time[i];
        block.at[i] += leaves ? 1 : 0;
        any = any || leaves;
      }
    }
    for (std::size_t i = 0; i < wide && any; ++i) {
      while (pieces[block.at[i]].end < time[i]) {
        ++block.at[i];
      }
    }
    stand(block);
  }
  void stand(Block& block) const { stand_in(pieces_.data(), block); }
  struct Lane {
    Block& block;
    std::size_t i;
  };
  [[nodiscard]] Lane lane(std::size_t l) { return {lanes_.block[l / wide], l % wide}; }

  const Scouting& scouting_;
  EtaPieces::Piece first_;
  std::vector<Strides> pieces_;
  ForecastQueue& queue_;
  std::int64_t period_;
  Lanes lanes_;
  std::array<std::size_t, width> job_{};
  int live_ = 0;
  bool any_turns_ = false;
};

}  // namespace

EtaPieces::EtaPieces(const Scouting& scouting) {
  const std::vector<double>&time = scouting.time, &eta = scouting.eta;
  const auto secant = [&](std::size_t i) { return (eta[i + 1] - eta[i]) / (time[i + 1] - time[i]); };
  // Of the parabola through a middle and its neighbours.
  const auto slope = [&](std::size_t i) {
    if (i == 0 || i + 1 == eta.size()) {
      return secant(i == 0 ? 0 : i - 1);
    }
    const double before = time[i] - time[i - 1], after = time[i + 1] - time[i];
    return (secant(i - 1) * after + secant(i) * before) / (before + after);
  };
  constexpr double infinite = std::numeric_limits<double>::infinity();
  const auto constant = [](double end, double value) {
    return Piece{.begin = 0.0, .end = end, .length = 1.0, .eta = value, .rise = 0.0, .bend = 0.0, .twist = 0.0};
  };
  pieces_.push_back(constant(time.front(), eta.front()));
  for (std::size_t i = 0; i + 1 < eta.size(); ++i) {
    const double length = time[i + 1] - time[i], rise = eta[i + 1] - eta[i];
    // At the last middle it is what it is after it.
    const double end = i + 2 < eta.size() ? time[i + 1] : std::nextafter(time[i + 1], -infinite);
    pieces_.push_back({.begin = time[i],
                       .end = end,
                       .length = length,
                       .eta = eta[i],
                       .rise = rise,
                       .bend = slope(i) * length - rise,
                       .twist = rise - slope(i + 1) * length});
  }
  pieces_.push_back(constant(infinite, eta.back()));
}

void forecast_side_by_side(const Scouting& scouting, const EtaPieces& pieces, ForecastQueue& queue) {
  Forecasts(scouting, pieces, queue)();
}

std::vector<LevelForecast> forecast_side_by_side(const Scouting& scouting, const EtaPieces& pieces,
                                                 std::span<const ForecastJob> jobs) {
  class All final : public ForecastQueue {
  public:
    explicit All(std::span<const ForecastJob> jobs) : results(jobs.size()), jobs_(jobs) {}
    std::optional<Next> next() override {
      return begun_ < jobs_.size() ? std::optional(Next{begun_, jobs_[begun_++]}) : std::nullopt;
    }
    void finished(std::size_t number, const LevelForecast& forecast) override { results[number] = forecast; }
    std::vector<LevelForecast> results;

  private:
    std::span<const ForecastJob> jobs_;
    std::size_t begun_ = 0;
  };
  All all(jobs);
  forecast_side_by_side(scouting, pieces, all);
  return std::move(all.results);
}

}  // namespace rubato
