#include <rubato/variation/crossing.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <rubato/base/limits.hpp>
#include <rubato/variation/clear_of_zero.hpp>

namespace rubato {

namespace {

/// A crossing so near to the start, as a share of the first step, is the start, reported with rounding.
constexpr double start = 1e-9;

int sign_of(double value) {
  return value > 0.0 ? 1 : value < 0.0 ? -1 : 0;
}

/// The cubic through values and rates at two places, on s = 0 … 1 from the one to the other:
/// a + b s + c s² + d s³.
struct Cubic {
  double a, b, c, d;

  Cubic(const CrossingSearch::Sample& from, const CrossingSearch::Sample& to) {
    const double length = to.fraction - from.fraction;
    const double first = length * from.rate, last = length * to.rate, change = to.value - from.value;
    a = from.value;
    b = first;
    c = 3.0 * change - 2.0 * first - last;
    d = first + last - 2.0 * change;
  }
  [[nodiscard]] double operator()(double s) const { return a + s * (b + s * (c + s * d)); }
  [[nodiscard]] double slope(double s) const { return b + s * (2.0 * c + 3.0 * d * s); }

  /// Where it turns, in between and not next to the ends; -1 for none.
  [[nodiscard]] std::array<double, 2> turns() const {
    constexpr double margin = 1e-4;
    std::array<double, 2> places{-1.0, -1.0};
    const double discriminant = c * c - 3.0 * b * d;
    if (!(discriminant >= 0.0)) {
      return places;
    }
    // Without cancellation: the product of the roots of b + 2 c s + 3 d s² is b/(3 d).
    const double half = -(c + std::copysign(std::sqrt(discriminant), c));
    places = {half / (3.0 * d), b / half};
    for (double& place : places) {
      place = place > margin && place < 1.0 - margin ? place : -1.0;
    }
    if (places[0] > places[1]) {
      std::swap(places[0], places[1]);
    }
    return places;
  }

  /// Its zero between ends of opposite signs, near enough for a first guess.
  [[nodiscard]] double zero() const {
    double low = 0.0, high = 1.0, s = a / (a - (*this)(1.0));
    for (int i = 0; i < 30; ++i) {
      const double value = (*this)(s);
      ((value < 0.0) == (a < 0.0) ? low : high) = s;
      const double newton = s - value / slope(s);
      s = newton > low && newton < high ? newton : 0.5 * (low + high);
    }
    return s;
  }
};

}  // namespace

void CrossingSearch::begin(double value) {
  sign_ = std::isfinite(value) ? sign_of(value) : 0;
  at_start_ = true;
  previous_value_ = std::numeric_limits<double>::quiet_NaN();
}

const std::vector<Crossing>& CrossingSearch::follow(double h, Sample from, Sample to, const Function& g) {
  crossings_.clear();
  samples_.clear();
  undefined_ = !std::isfinite(from.value) || !std::isfinite(to.value);
  left_and_returned_ = false;
  if (undefined_) {
    sign_ = std::isfinite(to.value) ? sign_of(to.value) : 0;
  } else {
    constexpr int deepest = 3;
    set_rates(h, from, to, g);
    if (!at_start_ && sign_ == sign_of(from.value) && is_clear_of_zero(from.value, from.rate, to.value, to.rate)) {
      previous_value_ = from.value;
      previous_h_ = h;
      return crossings_;
    }
    samples_.push_back(from);
    refine(from, to, deepest, g);
    samples_.push_back(to);
    find_signs(g);
    left_and_returned_ = at_start_ && leaves_and_returns(from, to);
  }
  previous_value_ = undefined_ ? std::numeric_limits<double>::quiet_NaN() : from.value;
  previous_h_ = h;
  at_start_ = false;
  return crossings_;
}

/// Rates that are not known: those of a parabola, through the level before, or through the middle where there is none.
void CrossingSearch::set_rates(double h, Sample& from, Sample& to, const Function& g) {
  if (std::isfinite(from.rate) && std::isfinite(to.rate)) {
    return;
  }
  double place = -previous_h_ / h, value = previous_value_;
  if (!std::isfinite(value)) {
    place = 0.5;
    value = g(place).value;
  }
  const double first = (value - from.value) / place, change = to.value - from.value;
  const double curvature = (change - first) / (1.0 - place);
  from.rate = change - curvature;
  to.rate = change + curvature;
  if (!std::isfinite(curvature)) {
    from.rate = to.rate = change;
  }
}

/// Looks at g where it may turn beyond zero, or nearly so: where the cubic turns between zeros, or nearer to zero than
/// a fourth of how much it varies, which is more than it is off by.
void CrossingSearch::refine(const Sample& a, const Sample& b, int depth, const Function& g) {
  if (depth == 0) {
    return;
  }
  constexpr double near = 0.25;
  const Cubic cubic(a, b);
  const std::array<double, 2> turns = cubic.turns();
  double low = std::min(a.value, b.value), high = std::max(a.value, b.value);
  for (const double s : turns) {
    if (s > 0.0) {
      low = std::min(low, cubic(s));
      high = std::max(high, cubic(s));
    }
  }
  // Whether the cubic passes zero more often than its ends show.
  int changes = 0, before = sign_of(a.value);
  for (const double value :
       {turns[0] > 0.0 ? cubic(turns[0]) : a.value, turns[1] > 0.0 ? cubic(turns[1]) : b.value, b.value}) {
    changes += sign_of(value) != before ? 1 : 0;
    before = sign_of(value);
  }
  const bool passes_more = changes > (sign_of(a.value) != sign_of(b.value) ? 1 : 0);
  Sample last = a;
  const double length = b.fraction - a.fraction;
  for (const double s : turns) {
    if (!(s > 0.0)) {
      continue;
    }
    if (!passes_more && std::abs(cubic(s)) > near * (high - low)) {
      continue;
    }
    Sample found = g(a.fraction + s * length);
    if (!std::isfinite(found.value)) {
      undefined_ = true;
      continue;
    }
    if (!std::isfinite(found.rate)) {  // of the parabola through the three
      const double left = (found.value - a.value) / (s * length),
                   right = (b.value - found.value) / (length - s * length);
      found.rate = left * (1.0 - s) + right * s;
    }
    refine(last, found, depth - 1, g);
    samples_.push_back(found);
    last = found;
  }
  if (last.fraction > a.fraction) {
    refine(last, b, depth - 1, g);
  }
}

bool CrossingSearch::leaves_and_returns(const Sample& from, const Sample& to) const {
  const int left_to = sign_of(from.rate), back = sign_of(to.value);
  const bool is_at_zero = std::abs(from.value) <= start * std::max(std::abs(from.rate), std::abs(to.value));
  const bool is_wanted = wanted_ == Direction::both || static_cast<int>(wanted_) == back;
  return is_at_zero && left_to != 0 && back == -left_to && is_wanted &&
         std::ranges::none_of(
             crossings_, [back](const Crossing& crossing) { return static_cast<int>(crossing.direction) == back; });
}

void CrossingSearch::find_signs(const Function& g) {
  const Sample* last = nullptr;  // that is not 0
  const Sample* zero = nullptr;  // the last one after it
  for (const Sample& sample : samples_) {
    const int sign = sign_of(sample.value);
    if (sign == 0) {
      zero = &sample;
      continue;
    }
    if (sign_ != 0 && sign != sign_ && (wanted_ == Direction::both || static_cast<int>(wanted_) == sign)) {
      Crossing crossing{.fraction = zero != nullptr ? zero->fraction : 0.0, .direction = static_cast<Direction>(sign)};
      if (zero == nullptr && last != nullptr) {
        crossing = locate(*last, sample, g);
      }
      if (!std::isnan(crossing.fraction) && (!at_start_ || crossing.fraction > start)) {
        crossings_.push_back(crossing);
      }
    }
    sign_ = sign;
    last = &sample;
    zero = nullptr;
  }
}

Crossing CrossingSearch::locate(const Sample& a, const Sample& b, const Function& g) {
  const Direction direction = b.value > 0.0 ? Direction::up : Direction::down;
  double x = a.fraction, f = a.value, other = b.fraction, f_other = b.value;
  double share = std::clamp(Cubic(a, b).zero(), 1e-3, 1.0 - 1e-3);
  constexpr int most = 200;
  for (int i = 0; i < most; ++i) {
    const double next = x + share * (other - x);
    // A pole has signs, too, and is found to be a jump.
    constexpr double most_value = std::numeric_limits<double>::max() / 16.0;
    const double value = std::clamp(g(next).value, -most_value, most_value);
    if (std::isnan(value)) {
      undefined_ = true;
      return {value};
    }
    double third = x, f_third = f;
    if (sign_of(value) != sign_of(f)) {
      third = other;
      f_third = f_other;
      other = x;
      f_other = f;
    }
    x = next;
    f = value;
    if (f == 0.0) {
      return {x, direction};
    }
    const double nearest = std::abs(f_other) < std::abs(f) ? other : x;
    const double least = (2.0 * epsilon * std::abs(nearest) + epsilon) / std::abs(other - x);
    if (least > 0.5) {
      break;
    }
    const double xi = (x - other) / (third - other), phi = (f - f_other) / (f_third - f_other);
    share = 0.5;
    if (phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi) {
      share = f / (f_other - f) * (f_third / (f_other - f_third)) +
              (third - x) / (other - x) * (f / (f_third - f)) * (f_other / (f_third - f_other));
    }
    share = std::isfinite(share) ? std::clamp(share, least, 1.0 - least) : 0.5;
  }
  // What is left of the difference between the two sides of a zero is rounding.
  constexpr double much = 0.125;
  const bool jump = std::abs(f - f_other) > much * (std::abs(a.value) + std::abs(b.value));
  return {std::abs(f_other) < std::abs(f) ? other : x, direction, jump};
}

void CrossingSearch::save(StateWriter& state) const {
  state.write(sign_);
  state.write(at_start_ ? 1.0 : 0.0);
  state.write(previous_value_);
  state.write(previous_h_);
}

void CrossingSearch::restore(StateReader& state) {
  state.read(sign_);
  state.read(at_start_);
  state.read(previous_value_);
  state.read(previous_h_);
}

}  // namespace rubato
