#include <rubato/figures/statistics.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace rubato::figures {

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

template <typename T>
void begin(std::vector<Named<T>>& list, const std::vector<std::string>& names) {
  list.clear();
  for (const std::string& name : names) {
    list.push_back({name, {}});
  }
}

void add(std::vector<Named<Deviation>>& deviations, std::span<const double> values) {
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    deviations[i].value.add(values[i]);
  }
}

}  // namespace

ResidualFigures ResidualFigures::of(const Spread& magnitudes) {
  return {.max = magnitudes.any() ? magnitudes.largest() : none,
          .rms = magnitudes.any() ? magnitudes.rms() : none,
          .defined = magnitudes.defined,
          .undefined = magnitudes.undefined};
}

Spread ResidualFigures::magnitudes() const {
  return Spread::of_magnitudes_with_rms(max, defined > 0.0 ? rms : 0.0, defined, undefined);
}

void Statistics::name(const std::vector<std::string>& invariant_names, const std::vector<std::string>& total_names,
                      const std::vector<std::string>& residual_names, const std::vector<std::string>& event_names) {
  begin(invariants, invariant_names);
  begin(totals, total_names);
  begin(residuals, residual_names);
  begin(events, event_names);
}

void Statistics::add_level(const LevelFigures& level) {
  if (node_energy.values.count() == 0.0) {
    start = level.t;
  }
  t = level.t;
  node_energy.add(level.node_energy);
  gamma.add(level.gamma);
}

void Statistics::add_laws(std::span<const double> invariant_values, std::span<const double> total_values) {
  add(invariants, invariant_values);
  add(totals, total_values);
}

void Statistics::add_step(const StepFigures& step) {
  first_h = steps == 0 ? step.h : first_h;
  ++steps;
  h.add(step.h);
  energies_.add(step.energy);
  // With fixed levels nothing sets E but the first step.
  const double target = std::isnan(step.target) && !step.bridged ? energy() : step.target;
  if (std::isnan(target)) {
    before_law_.add(step.energy);
  } else {
    one_energy_ = one_energy_ && (!has_law() || target == energy_);
    energy_ = has_law() ? energy_ : target;
    (step.bridged ? bridge_misses_ : misses_).add(step.energy - target);
  }
  bridges += step.crossing ? 1 : 0;
  bridge_steps += step.bridged ? 1 : 0;
  if (!step.bridged) {
    condition.add(step.condition);
  }
  rounding.add(step.rounding);
  potential.add(step.potential);
  iterations.add(step.iterations);
  all_iterations += step.iterations;
}

void Statistics::add_residual(std::size_t residual, const ResidualFigures& figures) {
  residuals[residual].value.add(figures.magnitudes());
}

double Statistics::potential_kappa() const {
  return potential_length / std::abs(first_h);
}

double Statistics::bridge_deviation() const {
  return std::max(bridge_misses_.largest(), before_law_.farthest(energy()));
}

double Statistics::energy_scale() const {
  return std::max(steps > 0 ? std::abs(energy()) : 0.0, node_energy.values.largest());
}

bool Statistics::has_energy_scale() const {
  // A scale that itself is known to two digits at most makes every deviation look large.
  constexpr double least = 100.0;
  const double scale = energy_scale();
  return scale > 0.0 && scale > least * rounding.largest();
}

std::optional<double> Statistics::relative(double deviation) const {
  if (!has_energy_scale()) {
    return std::nullopt;
  }
  return deviation / energy_scale();
}

const Named<EventFigures>* Statistics::stopped_by() const {
  const Named<EventFigures>* found = nullptr;
  for (const Named<EventFigures>& event : events) {
    if (event.value.stops() && (found == nullptr || (event.value.stopped - found->value.stopped) * (t - start) < 0.0)) {
      found = &event;
    }
  }
  return found;
}

std::vector<std::string> Statistics::undefined_quantities() const {
  std::vector<std::string> sentences;
  for (const auto& [name, value] : residuals) {
    if (value.undefined > 0.0) {
      sentences.push_back(fmt::format(
          "the residual of {} has no value in {:.0f} of {:.0f} cells (of all steps together): a formula left its "
          "domain there; what is told of it is of the other cells",
          name, value.undefined, value.count()));
    }
  }
  for (const auto& [kind, list] : {std::pair("invariant", &invariants), std::pair("total of", &totals)}) {
    for (const auto& [name, value] : *list) {
      if (value.values.undefined > 0.0) {
        sentences.push_back(
            fmt::format("the {} {} is not defined at every level: it has no value at {:.0f} of {:.0f}; "
                        "correct its formula",
                        kind, name, value.values.undefined, value.values.count()));
      }
    }
  }
  for (const auto& [name, value] : events) {
    if (value.undefined > 0) {
      sentences.push_back(fmt::format(
          "the formula of event {} is not defined in {} of {} steps: what crossings these have is not known; keep it "
          "from leaving its domain",
          name, value.undefined, steps));
    }
    if (value.jumps > 0) {
      sentences.push_back(
          fmt::format("the formula of event {} jumps through zero in {} of {} steps, as at a pole: these are not "
                      "counted as crossings",
                      name, value.jumps, steps));
    }
    if (value.incomplete > 0) {
      sentences.push_back(
          fmt::format("at {} of {} crossings of event {} a quantity is not defined: correct its formula",
                      value.incomplete, value.count, name));
    }
  }
  for (const auto& [name, value] : errors) {
    if (value.undefined > 0.0) {
      sentences.push_back(fmt::format(
          "the exact solution of {} is not defined at t = {:.10g}{}: correct its formula", name, t,
          value.count() > 1.0 ? fmt::format(" at {:.0f} of {:.0f} nodes", value.undefined, value.count()) : ""));
    }
  }
  return sentences;
}

template <typename Self, typename Visitor>
void Statistics::visit(Self& self, Visitor&& visitor) {
  const auto spread = [&](auto& value) { Spread::visit(value, visitor); };
  const auto deviation = [&](auto& value) {
    visitor(value.initial);
    spread(value.values);
  };
  visitor(self.steps);
  visitor(self.t);
  visitor(self.start);
  spread(self.h);
  visitor(self.first_h);
  deviation(self.node_energy);
  spread(self.gamma);
  visitor(self.bridges);
  visitor(self.bridge_steps);
  spread(self.condition);
  spread(self.rounding);
  spread(self.potential);
  spread(self.iterations);
  visitor(self.all_iterations);
  visitor(self.energy_);
  visitor(self.one_energy_);
  deviation(self.energies_);
  spread(self.misses_);
  spread(self.bridge_misses_);
  spread(self.before_law_);
  for (auto& [name, value] : self.residuals) {
    spread(value);
  }
  for (auto* list : {&self.invariants, &self.totals}) {
    for (auto& [name, value] : *list) {
      deviation(value);
    }
  }
  for (auto& [name, value] : self.events) {
    visitor(value.count);
    visitor(value.first);
    visitor(value.last);
    visitor(value.stopped);
    visitor(value.undefined);
    visitor(value.jumps);
    visitor(value.incomplete);
  }
}

void Statistics::save(StateWriter& state) const {
  visit(*this, [&state](const auto& value) { state.write(static_cast<double>(value)); });
}

void Statistics::restore(StateReader& state) {
  visit(*this, [&state](auto& value) { state.read(value); });
}

}  // namespace rubato::figures
