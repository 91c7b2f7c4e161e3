#include <rubato/study/statistics.hpp>

#include <fmt/format.h>

namespace rubato::study {

void start(std::vector<Named<Deviation>>& deviations, std::span<const double> values) {
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    deviations[i].value.start(values[i]);
  }
}

void add(std::vector<Named<Deviation>>& deviations, std::span<const double> values) {
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    deviations[i].value.add(values[i]);
  }
}

void Statistics::add_level(double time, const LevelNode& node) {
  t = time;
  energy_magnitude.add(std::abs(node.energy));
  gamma.add(node.gamma);
}

void Statistics::add_start(double time, const LevelNode& node, std::span<const double> invariant_values,
                           std::span<const double> total_values) {
  add_level(time, node);
  node_energy.start(node.energy);
  start(invariants, invariant_values);
  start(totals, total_values);
}

void Statistics::add_step(const StepReport& report, double time, const LevelNode& node,
                          std::span<const double> invariant_values, std::span<const double> total_values) {
  if (steps == 0) {
    energy = report.energy;
  }
  ++steps;
  h.add(report.h);
  double& deviation = report.bridged ? bridge_deviation : energy_deviation;
  deviation = std::max(deviation, std::abs(report.energy - report.target));
  bridges += report.crossing ? 1 : 0;
  bridge_steps += report.bridged ? 1 : 0;
  condition = std::max(condition, report.bridged ? 0.0 : report.condition);
  iterations += report.iterations;
  most_iterations = std::max(most_iterations, static_cast<double>(report.iterations));
  add_level(time, node);
  node_energy.add(node.energy);
  add(invariants, invariant_values);
  add(totals, total_values);
}

std::vector<std::string> Statistics::undefined_quantities() const {
  std::vector<std::string> sentences;
  for (const auto& [name, value] : invariants) {
    if (!std::isfinite(value.initial) || !std::isfinite(value.max)) {
      sentences.push_back(fmt::format("the invariant {} is not defined at every level: correct its formula", name));
    }
  }
  for (const auto& [name, value] : errors) {
    if (!std::isfinite(value.max)) {
      sentences.push_back(
          fmt::format("the exact solution of {} is not defined at t = {:.10g}: correct its formula", name, t));
    }
  }
  return sentences;
}

template <typename Visitor>
void Statistics::visit(Visitor&& visitor) {
  visitor(steps);
  visitor(t);
  visitor(h.min);
  visitor(h.max);
  visitor(energy);
  visitor(energy_deviation);
  visitor(bridge_deviation);
  visitor(autonomous);
  visitor(energy_magnitude.min);
  visitor(energy_magnitude.max);
  visitor(node_energy.initial);
  visitor(node_energy.max);
  visitor(gamma.min);
  visitor(gamma.max);
  visitor(bridges);
  visitor(bridge_steps);
  visitor(condition);
  visitor(iterations);
  visitor(most_iterations);
  for (auto& residual : residuals) {
    visitor(residual.value.max);
    visitor(residual.value.sum_of_squares);
    visitor(residual.value.count);
  }
  for (auto* deviations : {&invariants, &totals}) {
    for (auto& deviation : *deviations) {
      visitor(deviation.value.initial);
      visitor(deviation.value.max);
    }
  }
}

void Statistics::save(StateWriter& state) const {
  Statistics copy = *this;
  copy.visit([&state](auto& value) { state.write(static_cast<double>(value)); });
}

void Statistics::restore(StateReader& state) {
  visit([&state](auto& value) { state.read(value); });
}

}  // namespace rubato::study
