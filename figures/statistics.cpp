#include <rubato/figures/statistics.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <type_traits>

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
                      const std::vector<std::string>& residual_names, const std::vector<std::string>& event_names,
                      const std::vector<std::string>& vector_names) {
  begin(growth, vector_names);
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

void Statistics::add_balances(std::span<const double> total_values) {
  for (std::size_t i = 0; i < totals.size(); ++i) {
    if (is_balance(totals[i].name)) {
      totals[i].value.add(total_values[i]);
    }
  }
}

void Statistics::add_step(const StepFigures& step) {
  first_h = steps == 0 ? step.h : first_h;
  ++steps;
  h.add(step.h);
  energies_.add(step.energy);
  // With fixed levels nothing sets E but the first step.
  const double target = std::isnan(step.target) && !step.off_law ? energy() : step.target;
  if (std::isnan(target)) {
    before_law_.add(step.energy);
  } else {
    one_energy_ = one_energy_ && (!has_law() || target == energy_);
    energy_ = has_law() ? energy_ : target;
    (step.off_law ? off_law_misses_ : misses_).add(step.energy - target);
  }
  off_law_steps += step.off_law ? 1 : 0;
  if (!step.off_law) {
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

void Statistics::add_tangents(double length, std::span<const double> logarithms, double defect) {
  const double size = std::abs(length), before = tangents.time;
  for (std::size_t i = 0; i < growth.size(); ++i) {
    growth[i].value += logarithms[i];
  }
  tangents.time += size;
  tangents.weighted += (before + 0.5 * size) * logarithms[0];
  tangents.megno += 2.0 * tangents.weighted / tangents.time * size;
  if (growth.size() > 1) {
    tangents.defect.add(defect);
  }
}

double Statistics::potential_kappa() const {
  return potential_length / std::abs(first_h);
}

double Statistics::off_law_deviation() const {
  return std::max(off_law_misses_.largest(), before_law_.farthest(energy()));
}

double Statistics::energy_scale() const {
  double scale = std::max(steps > 0 ? std::abs(energy()) : 0.0, node_energy.values.largest());
  for (const auto& [name, total] : totals) {
    scale = is_balance(name) ? std::max(scale, total.values.largest()) : scale;
  }
  return scale;
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
  if (!growth.empty() && !std::isfinite(growth.front().value)) {
    sentences.emplace_back(
        "the tangent of a step could not be taken, and there are no exponents: a second derivative of H is not defined "
        "there, or the step degenerates; take smaller steps");
  }
  for (const auto& [name, value] : residuals) {
    if (value.undefined > 0.0) {
      sentences.push_back(fmt::format(
          "the residual of {} has no value in {:.0f} of {:.0f} cells (of all steps together): a formula left its "
          "domain there; its figures are of the other cells",
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
    if (value.several > 0) {
      sentences.push_back(
          fmt::format("event {} has several crossings within {} of {} steps: pairs of crossings may be missing; "
                      "compare with half the step",
                      name, value.several, steps));
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
  visitor(self.off_law_steps);
  spread(self.condition);
  spread(self.rounding);
  spread(self.potential);
  spread(self.iterations);
  visitor(self.all_iterations);
  visitor(self.energy_);
  visitor(self.one_energy_);
  deviation(self.energies_);
  spread(self.misses_);
  spread(self.off_law_misses_);
  spread(self.before_law_);
  for (auto& [name, value] : self.residuals) {
    spread(value);
  }
  for (auto* list : {&self.invariants, &self.totals}) {
    for (auto& [name, value] : *list) {
      deviation(value);
    }
  }
  for (auto& [name, value] : self.growth) {
    visitor(value);
  }
  if (!self.growth.empty()) {
    visitor(self.tangents.time);
    visitor(self.tangents.weighted);
    visitor(self.tangents.megno);
    spread(self.tangents.defect);
  }
  for (auto& [name, value] : self.events) {
    visitor(value.count);
    visitor(value.first);
    visitor(value.last);
    visitor(value.stopped);
    visitor(value.undefined);
    visitor(value.jumps);
    visitor(value.several);
    visitor(value.incomplete);
  }
}

template <typename Self, typename Visitor>
void Statistics::visit_later(Self& self, Visitor&& visitor) {
  for (auto& [name, value] : self.events) {
    visitor(value.returned);
  }
}

std::string growth_path(std::string_view name) {
  return fmt::format("/tangents/growth_{}", name);
}

void Statistics::save(StateWriter& state) const {
  const auto write = [&state](const auto& value) { state.write(static_cast<double>(value)); };
  visit(*this, write);
  visit_later(*this, write);
}

void Statistics::restore(StateReader& state) {
  restore(state, true);
}

void Statistics::restore(StateReader& state, bool all) {
  const auto read = [&state]<typename T>(T& value) {
    const double number = state.read();
    if constexpr (std::is_same_v<T, std::size_t>) {
      constexpr double most = 0x1p53;  // from there on doubles are not all whole numbers
      value = number >= 0.0 && number < most ? static_cast<T>(number) : 0;
    } else {
      value = static_cast<T>(number);
    }
  };
  visit(*this, read);
  if (all || !state.done()) {
    visit_later(*this, read);
  }
}

std::vector<double> Statistics::values() const {
  StateWriter state;
  state.write(static_cast<double>(laws_every));
  save(state);
  return state.values();
}

namespace {

/// The lists, in the order of Statistics::name().
constexpr std::array<std::string_view, 5> list_words = {"invariant", "total", "residual", "event", "vector"};

}  // namespace

std::string Statistics::names_text() const {
  std::string text;
  const auto add = [&text](std::string_view word, const auto& list) {
    for (const auto& [name, value] : list) {
      text += fmt::format("{} {}\n", word, name);
    }
  };
  add(list_words[0], invariants);
  add(list_words[1], totals);
  add(list_words[2], residuals);
  add(list_words[3], events);
  add(list_words[4], growth);
  return text;
}

Statistics Statistics::of(std::span<const double> values, std::string_view names_text) {
  std::array<std::vector<std::string>, list_words.size()> names;
  while (!names_text.empty()) {
    const std::string_view line = names_text.substr(0, names_text.find('\n'));
    const auto list = std::ranges::find(list_words, line.substr(0, line.find(' ')));
    if (list == list_words.end() || line.size() <= list->size() || line.size() == names_text.size()) {
      throw std::invalid_argument("these are not the names of statistics");
    }
    names[static_cast<std::size_t>(list - list_words.begin())].emplace_back(line.substr(list->size() + 1));
    names_text.remove_prefix(line.size() + 1);
  }
  Statistics statistics;
  statistics.name(names[0], names[1], names[2], names[3], names[4]);
  StateReader state{values};
  statistics.laws_every = static_cast<std::size_t>(std::fmin(std::fmax(state.read(), 0.0), 0x1p53));
  statistics.restore(state, false);
  if (!state.done()) {
    throw std::invalid_argument("saved statistics are longer than their names say");
  }
  return statistics;
}

std::vector<std::pair<std::string, Spread>> Statistics::spreads() const {
  std::vector<std::pair<std::string, Spread>> all = {{"/levels/node_energy", node_energy.values},
                                                     {"/levels/gamma", gamma},
                                                     {"/levels/h", h},
                                                     {"/levels/energy", energies_.values},
                                                     {"/levels/rounding", rounding},
                                                     {"/levels/step_condition", condition},
                                                     {"/levels/step_potential", potential},
                                                     {"/levels/iterations", iterations}};
  for (const auto& [name, value] : invariants) {
    all.emplace_back("/laws/" + name, value.values);
  }
  for (const auto& [name, value] : totals) {
    all.emplace_back("/laws/totals/" + name, value.values);
  }
  for (const auto& [name, value] : residuals) {
    all.emplace_back(fmt::format("/laws/{}_max", name), value);
  }
  if (growth.size() > 1) {
    all.emplace_back(two_form_path, tangents.defect);
  }
  return all;
}

}  // namespace rubato::figures
