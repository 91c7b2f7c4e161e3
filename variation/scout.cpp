#include <rubato/variation/scout.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <rubato/variation/sign.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning;

/// The scout's log so far, and whether it has seen enough.
class Watch {
public:
  explicit Watch(Scouting& log, std::size_t most) : log_(log), most_(most), look_at_(least_stretch * log.step) {}

  void add(double eta, double length) {
    log_.time.push_back(log_.duration + 0.5 * length);
    log_.eta.push_back(eta);
    log_.duration += length;
    if (std::abs(eta) > std::abs(largest_)) {
      largest_ = eta;
      largest_at_ = log_.time.back();
    }
  }

  [[nodiscard]] bool seen_enough() {
    if (log_.eta.size() >= most_) {
      return true;
    }
    // A little less: what rounding makes of a sum of steps decides nothing.
    if (log_.duration < look_at_ * (1.0 - 1e-9)) {
      return false;
    }
    look_at_ = look_again * log_.duration;
    const auto half = std::ranges::upper_bound(log_.time, 0.5 * log_.duration) - log_.time.begin();
    const bool comes_back = std::any_of(log_.eta.begin() + half, log_.eta.end(),
                                        [&](double eta) { return std::abs(eta) >= come_back * std::abs(largest_); });
    return comes_back && largest_at_ <= seen_before * log_.duration;
  }

private:
  Scouting& log_;
  std::size_t most_;
  double look_at_;
  double largest_ = 0.0, largest_at_ = 0.0;
};

/// dK/d|h| = s(s+1)|h|^(s-1) η, for η = 1.
double slope_of_one(const Scouting& log, double length) {
  const double s = log.order;
  return s * (s + 1.0) * std::pow(length, s - 1.0);
}

/// Of η, relative; one that K hardly knows h for is as good as 0.
double change_between(const Scouting& log, double eta, double last) {
  const double unseen = log.resolved_slope() / (slope_of_one(log, log.step) * log.step);
  return std::abs(eta - last) / std::max({std::abs(eta), std::abs(last), unseen, std::numeric_limits<double>::min()});
}

/// Iterations for the time of a first step, of the last stride of each length, 2^k first steps.
class Prices {
public:
  /// Whether this stride takes many iterations, much more than a shorter one did for the same time.
  [[nodiscard]] bool is_dear(double stride, int iterations) {
    const auto k = static_cast<std::size_t>(std::ilogb(stride));
    last_[k] = iterations / stride;
    return iterations > many_iterations && last_[k] > dear * *std::min_element(last_.begin(), last_.begin() + k);
  }

private:
  static constexpr std::size_t most = 11;
  static_assert(longest_stride < 1U << most);
  std::array<double, most> last_ = filled();

  static constexpr std::array<double, most> filled() {
    std::array<double, most> nothing{};
    nothing.fill(std::numeric_limits<double>::infinity());
    return nothing;
  }
};

}  // namespace

Scouting scout(LevelScheme& scheme, double first_step, bool one_step, double tolerance) {
  StateWriter before(StateWriter::For::going_back);
  scheme.save(before);
  Scouting log{.order = scheme.order(), .step = std::abs(first_step), .tolerance = tolerance};
  const std::size_t size = before.size();
  Watch watch(log, one_step ? 1
                            : std::clamp(most_steps * small_state / std::max<std::size_t>(size, 1), most_large_steps,
                                         most_steps));
  Prices prices;
  double stride = 1.0, longest = longest_stride;
  int until_tried = 0;
  while (!watch.seen_enough()) {
    const double h = stride * first_step;
    const int counted = scheme.iterations();  // since the last level
    const bool taken = scheme.advance(h, scout_accuracy) == Status::success;
    double eta = 0.0, change = 0.0;
    if (taken) {
      eta = scheme.discrete_energy_slope() * sign(h) / slope_of_one(log, std::abs(h));
      change = change_between(log, eta, log.eta.empty() ? eta : log.eta.back());
    }
    if (prices.is_dear(stride, scheme.iterations() - counted)) {
      longest = 0.5 * stride;
    }
    const bool good = taken && std::isfinite(eta);
    if (stride > 1.0 && !(good && change <= changed_much)) {
      stride *= 0.5;
      until_tried = steps_until_tried_again;
      continue;
    }
    if (!good) {
      break;
    }
    const double size_of_energy = scheme.energy_size().terms;
    if (!log.eta.empty() && size_of_energy > blown_up * log.first_size) {
      break;
    }
    log.energy_size = std::max(log.energy_size, size_of_energy);
    log.first_size = log.eta.empty() ? log.energy_size : log.first_size;
    watch.add(eta, std::abs(h));
    scheme.accept();
    until_tried = std::max(until_tried - 1, 0);
    if (change < hardly_changed && until_tried == 0 && log.eta.size() > 1) {
      stride *= 2.0;
    }
    stride = std::min(stride, longest);
  }
  StateReader reader(before);
  scheme.restore(reader);
  return log;
}

}  // namespace rubato
