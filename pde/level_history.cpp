#include <rubato/pde/level_history.hpp>

#include <algorithm>
#include <stdexcept>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/wave_loops.hpp>

namespace rubato {

namespace {

/// to = Σ_s w_s from_s, at these nodes.
RUBATO_WIDE_VECTORS void add_weighted_rates(const double* w, const double* const* from, std::size_t begin,
                                            std::size_t end, double* to) {
  const double w_0 = w[0], w_1 = w[1], w_2 = w[2], w_3 = w[3];
  const double *const z_0 = from[0], *const z_1 = from[1], *const z_2 = from[2], *const z_3 = from[3];
#pragma GCC ivdep
  for (std::size_t i = begin; i < end; ++i) {
    to[i] = (w_0 * z_0[i] + w_1 * z_1[i]) + (w_2 * z_2[i] + w_3 * z_3[i]);
  }
}

}  // namespace

LevelHistory::LevelHistory(std::vector<bool> at_midpoints, std::size_t nodes) : at_midpoints_(std::move(at_midpoints)) {
  for (Sample& sample : samples_) {
    sample.rate = grids::FieldSet(static_cast<int>(at_midpoints_.size()), nodes);
  }
}

void LevelHistory::forget() {
  known_ = 0;
}

void LevelHistory::record(double time, double h) {
  const auto place = samples_.begin() + static_cast<std::ptrdiff_t>(std::min(known_, most - 1));
  std::rotate(samples_.begin(), place, place + 1);
  Sample& sample = samples_.front();
  sample.time = time;
  for (int f = 0; f < sample.rate.fields(); ++f) {
    const double factor = at_midpoints_[static_cast<std::size_t>(f)] ? 0.5 : 1.0 / h;
    double* rate = sample.rate.field(f).data();
    grids::for_each_block(sample.rate.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
      multiply(factor, rate + begin, end - begin, rate + begin);
    });
  }
  known_ = std::min(known_ + 1, most);
}

void LevelHistory::advance(double h) {
  for (Sample& sample : samples_) {
    sample.time -= h;
  }
}

LevelHistory::Weights LevelHistory::weights(double time, std::size_t count) const {
  Weights result{};
  for (std::size_t i = 0; i < count; ++i) {
    result[i] = 1.0;
    for (std::size_t j = 0; j < count; ++j) {
      if (j != i) {
        result[i] *= (time - samples_[j].time) / (samples_[i].time - samples_[j].time);
      }
    }
  }
  return result;
}

void LevelHistory::combine(std::size_t count, const Weights& evolving, const Weights& midpoint,
                           grids::FieldSet& out) const {
  if (count == 0) {
    out.fill(0.0);
    return;
  }
  for (int f = 0; f < out.fields(); ++f) {
    const Weights w = at_midpoints_[static_cast<std::size_t>(f)] ? midpoint : evolving;
    double* to = out.field(f).data();
    std::array<const double*, most> from;
    for (std::size_t s = 0; s < most; ++s) {
      from[s] = samples_[s < count ? s : 0].rate.field(f).data();
    }
    static_assert(most == 4);
    grids::for_each_block(out.size(), grids::nodes_per_block, [&](std::size_t begin, std::size_t end) {
      add_weighted_rates(w.data(), from.data(), begin, end, to);
    });
  }
}

void LevelHistory::predict(double h) {
  Weights evolving = weights(0.5 * h, known_);
  Weights midpoint = evolving;
  for (std::size_t i = 0; i < most; ++i) {
    evolving[i] *= h;
    midpoint[i] *= 2.0;
  }
  combine(known_, evolving, midpoint, increment());
  known_ = std::min(known_, most - 1);
}

void LevelHistory::shift(double from, double h) {
  if (known_ > 0 && from * samples_[0].time > 0.0) {
    predict(h);  // it was a step back, through times of samples
    return;
  }
  const std::size_t place = known_;  // at most that of the last sample: a step has been predicted
  samples_[place].time = 0.5 * from;
  const Weights all = weights(0.5 * h, place + 1);
  Weights evolving = all, midpoint = all;
  for (std::size_t i = 0; i < place; ++i) {
    evolving[i] *= h;
    midpoint[i] *= 2.0;
  }
  evolving[place] *= h / from;
  combine(place + 1, evolving, midpoint, increment());
}

void LevelHistory::velocity(grids::FieldSet& rate) const {
  combine(known_, weights(0.0, known_), {}, rate);
}

void LevelHistory::save(StateWriter& state) const {
  state.write(static_cast<double>(known_));
  for (std::size_t i = 0; i < known_; ++i) {
    state.write(samples_[i].time);
    grids::save_whole(state, samples_[i].rate);
  }
}

void LevelHistory::restore(StateReader& state) {
  state.read(known_);
  if (known_ > samples_.size()) {
    throw std::invalid_argument("a saved state has more samples than there are");
  }
  for (std::size_t i = 0; i < known_; ++i) {
    state.read(samples_[i].time);
    grids::restore_whole(state, samples_[i].rate);
  }
}

}  // namespace rubato
