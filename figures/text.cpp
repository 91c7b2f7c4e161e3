#include <rubato/figures/text.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/quoted.hpp>

namespace rubato::figures {

namespace {

std::string array_of(const std::vector<std::string>& texts) {
  std::string array;
  for (const std::string& one : texts) {
    array += (array.empty() ? "" : ", ") + rubato::quoted(one);
  }
  return "[" + array + "]";
}

JsonObject range(const Spread& values) {
  return values.any() ? JsonObject().number("min", values.min).number("max", values.max) : JsonObject();
}

JsonObject& add_undefined(JsonObject& object, const Spread& values) {
  return values.undefined > 0.0 ? object.count("undefined", static_cast<std::size_t>(values.undefined))
                                      .count("count", static_cast<std::size_t>(values.count()))
                                : object;
}

JsonObject json(const Spread& magnitudes) {
  JsonObject object;
  if (magnitudes.any()) {
    object.number("max", magnitudes.largest()).number("rms", magnitudes.rms());
  }
  return add_undefined(object, magnitudes);
}

/// The constraints among the residuals, without the name of their group; and all others.
///@{
std::vector<Named<Spread>> constraints_of(const Statistics& statistics) {
  std::vector<Named<Spread>> constraints;
  for (const auto& [name, value] : statistics.residuals) {
    if (name.starts_with(constraint_group)) {
      constraints.push_back({name.substr(constraint_group.size()), value});
    }
  }
  return constraints;
}
std::vector<Named<Spread>> other_residuals(const Statistics& statistics) {
  std::vector<Named<Spread>> others;
  std::ranges::copy_if(statistics.residuals, std::back_inserter(others),
                       [](const Named<Spread>& residual) { return !residual.name.starts_with(constraint_group); });
  return others;
}
///@}

JsonObject json(const Deviation& deviation) {
  JsonObject object;
  if (deviation.has_initial()) {
    object.number("initial", deviation.initial).number("max_deviation", deviation.max());
  }
  return add_undefined(object, deviation.values);
}

JsonObject json(const EventFigures& event) {
  JsonObject object;
  object.count("count", event.count).number("first", event.first).number("last", event.last);
  for (const auto& [key, value] : {std::pair("undefined", event.undefined),
                                   std::pair("jumps", event.jumps),
                                   {"incomplete", event.incomplete},
                                   {"returned", event.returned}}) {
    if (value > 0) {
      object.count(key, value);
    }
  }
  return object;
}

template <typename T>
JsonObject json(const std::vector<Named<T>>& values) {
  JsonObject object;
  for (const auto& [name, value] : values) {
    object.object(name, json(value));
  }
  return object;
}

/// euler-box has none: it chooses no levels, and is reported as 0.
bool has_gamma(const Statistics& statistics) {
  return statistics.gamma.any() && (statistics.variable_levels() || statistics.gamma.largest() != 0.0);
}

JsonObject potential_json(const Statistics& statistics) {
  JsonObject object;
  object.number("max", statistics.potential.largest());
  if (const double kappa = statistics.potential_kappa(); kappa == kappa) {
    object.number("kappa", kappa).number("p", statistics.potential_exponent);
  }
  return object.number("from", statistics.potential.min).number("to", statistics.potential.max);
}

JsonObject energy_json(const Statistics& statistics) {
  JsonObject object;
  if (!statistics.autonomous()) {
    return object.number("value", statistics.first_energy()).number("max_balance", statistics.energy_deviation());
  }
  if (!statistics.has_law()) {
    return range(statistics.energies());
  }
  object.number("value", statistics.energy());
  if (const auto relative = statistics.relative_energy_deviation()) {
    object.number("max_relative_deviation", *relative);
  }
  object.number("max_deviation", statistics.energy_deviation());
  if (statistics.balance) {
    object.number("max_balance", statistics.energy_deviation());
  }
  return object.count("law_steps", statistics.law_steps()).count("steps", statistics.steps);
}

JsonObject off_law_json(const Statistics& statistics) {
  JsonObject object;
  object.count("steps", statistics.off_law_steps);
  const double deviation = statistics.off_law_deviation();
  const auto relative = deviation == 0.0 ? std::optional(0.0) : statistics.relative(deviation);
  return object.number(relative ? "max_deviation" : "max_absolute_deviation", relative.value_or(deviation));
}

std::string with_undefined(std::string text, const Spread& values, std::string_view what) {
  if (values.undefined > 0.0) {
    text += fmt::format("{}no value in {:.0f} of {:.0f} {}", text.empty() ? "" : "; ", values.undefined, values.count(),
                        what);
  }
  return text;
}

std::string max_rms(const Spread& magnitudes) {
  if (magnitudes.count() == 0.0) {
    return "none taken";
  }
  return magnitudes.any() ? fmt::format("max {:.3g}, rms {:.3g}", magnitudes.largest(), magnitudes.rms()) : "";
}

std::string deviation_text(const Deviation& deviation) {
  return with_undefined(deviation.has_initial()
                            ? fmt::format("{:.10g}, deviation {:.3g}", deviation.initial, deviation.max())
                            : "undefined at the start",
                        deviation.values, "levels");
}

std::string event_text(const EventFigures& event, std::size_t steps) {
  std::string text = event.count == 0 ? "none"
                     : event.count == 1
                         ? fmt::format("1, at t = {:.10g}", event.first)
                         : fmt::format("{}, from t = {:.10g} to {:.10g}", event.count, event.first, event.last);
  if (event.undefined > 0) {
    text += fmt::format("; not defined in {} of {} steps", event.undefined, steps);
  }
  if (event.jumps > 0) {
    text += fmt::format("; {} jumps not counted", event.jumps);
  }
  return text;
}

/// A deviation of energy, relative where that says something.
std::string energy_deviation_text(const Statistics& statistics, double deviation) {
  const auto relative = statistics.relative(deviation);
  return relative
             ? fmt::format("relative deviation {:.2g}", *relative)
             : fmt::format("deviation {:.2g} (absolute: rounding leaves the energies at most two digits)", deviation);
}

/// The farthest from 0.
double largest_of(const Deviation& lost) {
  return -lost.values.min > lost.values.max ? lost.values.min : lost.values.max;
}

/// What a sponge has taken; null without one.
const Deviation* energy_lost(const Statistics& statistics) {
  const auto found = std::ranges::find(statistics.totals, energy_lost_name, &Named<Deviation>::name);
  return found == statistics.totals.end() ? nullptr : &found->value;
}

std::string energy_text(const Statistics& statistics) {
  if (!statistics.autonomous()) {
    return fmt::format("depends on t; largest imbalance of (3.4): {:.2g}", statistics.energy_deviation());
  }
  if (!statistics.has_law()) {
    return fmt::format("no step met the energy law; E_k from {:.6g} to {:.6g}", statistics.energies().min,
                       statistics.energies().max);
  }
  const std::string deviation = energy_deviation_text(statistics, statistics.energy_deviation());
  return statistics.law_steps() < statistics.off_law_steps
             ? fmt::format("{:.15g}, met on {} of {} steps only ({})", statistics.energy(), statistics.law_steps(),
                           statistics.steps, deviation)
             : fmt::format("{:.15g}, {}", statistics.energy(), deviation);
}

std::string off_law_text(const Statistics& statistics) {
  const double deviation = statistics.off_law_deviation();
  const auto relative = statistics.relative(deviation);
  return fmt::format("{} of {}, {} deviation {:.2g} on them{}", statistics.off_law_steps, statistics.steps,
                     relative ? "relative" : "absolute", relative.value_or(deviation),
                     statistics.has_law() ? "" : " (from the first step)");
}

}  // namespace

JsonObject& JsonObject::number(std::string_view key, double value) {
  if (!std::isfinite(value)) {
    return *this;
  }
  numbers_.emplace_back(key, value);
  return raw(key, fmt::format("{:.17g}", value));
}
JsonObject& JsonObject::numbers(std::string_view key, const std::vector<double>& values) {
  if (values.empty() || !std::ranges::all_of(values, [](double value) { return std::isfinite(value); })) {
    return *this;
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    numbers_.emplace_back(fmt::format("{}/{}", key, i + 1), values[i]);
  }
  return raw(key, fmt::format("[{:.17g}]", fmt::join(values, ", ")));
}
JsonObject& JsonObject::count(std::string_view key, std::size_t value) {
  numbers_.emplace_back(key, static_cast<double>(value));
  return raw(key, fmt::format("{}", value));
}
JsonObject& JsonObject::text(std::string_view key, std::string_view value) {
  return raw(key, rubato::quoted(value));
}
JsonObject& JsonObject::flag(std::string_view key, bool value) {
  return value ? raw(key, "true") : *this;
}
JsonObject& JsonObject::object(std::string_view key, const JsonObject& value) {
  for (const auto& [path, number] : value.numbers_) {
    numbers_.emplace_back(fmt::format("{}/{}", key, path), number);
  }
  return value.body_.empty() ? *this : raw(key, value.str());
}
std::optional<double> JsonObject::find(std::string_view path) const {
  const auto found =
      std::ranges::find(numbers_, path, [](const auto& number) { return std::string_view(number.first); });
  return found == numbers_.end() ? std::nullopt : std::optional(found->second);
}
JsonObject& JsonObject::objects(std::string_view key, const std::vector<JsonObject>& values) {
  std::string array;
  for (const JsonObject& value : values) {
    array += (array.empty() ? "" : ", ") + value.str();
  }
  return raw(key, "[" + array + "]");
}
JsonObject& JsonObject::texts(std::string_view key, const std::vector<std::string>& texts) {
  return texts.empty() ? *this : raw(key, array_of(texts));
}
JsonObject& JsonObject::lists(std::string_view key, const std::vector<std::vector<std::string>>& lists) {
  std::string array;
  for (const std::vector<std::string>& list : lists) {
    array += (array.empty() ? "" : ", ") + array_of(list);
  }
  return raw(key, "[" + array + "]");
}
JsonObject& JsonObject::raw(std::string_view key, std::string_view value) {
  body_ += fmt::format("{}{}: {}", body_.empty() ? "" : ", ", rubato::quoted(key), value);
  return *this;
}

JsonObject json(const Reason& reason) {
  JsonObject object;
  return object.text("what", to_string(reason.kind))
      .text("verdict", to_string(reason.verdict))
      .number("value", reason.value)
      .text("finding", reason.finding)
      .text("remedy", reason.remedy);
}

namespace {

std::vector<JsonObject> json(const std::vector<Reason>& reasons) {
  std::vector<JsonObject> objects;
  for (const Reason& reason : reasons) {
    objects.push_back(figures::json(reason));
  }
  return objects;
}

std::vector<double> exponents_of(const Statistics& statistics) {
  std::vector<double> exponents;
  for (std::size_t i = 0; i < statistics.growth.size(); ++i) {
    exponents.push_back(statistics.exponent(i));
  }
  return exponents;
}

void add_verdict(JsonObject& object, const Statistics& statistics) {
  const Judgement judgement = judge(statistics);
  object.text("verdict", to_string(judgement.verdict)).objects("reasons", json(judgement.reasons));
  if (!judgement.accepted.empty()) {
    object.objects("accepted", json(judgement.accepted));
  }
}

}  // namespace

void add_figures(JsonObject& object, const Statistics& statistics) {
  object.count("steps", statistics.steps);
  object.number("t", statistics.has_clock() ? statistics.clock : statistics.t);
  if (statistics.has_clock()) {
    object.number("fictitious_time", statistics.t);
  }
  if (statistics.steps > 0) {
    object.object("h", range(statistics.h));
    object.object("discrete_energy", energy_json(statistics));
  }
  if (statistics.potential.largest() > 0.0) {
    object.object("step_potential", potential_json(statistics));
  }
  object.object("node_energy", json(statistics.node_energy));
  if (statistics.variable_levels()) {
    object.object("off_law", off_law_json(statistics));
  }
  if (has_gamma(statistics)) {
    JsonObject gamma = range(statistics.gamma);
    object.object("gamma", add_undefined(gamma, statistics.gamma));
  }
  if (statistics.condition.any()) {
    object.object("step_condition", JsonObject().number("max", statistics.condition.max));
  }
  if (statistics.all_iterations > 0.0) {
    object.object("newton_iterations",
                  JsonObject()
                      .number("mean", statistics.all_iterations / static_cast<double>(statistics.steps))
                      .number("max", statistics.iterations.max));
  }
  if (statistics.has_gaps() && statistics.has_laws()) {
    JsonObject laws;
    laws.count("every", statistics.laws_every).count("steps", statistics.law_steps_taken());
    object.object("laws", laws);
  }
  object.object("constraints", json(constraints_of(statistics)));
  object.object("residuals", json(other_residuals(statistics)));
  if (!statistics.growth.empty() && statistics.tangents.time > 0.0) {
    JsonObject lyapunov;
    lyapunov.numbers("exponents", exponents_of(statistics)).number("megno", statistics.megno());
    object.object("lyapunov", lyapunov);
    JsonObject defect;
    if (statistics.tangents.defect.any()) {
      defect.number("max", statistics.tangents.defect.largest());
    }
    object.object("symplecticity", defect);
  }
  object.object("invariants", json(statistics.invariants));
  object.object("totals", json(statistics.totals));
  if (const auto* const lost = energy_lost(statistics)) {
    JsonObject sponge;
    object.object("sponge", sponge.number("energy_lost", largest_of(*lost)));
  }
  object.object("events", json(statistics.events));
  if (const auto* event = statistics.stopped_by()) {
    JsonObject stopped;
    stopped.text("event", event->name).number("t", event->value.stopped);
    object.object("stopped", stopped);
  }
  object.object("error", json(statistics.errors));
  if (const Measures& measures = statistics.measures; measures.seam > 0.0) {
    object.object("seam", JsonObject().number("max", measures.seam).number("t", measures.seam_t));
  }
  add_verdict(object, statistics);
}

namespace {

using Kind = LineKind;

constexpr std::array entries = {
    LineEntry{Kind::steps, "steps", "Number of steps, and the time of the last level."},
    LineEntry{Kind::h, "h", "The shortest and the longest step."},
    LineEntry{
        Kind::discrete_energy, "discrete energy",
        "E_k, the energy of a step by its discrete Lagrangian, and its largest deviation, relative where the energy is "
        "not zero. Variable levels keep it to rounding error; with equal levels it shows the truncation error."},
    LineEntry{Kind::energy_less_work, "energy less work",
              "For a problem that depends on t: E_k minus the work done so far. The balance of energy keeps it."},
    LineEntry{Kind::step_potential, "step potential",
              "Range of f'(h), the part of the discrete energy that the step potential adds. Small beside the energy "
              "is best."},
    LineEntry{
        Kind::node_energy, "node energy H(z_k)",
        "H at the levels: the first value, and the largest deviation, which is a truncation error. It should not grow "
        "with the length of the run."},
    LineEntry{Kind::node_energy_in_fictitious_time, "node energy g(H - E)",
              "The same with time_scale, for the Hamiltonian of fictitious time."},
    LineEntry{Kind::node_energy_less_work, "H(z_k, t_k) less work", "The same for a problem that depends on t."},
    LineEntry{
        Kind::gamma, "Gamma",
        "Range of Gamma at the levels, which sets the lengths of variable steps: long where it is small. Where it is 0 "
        "only the step potential gives a solution."},
    LineEntry{
        Kind::off_law, "steps off the law",
        "Number of plain steps, taken where no step keeps the discrete energy, and its largest deviation on them. Zero "
        "is best."},
    LineEntry{Kind::step_condition, "step condition",
              "The largest relative error of h, from the tolerance of the energy and from rounding errors. Above 1e-6 "
              "the run "
              "warns."},
    LineEntry{Kind::laws, "laws", "With [laws] every: the number of steps in the lines below."},
    LineEntry{
        Kind::residual, "residual NAME",
        "Residual of a local law in one cell over one step: the largest, and the root mean square over all cells and "
        "steps. Laws of energy, momentum and symmetries; variational_ laws belong to single nodes, multisymplectic "
        "to two tangent solutions (--tangents); step_equation (check) is the scheme's own equation."},
    LineEntry{Kind::constraint, "constraint NAME",
              "An entry of [constraints], and with _dot its rate, the hidden constraint: the largest magnitude at a "
              "level, and the root mean square."},
    LineEntry{Kind::exponents, "Lyapunov exponents",
              "With [scheme] tangents: mean growth rates of the tangent vectors, of all the time so far. They converge "
              "slowly: of a regular orbit like ln(t)/t to 0."},
    LineEntry{Kind::megno, "MEGNO",
              "Mean exponential growth of nearby orbits, averaged over the time: about 2 on a regular orbit, and half "
              "the largest exponent times t on a chaotic one."},
    LineEntry{
        Kind::symplecticity, "two-form",
        "The largest change of dp^dq of two of these vectors in a step, in units of their lengths: rounding error."},
    LineEntry{
        Kind::sponge, "sponge",
        "The energy that the layers of [grid] sponge have taken. E_k and H(z_k) are reported with it: their sum is "
        "what the energy law keeps."},
    LineEntry{Kind::total, "total NAME",
              "Density of a local law, summed over the grid: first value and largest deviation."},
    LineEntry{Kind::invariant, "NAME", "An entry of [invariants]: first value and largest deviation."},
    LineEntry{Kind::event, "event NAME", "Number of crossings of an event, and the times of the first and the last."},
    LineEntry{Kind::ended_by, "ended by", "The event that ended the run."},
    LineEntry{Kind::error, "error in NAME",
              "Difference from [exact] at the last level: the largest, and the root mean square over the nodes."},
    LineEntry{Kind::iterations, "iterations per step", "Evaluations or sweeps of a step: mean and largest number."},
    LineEntry{Kind::seam, "at the seam",
              "The largest value of the wave at the ends of the grid, relative to its maximum."},
    LineEntry{Kind::verdict, "verdict",
              "good, doubtful or lost, with reasons and remedies. It uses the laws of the run, which do not measure "
              "the error "
              "of the solution."},
    LineEntry{Kind::time_taken, "time taken", "Wall time of the run."},
    LineEntry{Kind::accuracy, "accuracy", "Without [exact]: the command that estimates the error."},
    LineEntry{Kind::record, "record", "The file that was written."},
};
static_assert(std::ranges::all_of(entries, [](const LineEntry& entry) {
  return &entry == &entries[static_cast<std::size_t>(entry.kind)];
}));

}  // namespace

std::span<const LineEntry> line_entries() {
  return entries;
}

std::string label_of(LineKind kind, std::string_view name) {
  std::string label(entries[static_cast<std::size_t>(kind)].label);
  constexpr std::string_view placeholder = "NAME";
  if (const std::size_t place = label.find(placeholder); place != std::string::npos) {
    label.replace(place, placeholder.size(), name);
  }
  return label;
}

std::vector<Line> lines_of(const Statistics& statistics) {
  std::vector<Line> lines;
  const auto add_named = [&lines](LineKind kind, std::string_view name, std::string value, std::string remark = {},
                                  bool is_headline = false) {
    lines.push_back({label_of(kind, name), std::move(value), std::move(remark), is_headline});
  };
  const auto add = [&add_named](LineKind kind, std::string value, std::string remark = {}, bool is_headline = false) {
    add_named(kind, {}, std::move(value), std::move(remark), is_headline);
  };
  constexpr bool headline = true;
  if (statistics.has_clock()) {
    add(Kind::steps,
        fmt::format("{}, to t = {:.10g}, in fictitious time {:.10g}", statistics.steps, statistics.clock, statistics.t),
        fmt::format("from t = {:.10g}", statistics.clock_start), headline);
  } else {
    add(Kind::steps, fmt::format("{}, to t = {:.10g}", statistics.steps, statistics.t),
        fmt::format("from t = {:.10g}", statistics.start), headline);
  }
  if (statistics.steps > 0) {
    add(Kind::h,
        fmt::format("{:.6g} to {:.6g}{}", statistics.h.min, statistics.h.max,
                    statistics.has_clock() ? ", in fictitious time" : ""),
        "step length", headline);
    if (statistics.balance) {
      add(Kind::energy_less_work, energy_text(statistics), "E_k - W, which the balance (3.4) of a driven system keeps",
          headline);
    } else {
      add(Kind::discrete_energy, energy_text(statistics), "E_k, which the law keeps", headline);
    }
  }
  if (statistics.potential.largest() > 0.0) {
    add(Kind::step_potential,
        fmt::format("{:.3g} to {:.3g}, in the discrete energy", statistics.potential.min, statistics.potential.max),
        "f'(h)", headline);
  }
  add(statistics.balance       ? Kind::node_energy_less_work
      : statistics.has_clock() ? Kind::node_energy_in_fictitious_time
                               : Kind::node_energy,
      deviation_text(statistics.node_energy), "at the levels", headline);
  if (has_gamma(statistics)) {
    add(Kind::gamma,
        with_undefined(fmt::format("{:.6g} to {:.6g}", statistics.gamma.min, statistics.gamma.max), statistics.gamma,
                       "levels"),
        "at the levels", headline);
  }
  if (statistics.off_law_steps > 0) {
    add(Kind::off_law, off_law_text(statistics), "plain steps, where the law has no solution", headline);
  }
  if (statistics.condition.any()) {
    add(Kind::step_condition, fmt::format("{:.2g}", statistics.condition.max), "relative error of h, at most");
  }
  if (statistics.has_gaps() && statistics.has_laws()) {
    add(Kind::laws, fmt::format("of {} of {} steps", statistics.law_steps_taken(), statistics.steps),
        "what follows is of these, and of the levels they lead to");
  }
  for (const auto& [name, value] : constraints_of(statistics)) {
    add_named(Kind::constraint, name, with_undefined(max_rms(value), value, "levels"));
  }
  for (const auto& [name, value] : other_residuals(statistics)) {
    add_named(Kind::residual, name,
              with_undefined(max_rms(value), value,
                             statistics.has_gaps() ? "cells (of these steps)" : "cells (of all steps)"));
  }
  if (!statistics.growth.empty() && statistics.tangents.time > 0.0) {
    const bool defined = std::isfinite(statistics.growth.front().value);
    add(Kind::exponents,
        defined ? fmt::format("{:.6g}", fmt::join(exponents_of(statistics), ", ")) : "undefined: a tangent is missing",
        "of the tangent vectors, by QR", headline);
    if (defined) {
      add(Kind::megno, fmt::format("{:.6g}", statistics.megno()), "2 where the orbit is regular");
    }
    if (statistics.tangents.defect.any()) {
      add(Kind::symplecticity, fmt::format("preserved but for {:.2g}", statistics.tangents.defect.largest()),
          "dp^dq of tangent vectors, at most in a step");
    }
  }
  if (const auto* const lost = energy_lost(statistics)) {
    add(Kind::sponge, fmt::format("not Hamiltonian: {:.10g} of energy taken", largest_of(*lost)),
        "E_k and H(z_k) include what was taken", headline);
  }
  for (const auto& [name, value] : statistics.totals) {
    if (name != energy_lost_name) {
      add_named(Kind::total, name, deviation_text(value));
    }
  }
  for (const auto& [name, value] : statistics.invariants) {
    add_named(Kind::invariant, name, deviation_text(value));
  }
  for (const auto& [name, value] : statistics.events) {
    add_named(Kind::event, name, event_text(value, statistics.steps), "crossings, by dense output");
  }
  if (const auto* event = statistics.stopped_by()) {
    add(Kind::ended_by, fmt::format("event {} at t = {:.10g}", event->name, event->value.stopped),
        "the levels go to the end of that step", headline);
  }
  for (const auto& [name, value] : statistics.errors) {
    add_named(Kind::error, name,
              value.undefined == value.count() ? "undefined at the last level"
                                               : with_undefined(max_rms(value), value, "nodes") + " at the last level",
              "", headline);
  }
  if (statistics.all_iterations > 0.0) {
    add(Kind::iterations,
        fmt::format("{:.3g} on average, at most {:.0f}",
                    statistics.all_iterations / static_cast<double>(statistics.steps), statistics.iterations.max));
  }
  if (const Measures& measures = statistics.measures; measures.seam > 0.0) {
    add(Kind::seam,
        fmt::format("the wave reached it: up to {:.2g} of its largest, at t = {:.6g}", measures.seam, measures.seam_t),
        "where the period begins again");
  }
  add(Kind::verdict, text_of(judge(statistics)), "by the measures of this run", headline);
  return lines;
}

}  // namespace rubato::figures
