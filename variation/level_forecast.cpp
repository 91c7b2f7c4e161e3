#include <rubato/variation/level_forecast.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <rubato/variation/power_of.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

using namespace tuning;

namespace {

constexpr double none = 0.0;  ///< a length that does not exist

}  // namespace

LevelForecaster::LevelForecaster(const LookAhead& look) : look_(look) {
  const std::vector<double>&time = look.time, &eta = look.eta;
  const auto secant = [&](std::size_t i) { return (eta[i + 1] - eta[i]) / (time[i + 1] - time[i]); };
  const auto slope = [&](std::size_t i) {
    if (i == 0 || i + 1 == eta.size()) {
      return secant(i == 0 ? 0 : i - 1);
    }
    const double before = time[i] - time[i - 1], after = time[i + 1] - time[i];
    return (secant(i - 1) * after + secant(i) * before) / (before + after);
  };
  const auto constant = [](double begin, double end, double value) {
    return Piece{.begin = begin, .end = end, .length = end, .eta = value, .rise = 0.0, .bend = 0.0, .twist = 0.0};
  };
  pieces_.push_back(constant(0.0, time.front(), eta.front()));
  for (std::size_t i = 0; i + 1 < eta.size(); ++i) {
    const double length = time[i + 1] - time[i], rise = eta[i + 1] - eta[i];
    pieces_.push_back({.begin = time[i],
                       .end = time[i + 1],
                       .length = length,
                       .eta = eta[i],
                       .rise = rise,
                       .bend = slope(i) * length - rise,
                       .twist = rise - slope(i + 1) * length});
  }
  pieces_.push_back(constant(time.back(), std::numeric_limits<double>::max(), eta.back()));
}

double LevelForecaster::eta_at(std::size_t piece, double time, const EtaDoubt& doubt) const {
  const double factor =
      doubt.turn > 0.0 ? doubt.factor * std::cos(2.0 * std::numbers::pi * time / doubt.turn) : doubt.factor;
  return factor * pieces_[piece](time);
}

/// At the end of a stride: of one step, or of many that are alike. Each step makes D larger by h^s Δη.
LevelForecaster::Level LevelForecaster::moved(const Level& from, double h, double stride, const EtaDoubt& doubt) const {
  Level level = from;
  level.time += stride;
  while (pieces_[level.piece].end < level.time) {
    ++level.piece;
  }
  level.eta = eta_at(level.piece, level.time, doubt);
  level.defect += power_of(h, look_.order) * (level.eta - from.eta);
  level.steps += stride / h;
  return level;
}

/// Newton's iteration for (s+1) h^s η + f'(h) = D, on the branch where the energy grows to the side of the potential.
double LevelForecaster::length_at(const Level& level, double guess, const StepPotential& potential) const {
  const int s = look_.order;
  const double resolved = look_.resolved_slope();
  double h = guess;
  for (int iteration = 0; iteration < most_forecast_steps; ++iteration) {
    const double scheme = (s + 1.0) * power_of(h, s) * level.eta, added = potential.energy(h);
    const double slope = (s * scheme + potential.exponent * added) / h;
    if (!(slope * std::copysign(h, potential.strength) > resolved)) {
      return none;
    }
    const double next = std::clamp(h - (scheme + added - level.defect) / slope, 0.5 * h, 2.0 * h);
    const double change = std::abs(next - h);
    h = next;
    if (change < last_forecast_move * h) {  // the next would be about the square
      return h;
    }
  }
  return none;
}

LevelForecast LevelForecaster::operator()(const StepPotential& potential, const EtaDoubt& doubt, double limit) const {
  const int s = look_.order;
  const double end = look_.duration, most = 20.0 * end / look_.step;
  double h = look_.step;
  Level now{.eta = eta_at(0, 0.0, doubt)};
  now.defect = (s + 1.0) * power_of(h, s) * now.eta + potential.energy(h);
  const double first_defect = now.defect;
  LevelForecast result{.shortest = h, .longest = h, .potential = std::abs(potential.energy(h))};
  if (!(result.potential <= limit) || length_at(now, h, potential) == none) {
    return result;
  }
  std::size_t one_by_one = pieces_.size();  // the piece in which steps were found not to be alike
  for (;;) {
    const Piece& piece = pieces_[now.piece];
    double stride = h;
    if (now.piece != one_by_one) {
      stride = std::max(h, (std::min(piece.end, end) - piece.begin) / strides_in_piece);
      stride = doubt.turn > 0.0 ? std::max(h, std::min(stride, doubt.turn / strides_in_turn)) : stride;
    }
    Level next = moved(now, h, stride, doubt);
    const double last = h;
    if (next.time < end) {
      h = length_at(next, last, potential);
    }
    if (stride > last && !(h != none && std::abs(h - last) <= alike_change * last)) {
      one_by_one = now.piece;
      h = last;
      continue;
    }
    result.shortest = std::min(result.shortest, last);
    result.longest = std::max(result.longest, last);
    result.potential = std::max(result.potential, std::abs(potential.energy(last)));
    result.steps = next.steps;
    result.energy = std::max(result.energy, std::abs(next.defect - first_defect));
    if (!(next.time < end)) {
      result.steps -= (next.time - end) / last;  // as many as the stretch needs
      result.complete = true;
      return result;
    }
    if (h == none || std::abs(std::log(h / last)) > believed_change || !(next.steps < most) ||
        !(result.potential <= limit)) {
      return result;
    }
    // Of n steps that change evenly D += h^s Δη makes, beyond that of n like the first, (1 - 1/n)/2 of how h^s changed.
    next.defect += 0.5 * (1.0 - last / stride) * (power_of(h, s) - power_of(last, s)) * (next.eta - now.eta);
    now = next;
  }
}

}  // namespace rubato
