#include <rubato/pde/rest_forecast.hpp>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <rubato/pde/stage_loops.hpp>

namespace rubato {

RestForecast::RestForecast(const GaussTableau& tableau, int fields, std::size_t waves)
    : tableau_(tableau),
      m_(tableau.stages),
      fields_(fields),
      at_last_(static_cast<std::size_t>(m_)),
      past_(m_ == 1 ? StageForecast{}.past.size() : WaveForecast{}.past.size(), WaveRows(fields * m_, waves)) {
  if (m_ > 1) {
    foreseen_ = WaveRows(static_cast<int>(ways_onward) * fields, waves);
    off_ = grids::FieldSet(static_cast<int>(ways_onward) * fields, waves);
    seen_ = WaveRows(1, waves);
  }
  for (int i = 0; i < m_; ++i) {
    for (int j = 0; j < m_; ++j) {
      onward_.push_back(tableau.lagrange(j, 1.0 + tableau.c[i]));
    }
  }
}

void RestForecast::forget() {
  known_ = 0;
  judged_ = reported_ = false;
  last_h_ = 0.0;
  off_.fill(0.0);
}

void RestForecast::add(double h) {
  newest_ = place(past_.size() - 1);
  const WaveRows& rests = past_[newest_];
  if (std::exchange(reported_, false)) {
    for (int j = 0; j < m_; ++j) {
      at_last_[static_cast<std::size_t>(j)] = tableau_.lagrange(j, tableau_.c[m_ - 1] * (last_h_ / h));
    }
    for_each_wave_block(rests.waves(), [&](std::size_t begin, std::size_t end) {
      for (int f = 0; f < fields_; ++f) {
        const std::size_t count = end - begin;
        const Strided<double> seen = {seen_.re.all().data() + begin, seen_.im.all().data() + begin, rests.waves()};
        mix(1, m_, at_last_.data(), rows_from(rests, f * m_, begin), count, seen);
        for (std::size_t way = 0; way < ways_onward; ++way) {
          const int row = row_of(way, f);
          measure_distance({seen.re, seen.im, seen.stride}, rows_from(std::as_const(foreseen_), row, begin), count,
                           off_.field(row).data() + begin);
        }
      }
    });
    judged_ = known_ > 1;
  }
  known_ = std::min(known_ + 1, static_cast<int>(past_.size()));
  last_h_ = h;
}

template <typename Past>
void RestForecast::take_past(int field, std::size_t begin, Past& past) const {
  for (std::size_t back = 0; back < static_cast<std::size_t>(known_); ++back) {
    past.at(back) = rows_from(past_[place(back)], field * m_, begin);
  }
}

void RestForecast::foresee(WaveRows& rests) {
  for_each_wave_block(rests.waves(), [&](std::size_t begin, std::size_t end) {
    for (int f = 0; f < fields_; ++f) {
      const Strided<double> stages = rows_from(rests, f * m_, begin);
      if (m_ == 1) {
        StageForecast forecast{.past = {}, .known = known_, .stage = stages};
        take_past(f, begin, forecast.past);
        foresee_steps(forecast, end - begin);
        continue;
      }
      WaveForecast forecast{.past = {}, .known = known_, .off = {}, .last = {}, .stages = stages};
      take_past(f, begin, forecast.past);
      for (std::size_t way = 0; way < ways_onward; ++way) {
        forecast.off.at(way) = std::as_const(off_).field(row_of(way, f)).data() + begin;
        forecast.last.at(way) = rows_from(foreseen_, row_of(way, f), begin);
      }
      foresee_waves(m_, onward_.data(), forecast, judged_, end - begin);
    }
  });
  reported_ = m_ > 1;
}

void RestForecast::save(StateWriter& state, const grids::Fourier& fourier) const {
  state.write(static_cast<double>(known_));
  state.write(static_cast<double>(judged_));
  state.write(last_h_);
  for (int back = 0; back < known_; ++back) {
    const WaveRows& rests = past_[place(static_cast<std::size_t>(back))];
    save_waves(state, fourier, rests.re);
    save_waves(state, fourier, rests.im);
  }
  save_waves(state, fourier, off_);
}

void RestForecast::restore(StateReader& state, const grids::Fourier& fourier) {
  const double known = state.read();
  if (!(known >= 0.0 && known <= static_cast<double>(past_.size()))) {
    throw std::invalid_argument("a saved state has more steps than there are");
  }
  known_ = static_cast<int>(known);
  judged_ = state.read() != 0.0;
  reported_ = false;
  state.read(last_h_);
  newest_ = 0;
  for (int back = 0; back < known_; ++back) {
    WaveRows& rests = past_[static_cast<std::size_t>(back)];
    restore_waves(state, fourier, rests.re);
    restore_waves(state, fourier, rests.im);
  }
  restore_waves(state, fourier, off_);
}

}  // namespace rubato
