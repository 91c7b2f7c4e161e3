// Many orbits of one H: side by side where they can be, else one after the other, on all threads.

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>
#include <omp.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/orbit_end.hpp>
#include <rubato/ode/splitting_lanes.hpp>
#include <rubato/ode/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::many_orbits;

/// Whether orbits with these options have a form side by side.
bool go_side_by_side(const IntegrationOptions& options) {
  return std::holds_alternative<Splitting>(options.lagrangian) && options.levels == Levels::fixed && !options.next &&
         options.events.empty();
}

class ManyOrbits {
public:
  ManyOrbits(const Hamiltonian& hamiltonian, std::span<const InitialState> initial, const IntegrationOptions& options)
      : hamiltonian_(hamiltonian), initial_(initial), options_(options), ends_(initial.size()) {
    const auto threads = static_cast<std::size_t>(omp_get_max_threads());
    if (!initial.empty() && go_side_by_side(options)) {
      // The options, and what H is.
      static_cast<void>(OrbitIntegrator(hamiltonian, initial.front(), options));
      const std::size_t width =
          std::clamp((initial.size() + 2 * threads - 1) / (2 * threads), std::size_t{1}, most_side_by_side);
      for (std::size_t i = 0; i < std::min(threads, initial.size() / width + 1); ++i) {
        lanes_.push_back(SplittingLanes::make(
            hamiltonian, composition(std::get<Splitting>(options.lagrangian).composition), {}, width));
        if (lanes_.back() == nullptr) {
          lanes_.clear();
          break;
        }
      }
    }
  }

  std::vector<OrbitEnd> run() {
#pragma omp parallel default(shared)
    take_orbits(static_cast<std::size_t>(omp_get_thread_num()));
    if (error_) {
      std::rethrow_exception(error_);
    }
    return std::move(ends_);
  }

private:
  void take_orbits(std::size_t thread) {
    const Interruptible here(flag_);
    if (!lanes_.empty() && thread >= lanes_.size()) {
      return;
    }
    SplittingLanes* const lanes = lanes_.empty() ? nullptr : lanes_[thread].get();
    const std::size_t at_once = lanes == nullptr ? 1 : lanes->width();
    for (;;) {
      const std::size_t first = next_.fetch_add(at_once);
      if (first >= initial_.size()) {
        return;
      }
      if (Interruptible::asked()) {
        std::ranges::for_each(std::span(ends_).subspan(first, std::min(at_once, ends_.size() - first)),
                              [](OrbitEnd& end) { end.interrupted = true; });
        continue;
      }
      const std::size_t last = std::min(first + at_once, initial_.size());
      if (lanes != nullptr) {
        side_by_side(*lanes, first, last);
      } else {
        alone(first);
      }
    }
  }

  void side_by_side(SplittingLanes& lanes, std::size_t first, std::size_t last) {
    const std::size_t n = hamiltonian_.degrees_of_freedom();
    std::vector<std::vector<double>> states;
    std::vector<std::size_t> numbers;
    for (std::size_t m = first; m < last; ++m) {
      const InitialState& state = initial_[m];
      std::vector<double> z = state.q;
      z.insert(z.end(), state.p.begin(), state.p.end());
      const auto finite = [](double x) { return std::isfinite(x); };
      const bool can_start = state.q.size() == n && z.size() == 2 * n && std::ranges::all_of(z, finite) &&
                             (options_.until - state.t) / options_.step > 0.0;
      if (!can_start) {
        alone(m);  // which says what is wrong
        continue;
      }
      states.push_back(std::move(z));
      numbers.push_back(m);
    }
    std::vector<SplittingLanes::Start> starts;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      starts.push_back({.z = states[i], .t = initial_[numbers[i]].t, .step = options_.step, .until = options_.until});
    }
    if (starts.empty()) {
      return;
    }
    std::vector<SplittingLanes::End> ends(starts.size());
    static_cast<void>(lanes.run(starts, options_.max_steps, ends, [] { return Interruptible::asked(); }));
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (ends[i].alone) {
        alone(numbers[i]);
      } else {
        write(ends[i], ends_[numbers[i]]);
      }
    }
  }

  static void write(const SplittingLanes::End& from, OrbitEnd& end) {
    const auto n = static_cast<std::ptrdiff_t>(from.z.size() / 2);
    end.t = from.t;
    end.q.assign(from.z.begin(), from.z.begin() + n);
    end.p.assign(from.z.begin() + n, from.z.end());
    end.steps = from.steps;
    end.interrupted = from.interrupted;
    end.discrete_energy = from.energy.first;
    const double deviation = from.energy.farthest(from.energy.first);
    end.discrete_energy_deviation =
        deviation == 0.0 ? 0.0 : deviation / std::max(std::abs(from.energy.first), from.node_energy.farthest(0.0));
    end.node_energy_deviation = from.node_energy.farthest(from.node_energy.first);
  }

  void alone(std::size_t m) {
    try {
      ends_[m] = integrate_to_end(hamiltonian_, initial_[m], options_);
    } catch (const std::exception& error) {
      const std::scoped_lock lock(failing_);
      if (!error_ || m < failed_) {
        failed_ = m;
        error_ = std::current_exception();
      }
    }
  }

  const Hamiltonian& hamiltonian_;
  std::span<const InitialState> initial_;
  const IntegrationOptions& options_;
  std::vector<OrbitEnd> ends_;
  std::vector<std::unique_ptr<SplittingLanes>> lanes_;  ///< one for each thread
  std::atomic<std::size_t> next_ = 0;
  const std::atomic<bool>* flag_ = Interruptible::flag();  ///< that ends all
  std::mutex failing_;                                     ///< of the error
  std::size_t failed_ = 0;
  std::exception_ptr error_;
};

}  // namespace

std::vector<OrbitEnd> integrate(const Hamiltonian& hamiltonian, std::span<const InitialState> initial,
                                const IntegrationOptions& options) {
  return ManyOrbits(hamiltonian, initial, options).run();
}

}  // namespace rubato
