#include <rubato/pde/level_history.hpp>

#include <algorithm>
#include <stdexcept>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/wave_loops.hpp>

namespace rubato {

namespace {

/// to = keep to + Σ_s w_s from_s, at these nodes.
RUBATO_WIDE_VECTORS void add_weighted_rates(const double* w, const double* const* from, double keep, std::size_t begin,
                                            std::size_t end, double* to) {
  const double w_0 = w[0], w_1 = w[1], w_2 = w[2], w_3 = w[3];
  const double *const z_0 = from[0], *const z_1 = from[1], *const z_2 = from[2], *const z_3 = from[3];
#pragma GCC ivdep
  for (std::size_t i = begin; i < end; ++i) {
    to[i] = keep * to[i] + ((w_0 * z_0[i] + w_1 * z_1[i]) + (w_2 * z_2[i] + w_3 * z_3[i]));
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
  for (Sample& sample : samples_) {
    sample.time = 0.0;
    sample.rate.fill(0.0);
  }
}

void LevelHistory::record(double time, double h, const grids::FieldSet& delta) {
  std::rotate(samples_.begin(), samples_.end() - 1, samples_.end());
  Sample& sample = samples_.front();
  sample.time = time;
  for (int f = 0; f < delta.fields(); ++f) {
    const double factor = at_midpoints_[static_cast<std::size_t>(f)] ? 0.5 : 1.0 / h;
    const double* in = delta.field(f).data();
    double* out = sample.rate.field(f).data();
    grids::for_each_block(delta.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
      multiply(factor, in + begin, end - begin, out + begin);
    });
  }
  known_ = std::min(known_ + 1, most);
}

void LevelHistory::advance(double h) {
  for (Sample& sample : samples_) {
    sample.time -= h;
  }
}

LevelHistory::Weights LevelHistory::weights(double time) const {
  Weights result{};
  for (std::size_t i = 0; i < known_; ++i) {
    result[i] = 1.0;
    for (std::size_t j = 0; j < known_; ++j) {
      if (j != i) {
        result[i] *= (time - samples_[j].time) / (samples_[i].time - samples_[j].time);
      }
    }
  }
  return result;
}

void LevelHistory::combine(const Weights& evolving, const Weights& midpoint, double keep, grids::FieldSet& out) const {
  for (int f = 0; f < out.fields(); ++f) {
    const Weights w = at_midpoints_[static_cast<std::size_t>(f)] ? midpoint : evolving;
    double* to = out.field(f).data();
    std::array<const double*, most> from;
    for (std::size_t s = 0; s < most; ++s) {
      from[s] = samples_[s].rate.field(f).data();
    }
    static_assert(most == 4);
    grids::for_each_block(out.size(), grids::nodes_per_block, [&](std::size_t begin, std::size_t end) {
      add_weighted_rates(w.data(), from.data(), keep, begin, end, to);
    });
  }
}

void LevelHistory::predict(double h, grids::FieldSet& delta) const {
  Weights evolving = weights(0.5 * h);
  Weights midpoint = evolving;
  for (std::size_t i = 0; i < most; ++i) {
    evolving[i] *= h;
    midpoint[i] *= 2.0;
  }
  combine(evolving, midpoint, 0.0, delta);
}

void LevelHistory::shift(double from, double h, grids::FieldSet& delta) const {
  const Weights old_weights = weights(0.5 * from);
  Weights evolving = weights(0.5 * h);
  Weights midpoint = evolving;
  for (std::size_t i = 0; i < most; ++i) {
    evolving[i] = h * evolving[i] - from * old_weights[i];
    midpoint[i] = 2.0 * (midpoint[i] - old_weights[i]);
  }
  combine(evolving, midpoint, 1.0, delta);
}

void LevelHistory::velocity(grids::FieldSet& rate) const {
  combine(weights(0.0), {}, 0.0, rate);
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
