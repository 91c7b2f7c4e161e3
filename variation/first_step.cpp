#include <rubato/variation/first_step.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/base/limits.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning;

/// The search for one tolerance. Steps are lengths here.
class Search {
public:
  Search(std::function<TrialRun(double)> run, int order, double length)
      : run_(std::move(run)), order_(order), longest_(0.1 * std::abs(length)), direction_(length) {}

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
          fmt::format("no first step was found with which the node energy keeps within {} of the discrete energy of "
                      "that step, down to h = {:.3g}; give the step as a number",
                      tolerance, bad));
    }
    return good;
  }

private:
  std::function<TrialRun(double)> run_;
  int order_;
  double longest_;
  double direction_;
};

/// Of an integrator's levels so far.
class NodeEnergies {
public:
  explicit NodeEnergies(Integrator& integrator) : integrator_(integrator) { add(); }

  void add() {
    const double bare = integrator_.bare_node().energy;
    low_ = std::min(low_, bare);
    high_ = std::max(high_, bare);
    largest_ = std::max(largest_, std::abs(integrator_.node().energy));
  }
  [[nodiscard]] double middle() const { return 0.5 * (low_ + high_); }
  [[nodiscard]] double farthest(double E) const { return std::max(high_ - E, E - low_); }
  [[nodiscard]] double scale() const {
    const double largest = std::min(largest_, std::max(std::abs(low_), std::abs(high_)));
    return node_energy_scale(largest, integrator_.levels().sizes());
  }

private:
  Integrator& integrator_;
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_, largest_ = 0.0;
};

}  // namespace

double node_energy_scale(double largest, const formula::SumSize& sizes) {
  constexpr double certain = 100.0;     // what is known to two digits is no rounding
  constexpr double vanishing = 3.0e-3;  // of 3 % of what cancels
  if (largest > std::max(vanishing * sizes.cancelled, certain * sizes.rounding)) {
    return largest;
  }
  return sizes.cancelled > certain * sizes.rounding ? sizes.cancelled : sizes.rounding / epsilon;
}

TrialRun trial_run(Integrator& integrator, std::size_t most_steps) {
  NodeEnergies energies(integrator);
  double potential = 0.0;
  TrialRun result;
  for (std::size_t k = 0; k < most_steps && !integrator.finished(); ++k) {
    const StepReport step = integrator.step();
    result.status = step.status;
    if (result.status != Status::success) {
      return result;
    }
    potential = k == 0 ? step.potential : potential;
    energies.add();
  }
  result.whole = integrator.finished();
  // While the run still waits beside a zero of Γ there is no E yet.
  const double set = integrator.levels().bare_energy();
  const double E = std::isnan(set) ? energies.middle() : set - potential;
  const double scale = energies.scale();
  result.deviation = scale == 0.0 ? 0.0 : energies.farthest(E) / scale;
  return result;
}

double choose_first_step(const std::function<std::unique_ptr<Integrator>(double)>& make, double length,
                         double tolerance, std::size_t most_steps) {
  const auto start = make(std::copysign(1e-6, length) * std::abs(length));
  if (!(tolerance > 0.0 && tolerance < 1.0)) {
    throw std::invalid_argument(
        fmt::format("the tolerance of the node energy is relative and has to be between 0 and 1; got {}", tolerance));
  }
  const int order = start->order();
  const Search search([&](double step) { return trial_run(*make(step), most_steps); }, order, length);
  double reached = std::max(tolerance, coarse_tolerance);
  // |H - E| = (s+1)/24 h^s |Γ| at the start
  const double law =
      24.0 * reached * NodeEnergies(*start).scale() / ((order + 1.0) * std::abs(start->bare_node().gamma));
  // The root in units of 2^e, about the run's length, so that other units of time change no digit of it.
  const int e = std::ilogb(length);
  const double guess = std::ldexp(std::pow(std::ldexp(law, -e * order), 1.0 / order), e);
  double step = search(std::isfinite(guess) && guess > 0.0 ? guess : 0.1 * std::abs(length), reached, true);
  while (reached > tolerance) {
    const double next = std::max(tolerance, refinement * reached);
    step = search(step * std::pow(next / reached, 1.0 / order), next, false);
    reached = next;
  }
  return std::copysign(step, length);
}

}  // namespace rubato
