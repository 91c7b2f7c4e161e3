#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include <rubato/problem/keys.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

constexpr std::string_view comparison_characters = "<>=!";

/// The first of them from `from` on that is not inside parentheses, as that of where(a < b, f, g).
std::size_t find_comparison(std::string_view text, std::size_t from = 0) {
  int depth = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    depth += text[i] == '(' ? 1 : text[i] == ')' ? -1 : 0;
    if (i >= from && depth <= 0 && comparison_characters.find(text[i]) != std::string_view::npos) {
      return i;
    }
  }
  return std::string::npos;
}

/// In the order of direction_words.
constexpr std::array directions = {Direction::both, Direction::up, Direction::down};

/// The part of a formula's text from `from` on, with its place in the file.
FormulaText part_of(const FormulaText& whole, std::size_t from, std::size_t to) {
  from = std::min(whole.text.find_first_not_of(" \t\r\n", from), to);
  std::size_t line = 1, column = 1;
  for (std::size_t i = 0; i < from; ++i) {
    const auto byte = static_cast<unsigned char>(whole.text[i]);
    if (byte == '\n') {
      ++line;
      column = 1;
    } else {
      column += (byte & 0xC0U) != 0x80U ? 1 : 0;  // characters, not bytes
    }
  }
  return {whole.text.substr(from, to - from), place_in_file(whole.location, line, column)};
}

class EventReader {
public:
  EventReader(const Entry& entry, std::string name, const Problem& problem) : problem_(problem) {
    event_.name = std::move(name);
    event_.location = entry.location;
    event_.stop_after = event_.name == "stop" ? 1 : 0;
  }

  /// An entry of [events] that is no table.
  StatedEvent read_short(const Entry& entry) {
    read_crossing(entry.value, entry.key);
    check();
    return std::move(event_);
  }

  StatedEvent read_table(Section& section) {
    const bool is_section = event_.name == section_event;
    const Entry* crossing = section.take("crossing");
    const Entry* direction = section.take("direction");
    const Entry* at = section.take("at");
    const Entry* stop = section.take("stop");
    const Entry* quantities = section.take("quantities");
    section.finish();
    if (crossing == nullptr) {
      throw ProblemError(section.location(),
                         fmt::format("{} needs crossing: the formula whose zeros are looked for", section.name()));
    }
    read_crossing(crossing->value, "crossing");
    if (direction != nullptr) {
      const std::size_t word = read_word(direction->value, "direction", direction_words);
      if (event_.is_condition()) {
        throw ProblemError(direction->location,
                           "direction: a comparison is met where it becomes true; leave it out, or write the crossing "
                           "as a difference");
      }
      event_.direction = directions[word];
    }
    if (at != nullptr) {
      event_.at = read_point_of_grid(*at, problem_);
    }
    if (stop != nullptr) {
      read_stop(stop->value);
    }
    if (quantities != nullptr) {
      read_quantities(quantities->value);
    } else if (is_section) {
      throw ProblemError(section.location(),
                         "[section] needs quantities: what is drawn at each crossing, such as [\"y\", \"v\"]");
    }
    check();
    return std::move(event_);
  }

private:
  void read_crossing(const Value& value, std::string_view what) {
    const FormulaText whole = read_formula(value, what);
    const std::size_t sign = find_comparison(whole.text);
    if (sign == std::string::npos) {
      event_.crossing = whole;
      return;
    }
    const auto refuse = [&](std::string_view reason) {
      throw ProblemError(part_of(whole, sign, whole.text.size()).location, fmt::format("{}: {}", what, reason));
    };
    if (whole.text[sign] == '=' || whole.text[sign] == '!') {
      refuse("a crossing is a formula that passes zero: write \"a - b\" for a = b, or compare with > or <");
    }
    if (const std::size_t next = find_comparison(whole.text, sign + 1); next == sign + 1) {
      refuse("write > or <: that both sides are equal is so for an instant only");
    } else if (next != std::string::npos) {
      refuse("one comparison is a condition; give each of them an event of its own");
    }
    const FormulaText left = part_of(whole, 0, sign), right = part_of(whole, sign + 1, whole.text.size());
    if (left.text.find_first_not_of(" \t\r\n") == std::string::npos || right.text.empty()) {
      refuse("a side of the comparison is empty");
    }
    const bool greater = whole.text[sign] == '>';
    event_.crossing = greater ? left : right;
    event_.less = greater ? right : left;
    event_.direction = Direction::up;
  }

  void read_stop(const Value& value) {
    if (const bool* word = std::get_if<bool>(&value.data)) {
      event_.stop_after = *word ? 1 : 0;
    } else if (value.string() != nullptr) {
      throw ProblemError(value.location,
                         "stop: expected true, false or the number of the crossing at which the run ends; the "
                         "condition is crossing = \"a > b\"");
    } else {
      event_.stop_after = read_integer(value, "stop", problem_.parameters, 1);
    }
  }

  void read_quantities(const Value& value) {
    for (const Value& item : read_array(value, "quantities", "formulas")) {
      OutputQuantity quantity = read_quantity(item, "quantities", problem_);
      if (!quantity.at) {
        quantity.at = event_.at;
      }
      quantity.name = quantity.formula.text;
      if (std::ranges::find(event_.quantities, quantity.name, &OutputQuantity::name) != event_.quantities.end() &&
          problem_.hamiltonian() != nullptr) {
        throw ProblemError(item.location, fmt::format("quantities: {} is there twice", quantity.name));
      }
      event_.quantities.push_back(std::move(quantity));
    }
    if (event_.quantities.empty()) {
      throw ProblemError(value.location, "quantities = []: there is none in it; leave it out");
    }
  }

  /// That its formulas can be read, and that g can change.
  void check() const {
    formula::Graph graph;
    std::vector<formula::Expression> integrands;
    const formula::Expression g = build_event(event_, problem_, graph, integrands);
    if (formula::variables_of(g).empty()) {
      throw ProblemError(event_.crossing.location,
                         fmt::format("\"{}\" depends on nothing that changes along the run: it has no crossings",
                                     event_.crossing.text.substr(0, 100)));
    }
  }

  const Problem& problem_;
  StatedEvent event_;
};

}  // namespace

formula::Expression build_event(const StatedEvent& event, const Problem& problem, formula::Graph& graph,
                                std::vector<formula::Expression>& integrands) {
  const auto build = [&](const FormulaText& text) {
    if (const HamiltonianProblem* ode = problem.hamiltonian()) {
      return problem.build(text, graph, quantity_names(*ode, problem.parameters));
    }
    const MultisymplecticProblem& pde = *problem.multisymplectic();
    return problem.build_quantity(text, graph, quantity_names(pde), pde.fields, integrands);
  };
  const formula::Expression crossing = build(event.crossing);
  return event.less ? crossing - build(*event.less) : crossing;
}

std::vector<StatedEvent> read_events(Section& root, const Problem& problem) {
  std::vector<StatedEvent> events;
  auto group = root.take_section("events");
  auto section = root.take_section(section_event);
  if (group) {
    for (const Entry& entry : group->entries()) {
      if (!is_identifier(entry.key)) {
        refuse_name(entry, "an event", malformed_name);
      }
      if (entry.key == section_event) {
        refuse_name(entry, "an event", "it is that of [section]");
      }
      EventReader reader(entry, entry.key, problem);
      if (entry.value.table() != nullptr) {
        Section table(*entry.value.table(), entry.location, fmt::format("[events.{}]", entry.key));
        events.push_back(reader.read_table(table));
      } else {
        events.push_back(reader.read_short(entry));
      }
    }
    if (events.empty()) {
      throw ProblemError(group->location(), "[events] names no event; leave it out");
    }
  }
  if (section) {
    const Entry& entry = *find(root.entries(), section_event);
    events.push_back(EventReader(entry, std::string(section_event), problem).read_table(*section));
  }
  // The order of a record's own problem is another: tables come last there.
  std::ranges::sort(events, {}, &StatedEvent::name);
  return events;
}

}  // namespace rubato
