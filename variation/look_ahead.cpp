#include <rubato/variation/look_ahead.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <rubato/base/interrupt.hpp>
#include <rubato/variation/equal_steps.hpp>
#include <rubato/variation/power_of.hpp>
#include <rubato/variation/sign.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning;

/// If it comes as far as it looks at least in fewer strides than these it goes on: what is to happen later costs little
/// to see.
constexpr std::size_t least_strides = 100;

/// The look-ahead's log so far, and whether it has seen enough.
class Watch {
public:
  /// \param one_step the first is enough, if K depends on h there
  Watch(LookAhead& log, std::size_t most, bool one_step, double run_length, double farthest)
      : log_(log),
        most_(most),
        one_step_(one_step),
        to_end_(std::isfinite(run_length) ? run_length : longest_stretch_untold * log.step),
        farthest_(farthest),
        look_at_(least_stretch * log.step),
        early_look_(log.order >= order_with_zeros ? first_look : least_stretch) {}

  void add(double eta, double length) {
    log_.time.push_back(log_.duration + 0.5 * length);
    log_.eta.push_back(eta);
    log_.duration += length;
    if (std::abs(eta) > std::abs(largest_)) {
      largest_ = eta;
      depends_ = log_.depends_on_step();
      largest_at_ = log_.time.back();
    }
  }

  [[nodiscard]] bool seen_enough() {
    if (log_.eta.size() >= most_ || steps_to_farthest() < 1.0) {
      return true;
    }
    const auto seen = static_cast<double>(log_.eta.size());
    return seen_what_repeats() && (depends_ || log_.duration >= to_end_ || (held_ && seen >= least_stretch));
  }

  /// A longer stride showed something else, or cost too much: first steps are about as long as the motion's own time.
  void hold() { held_ = true; }
  /// Of a longer one than this nothing is to be saved, as long as it looks early.
  void hold_to(double stride) {
    hold();
    longest_early_ = std::min(longest_early_, stride);
  }

  /// Whether K depends on h in what was seen so far.
  [[nodiscard]] bool depends_on_step() const { return depends_; }
  /// In first steps.
  [[nodiscard]] double longest_stride() const {
    const double longest =
        looks_early() ? std::min(early_look_ / strides_in_look, longest_early_) : tuning::longest_stride;
    return std::min(longest, std::exp2(std::floor(std::log2(std::max(steps_to_farthest(), 1.0)))));
  }

  /// Whether it has not yet seen what it sees at least, and may need no more.
  [[nodiscard]] bool looks_early() const { return early_look_ < least_stretch; }

private:
  /// First steps; a little more, as the rounding error of a sum of steps decides nothing.
  [[nodiscard]] double steps_to_farthest() const { return (farthest_ - log_.duration) / log_.step + 1e-9; }
  [[nodiscard]] bool seen_what_repeats() {
    if (one_step_ && depends_) {
      return true;
    }
    // A little less: the rounding error of a sum of steps decides nothing.
    const double seen = log_.duration * (1.0 + 1e-9);
    if (looks_early() && seen >= early_look_ * log_.step) {
      const bool is_all = log_.knows_step() ? repeats(log_) : held_ && early_look_ >= second_look;
      if (depends_ && is_all && equal_steps_do(log_)) {
        return true;
      }
      early_look_ *= 2.0;
    }
    const bool is_cheap = log_.eta.size() < least_strides && seen < longest_stretch_untold * log_.step;
    if (seen < look_at_ || is_cheap) {
      return false;
    }
    if (log_.order >= order_with_zeros && !log_.knows_step()) {
      look_at_ = 2.0 * log_.duration;
      return held_ || seen >= longest_stretch_untold * log_.step;
    }
    look_at_ = look_again * log_.duration;
    const auto half = std::ranges::upper_bound(log_.time, 0.5 * log_.duration) - log_.time.begin();
    const bool comes_back = std::any_of(log_.eta.begin() + half, log_.eta.end(),
                                        [&](double eta) { return std::abs(eta) >= come_back * std::abs(largest_); });
    return comes_back && largest_at_ <= seen_before * log_.duration;
  }

  LookAhead& log_;
  std::size_t most_;
  bool one_step_;
  bool depends_ = false;  ///< K on h, in what was seen
  double to_end_;         ///< how far it looks where K does not
  double farthest_;
  double look_at_;
  double early_look_;  ///< in first steps
  double longest_early_ = tuning::longest_stride;
  bool held_ = false;
  double largest_ = 0.0, largest_at_ = 0.0;
};

/// dK/d|h| = s(s+1)|h|^(s-1) η, for η = 1.
double slope_of_one(const LookAhead& log, double length) {
  return log.order * (log.order + 1.0) * power_of(length, log.order - 1);
}

/// Of η, relative; one that K hardly knows h for is as good as 0.
double change_between(const LookAhead& log, double eta, double last) {
  return std::abs(eta - last) /
         std::max({std::abs(eta), std::abs(last), log.least_resolved(), std::numeric_limits<double>::min()});
}

/// Iterations for the time of a first step, of the last stride of each length, 2^k first steps.
class StrideCosts {
public:
  /// Whether this stride takes many iterations, much more than a shorter one did for the same time.
  [[nodiscard]] bool is_high(double stride, int iterations) {
    const auto k = static_cast<std::size_t>(std::ilogb(stride));
    last_[k] = iterations / stride;
    return iterations > many_iterations && last_[k] > dear * least_of_shorter(k);
  }
  /// Whether it took no fewer, all in all, than shorter ones did: then it is not far from where an iteration no longer
  /// contracts, which costs much more.
  [[nodiscard]] bool saves_little(double stride) const {
    const auto k = static_cast<std::size_t>(std::ilogb(stride));
    return last_[k] > saving * least_of_shorter(k);
  }

private:
  static constexpr std::size_t most = 11;
  static_assert(longest_stride < 1U << most);
  std::array<double, most> last_ = filled();

  [[nodiscard]] double least_of_shorter(std::size_t k) const {
    return *std::min_element(last_.begin(), last_.begin() + static_cast<std::ptrdiff_t>(k));
  }
  static constexpr std::array<double, most> filled() {
    std::array<double, most> nothing{};
    nothing.fill(std::numeric_limits<double>::infinity());
    return nothing;
  }
};

}  // namespace

LookAhead look_ahead(LevelScheme& scheme, double first_step, bool one_step, double tolerance, double run_length,
                     double farthest) {
  StateWriter before(StateWriter::For::going_back);
  scheme.save(before);
  LookAhead log{.order = scheme.order(), .step = std::abs(first_step), .tolerance = tolerance};
  const std::size_t size = before.size();
  Watch watch(log, std::clamp(most_steps * small_state / std::max<std::size_t>(size, 1), most_large_steps, most_steps),
              one_step, run_length, farthest);
  StrideCosts costs;
  double begun_with = 0.0;  // the terms of the first step that has any
  double stride = 1.0, longest = longest_stride;
  int until_tried = 0;
  while (!watch.seen_enough() && !Interruptible::asked()) {
    const double h = stride * first_step;
    const int counted = scheme.iterations();  // since the last level
    // As long as K does not depend on h, what a loosely solved step leaves would look as if it did.
    const double accuracy = watch.depends_on_step() ? look_ahead_accuracy : 0.0;
    const bool taken = scheme.advance(h, accuracy) == Status::success;
    double eta = 0.0, change = 0.0;
    if (taken) {
      eta = scheme.discrete_energy_slope() * sign(h) / slope_of_one(log, std::abs(h));
      change = change_between(log, eta, log.eta.empty() ? eta : log.eta.back());
    }
    if (costs.is_high(stride, scheme.iterations() - counted)) {
      longest = 0.5 * stride;
      watch.hold();
    } else if (stride > 1.0 && taken && watch.looks_early() && costs.saves_little(stride)) {
      watch.hold_to(stride);
    }
    const bool good = taken && std::isfinite(eta);
    if (stride > 1.0 && !(good && change <= changed_much && log.off(eta, std::abs(h)) <= off_much * log.energy_size)) {
      stride *= 0.5;
      until_tried = steps_until_tried_again;
      watch.hold();
      continue;
    }
    if (!good) {
      break;
    }
    const formula::SumSize size_of_energy = scheme.energy_size();
    begun_with = begun_with > 0.0 ? begun_with : size_of_energy.terms;
    if (size_of_energy.terms > blown_up * begun_with) {
      break;
    }
    log.energy_size = std::max(log.energy_size, size_of_energy.terms);
    log.rounding = std::max(log.rounding, size_of_energy.rounding);
    // A motion that begins from rest has hardly any terms in its first step.
    if (log.duration < first_look * log.step) {
      log.first_size = log.energy_size;
    }
    watch.add(eta, std::abs(h));
    scheme.accept();
    until_tried = std::max(until_tried - 1, 0);
    if (change < hardly_changed && until_tried == 0 && log.eta.size() > 1) {
      stride *= 2.0;
    }
    stride = std::min({stride, longest, watch.longest_stride()});
  }
  StateReader reader(before);
  scheme.restore(reader);
  Interruptible::end_if_asked();
  return log;
}

}  // namespace rubato
