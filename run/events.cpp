#include <rubato/run/events.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>

namespace rubato {

EventWriter::EventWriter(const Problem& problem)
    : problem_(problem),
      finder_(problem.hamiltonian() != nullptr ? make_orbit_events(problem) : make_lattice_events(problem)),
      columns_(problem.events.size()) {}

std::string EventWriter::group(std::size_t event) const {
  return "/events/" + problem_.events[event].name;
}

std::vector<std::string> EventWriter::names() const {
  std::vector<std::string> names;
  std::ranges::transform(problem_.events, std::back_inserter(names), &StatedEvent::name);
  return names;
}

void EventWriter::describe(record::Layout& layout) {
  using record::Type;
  for (std::size_t i = 0; i < problem_.events.size(); ++i) {
    const StatedEvent& event = problem_.events[i];
    Columns& columns = columns_[i];
    const std::string at = group(i), t = at + "/t";
    columns.missed =
        layout.add({at + "/missed",
                    "/levels/step",
                    {},
                    Type::u8,
                    "1 on steps in which the formula is not defined, 2 on those in which it jumps through "
                    "zero, 3 on those with several crossings, 4 on a first one that leaves zero and ends beyond it"});
    columns.t = layout.add({t, t, {}, Type::f64, "times of the crossings, by dense output"});
    columns.direction = layout.add({at + "/direction", t, {}, Type::i32, "1 up, -1 down, in the direction of the run"});
    if (event.stop_after > 0) {
      columns.stops = layout.add({at + "/stops", t, {}, Type::u8, "1 where it ended the run"});
    }
    finder_->describe(i, at, layout);
    if (!event.quantities.empty()) {
      std::vector<std::string> names;
      std::ranges::transform(event.quantities, std::back_inserter(names), &OutputQuantity::name);
      layout.scales.push_back({at + "/quantity", std::move(names), "formulas of the quantities"});
      columns.quantities =
          layout.add({at + "/quantities", t, {at + "/quantity"}, Type::f64, "quantities at the crossings", true});
    }
  }
}

void EventWriter::begin(RowSink& sink, std::span<const double> z, double t, std::span<EventFigures> figures) {
  std::vector<double> values(problem_.events.size());
  finder_->begin(z, t, values);
  const OutputStep start{.z_0 = z, .z_1 = z, .t_0 = t, .t_1 = t, .h = 0.0, .clock = problem_.clock()};
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (problem_.events[i].stop_after > 0 && problem_.events[i].is_condition() && values[i] > 0.0) {
      append_row(sink, i, start, {.fraction = 1.0}, figures[i]);
    }
  }
}

void EventWriter::append(RowSink& sink, const OutputStep& step, std::span<EventFigures> figures) {
  finder_->follow(step);
  append_again(sink, step, figures);
}

void EventWriter::append(RowSink& sink, const OutputStep& step, std::span<const CrossingSearch::Sample> from,
                         std::span<const CrossingSearch::Sample> to, std::span<EventFigures> figures) {
  finder_->follow(step, from, to);
  append_again(sink, step, figures);
}

void EventWriter::append_again(RowSink& sink, const OutputStep& step, std::span<EventFigures> figures) {
  for (std::size_t i = 0; i < problem_.events.size(); ++i) {
    bool jumps = false;
    int crossings = 0;
    for (const Crossing& crossing : finder_->crossings(i)) {
      if (crossing.jump && !problem_.events[i].is_condition()) {
        jumps = true;
      } else {
        append_row(sink, i, step, crossing, figures[i]);
        ++crossings;
      }
    }
    const int missed = finder_->undefined(i)           ? 1
                       : jumps                         ? 2
                       : crossings > 1                 ? 3
                       : finder_->left_and_returned(i) ? 4
                                                       : 0;
    sink.append(columns_[i].missed, missed);
    figures[i].value.add_step(missed);
  }
}

void EventWriter::append_row(RowSink& sink, std::size_t event, const OutputStep& step, const Crossing& crossing,
                             EventFigures& figures) {
  const double t = finder_->time(step, crossing.fraction);
  const auto last = static_cast<std::size_t>(problem_.events[event].stop_after);
  const bool stops = last > 0 && figures.value.count + 1 >= last;
  const Columns& columns = columns_[event];
  sink.append(columns.t, t);
  sink.append(columns.direction, static_cast<int>(crossing.direction));
  if (last > 0) {
    sink.append(columns.stops, stops ? 1 : 0);
  }
  finder_->append(sink, event, step, crossing.fraction);
  bool defined = true;
  if (!problem_.events[event].quantities.empty()) {
    const std::vector<double> values = finder_->quantities(event, t);
    sink.append(columns.quantities, std::span<const double>(values));
    defined = all_finite(values);
  }
  figures.value.add(t, stops, defined);
}

std::unique_ptr<EventWriter> make_events(const Problem& problem) {
  return problem.events.empty() ? nullptr : std::make_unique<EventWriter>(problem);
}

}  // namespace rubato
