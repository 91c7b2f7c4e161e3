#include <rubato/run/energy_exchange.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace rubato {

/// Less than this of the terms is no exchange to measure an error by: over short times a velocity that is a difference
/// of values has rounding errors of its own.
constexpr double least_exchange = 1e-5;

void EnergyExchange::add(std::span<const double> terms, double node_energy, double rounding, double t, double steps) {
  if (levels_.empty()) {
    first_.assign(terms.begin(), terms.end());
    first_energy_ = node_energy;
  }
  double terms_size = 0.0, exchanged = 0.0;
  for (std::size_t i = 0; i < std::min(terms.size(), first_.size()); ++i) {
    terms_size += std::abs(terms[i]);
    exchanged += std::abs(terms[i] - first_[i]);
  }
  if (first_.size() < 2) {
    exchanged = std::max(std::abs(node_energy), std::abs(first_energy_));
  }
  const double size = std::abs(node_energy) + terms_size;
  if (!std::isfinite(size) || !std::isfinite(exchanged)) {
    return;
  }
  size_ = std::max(size_, size);
  // A sum is off by a few roundings of its size, a solved step by a few more.
  constexpr double roundings = 64.0;
  const double least = roundings * rounding + std::numeric_limits<double>::epsilon() * size_ * (roundings + steps);
  const double off = std::abs(node_energy - first_energy_), error = off > least ? off : 0.0;
  if (!levels_.empty()) {
    const double half = 0.5 * std::abs(t - levels_.back().t);
    error_integral_ += half * (levels_.back().error + error);
    size_integral_ += half * (last_size_ + terms_size);
  }
  last_size_ = terms_size;
  levels_.push_back({.exchanged = exchanged, .error = error, .t = t});
}

void EnergyExchange::measure(figures::Measures& measures) const {
  double mean = 0.0;
  for (const Level& level : levels_) {
    mean += level.exchanged / static_cast<double>(levels_.size());
  }
  measures.exchanged = mean;
  for (const Level& level : levels_) {
    const double scale = std::max(level.exchanged, mean);
    if (scale > least_exchange * size_ && !(level.error / scale <= measures.energy)) {
      measures.energy = level.error / scale;
      measures.energy_t = level.t;
    }
  }
  if (remaining() > measures.energy) {
    measures.energy = remaining();
    measures.energy_t = figures::Measures::none;
  }
}

void EnergyExchange::save(StateWriter& state) const {
  state.write(static_cast<double>(first_.size()));
  state.write(first_);
  state.write(first_energy_);
  state.write(std::array{size_, last_size_, error_integral_, size_integral_});
  state.write(static_cast<double>(levels_.size()));
  for (const Level& level : levels_) {
    state.write(std::array{level.exchanged, level.error, level.t});
  }
}

void EnergyExchange::restore(StateReader& state) {
  first_.resize(static_cast<std::size_t>(state.read()));
  state.read(std::span<double>(first_));
  state.read(first_energy_);
  for (double* value : {&size_, &last_size_, &error_integral_, &size_integral_}) {
    state.read(*value);
  }
  levels_.resize(static_cast<std::size_t>(state.read()));
  for (Level& level : levels_) {
    level = {.exchanged = state.read(), .error = state.read(), .t = state.read()};
  }
}

}  // namespace rubato
