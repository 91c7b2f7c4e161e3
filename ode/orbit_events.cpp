#include <rubato/ode/orbit_events.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

namespace rubato {

OrbitEvents::OrbitEvents(OrbitBetween between, std::vector<formula::Expression> arguments,
                         std::optional<Hamiltonian> rates, std::unique_ptr<OneStepScheme> velocities)
    : between_(std::move(between)), variables_(std::move(arguments)), velocities_(std::move(velocities)) {
  if (rates) {
    rates_.emplace(*rates);
    gradient_.resize(rates_->dimension());
  }
}

void OrbitEvents::add(formula::Expression g, Direction direction) {
  std::vector<formula::Expression> outputs{g};
  if (rates_) {
    std::ranges::copy(formula::gradient(g, variables_), std::back_inserter(outputs));
  }
  events_.push_back(
      {.search = CrossingSearch(direction), .g = formula::ScalarEvaluator(formula::Bytecode(outputs, variables_))});
}

std::span<const double> OrbitEvents::arguments(std::span<const double> z, double t) {
  const std::size_t n = z.size() / 2;
  arguments_.assign(z.begin(), z.end());
  if (velocities_ != nullptr) {
    velocities_->restart(z);
    const auto velocities = velocities_->velocities();
    arguments_.insert(arguments_.begin() + static_cast<std::ptrdiff_t>(n), velocities.begin(), velocities.end());
  }
  arguments_.resize(variables_.size(), t);
  return arguments_;
}

/// g of the arguments that are there, and by the chain rule dg/dfraction = h (∇g·J∇H + g_t), with the gradient of
/// H that is there.
CrossingSearch::Sample OrbitEvents::sample(Event& event, double h, double fraction) {
  std::ranges::copy(arguments_, event.g.inputs().begin());
  event.g.run();
  CrossingSearch::Sample sample{.fraction = fraction, .value = event.g.output(0)};
  if (rates_) {
    const std::size_t n = gradient_.size() / 2;
    double rate = variables_.size() > 2 * n ? event.g.output(1 + 2 * n) : 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      rate += event.g.output(1 + i) * gradient_[n + i] - event.g.output(1 + n + i) * gradient_[i];
    }
    sample.rate = h * rate;
  }
  return sample;
}

void OrbitEvents::begin(std::span<const double> z, double t) {
  static_cast<void>(arguments(z, t));
  for (Event& event : events_) {
    std::ranges::copy(arguments_, event.g.inputs().begin());
    event.g.run();
    event.first = event.g.output(0);
    event.search.begin(event.first);
  }
}

void OrbitEvents::follow(const OrbitStep& step) {
  const auto look_at = [&](std::span<const double> z, double t, double fraction, CrossingSearch::Sample Event::*place) {
    static_cast<void>(arguments(z, t));
    if (rates_) {
      rates_->gradient(z.data(), gradient_.data());
    }
    for (Event& event : events_) {
      event.*place = sample(event, step.h, fraction);
    }
  };
  look_at(step.z_0, step.t_0, 0.0, &Event::from);
  look_at(step.z_1, step.t_1, 1.0, &Event::to);
  search(step);
}

void OrbitEvents::follow(const OrbitStep& step, std::span<const CrossingSearch::Sample> from,
                         std::span<const CrossingSearch::Sample> to) {
  for (std::size_t i = 0; i < events_.size(); ++i) {
    events_[i].from = from[i];
    events_[i].to = to[i];
  }
  search(step);
}

void OrbitEvents::search(const OrbitStep& step) {
  for (Event& event : events_) {
    const auto between = [this, &step, &event](double fraction) -> CrossingSearch::Sample {
      const std::span<const double> z = state(step, fraction);
      if (!std::isfinite(z.front())) {
        return {fraction, std::numeric_limits<double>::quiet_NaN()};
      }
      static_cast<void>(arguments(z, step.time(fraction)));
      if (rates_) {
        rates_->gradient(z.data(), gradient_.data());
      }
      return sample(event, step.h, fraction);
    };
    event.found = &event.search.follow(step.h, event.from, event.to, std::cref(between));  // which allocates nothing
  }
}

std::span<const double> OrbitEvents::state(const OrbitStep& step, double fraction) {
  z_.resize(step.z_0.size());
  // What fails is not a number.
  static_cast<void>(between_.at(step.z_0, step.z_1, step.h, fraction, z_));
  return z_;
}

void OrbitEvents::save(StateWriter& state) const {
  for (const Event& event : events_) {
    event.search.save(state);
  }
  between_.save(state);
  if (velocities_ != nullptr) {
    velocities_->save_guesses(state);
  }
}

void OrbitEvents::restore(StateReader& state) {
  for (Event& event : events_) {
    event.search.restore(state);
  }
  between_.restore(state);
  if (velocities_ != nullptr) {
    velocities_->restore_guesses(state);
  }
}

}  // namespace rubato
