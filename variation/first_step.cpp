#include <rubato/variation/first_step.hpp>

#include <limits>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

namespace {

/// The tolerance trials begin with, and the factor from one to the next.
constexpr double coarse_tolerance = 1e-3;
constexpr double refinement = 1e-2;
constexpr int most_first_trials = 16;
/// A trial whose deviation is this part of the tolerance is good enough; the next one aims at its upper third.
constexpr double least_part = 0.7;
constexpr double aim = 0.9;
/// Change of the step from one trial to the next: where the law does not hold yet it is not to be trusted further.
constexpr double largest_rise = 4.0;
constexpr double largest_cut = 0.1;

/// The search for one tolerance. Steps are lengths here.
class Search {
public:
  Search(const std::function<TrialRun(double)>& run, int order, double length)
      : run_(run), order_(order), longest_(0.1 * std::abs(length)), direction_(length) {}

  /// \param may_grow whether a deviation below the tolerance asks for a longer step even if the trial did not see all
  /// of the run
  double operator()(double guess, double tolerance, bool may_grow) const {
    double length = std::min(guess, longest_);
    double good = 0.0;                                     // longest that kept to the tolerance
    double bad = std::numeric_limits<double>::infinity();  // shortest that did not
    for (int trial = 0; trial < most_first_trials; ++trial) {
      const TrialRun result = run_(std::copysign(length, direction_));
      const bool solved = result.status == Status::success;
      if (solved && result.deviation <= tolerance) {
        if (result.deviation >= least_part * tolerance || length >= longest_ || !(may_grow || result.whole)) {
          return length;
        }
        good = std::max(good, length);
      } else {
        bad = std::min(bad, length);
      }
      const double ratio = solved ? std::pow(aim * tolerance / result.deviation, 1.0 / order_) : largest_cut;
      length = std::min(length * std::clamp(ratio, largest_cut, largest_rise), longest_);
      // On orbits with crossings the deviation depends on their phase too: stay between what is known.
      if (length <= good || length >= bad) {
        length = good == 0.0 ? 0.5 * bad : std::sqrt(good * bad);
      }
      if (good > 0.0 && bad < 1.1 * good) {
        break;
      }
    }
    if (good == 0.0) {
      throw std::invalid_argument(
          fmt::format("no first step was found with which the node energy keeps within {} of the discrete energy, down "
                      "to h = {:.3g}; give the step as a number",
                      tolerance, bad));
    }
    return good;
  }

private:
  const std::function<TrialRun(double)>& run_;
  int order_;
  double longest_;
  double direction_;
};

}  // namespace

double choose_first_step(const std::function<TrialRun(double)>& run, const LevelNode& start, double energy_scale,
                         int order, double tolerance, double length) {
  if (!(tolerance > 0.0 && tolerance < 1.0)) {
    throw std::invalid_argument(
        fmt::format("the tolerance of the node energy is relative and has to be between 0 and 1; got {}", tolerance));
  }
  const Search search(run, order, length);
  double reached = std::max(tolerance, coarse_tolerance);
  // |H - E| = (s+1)/24 h^s |Γ| at the start
  const double law = 24.0 * reached * energy_scale / ((order + 1.0) * std::abs(start.gamma));
  const double guess = std::pow(law, 1.0 / order);
  double step = search(std::isfinite(guess) && guess > 0.0 ? guess : 0.1 * std::abs(length), reached, true);
  while (reached > tolerance) {
    const double next = std::max(tolerance, refinement * reached);
    step = search(step * std::pow(next / reached, 1.0 / order), next, false);
    reached = next;
  }
  return std::copysign(step, length);
}

}  // namespace rubato
