// [ensemble]: the members of one problem, listed, on a grid of values, or drawn at random.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/draws.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

constexpr std::size_t most_members = 10'000'000;

/// An entry of the problem, by its path, and what is said of its values.
struct Varied {
  std::string path;
  const Value* value = nullptr;
};

/// The entries named in a table, in its order: { initial.p = 1, parameters.k = 2 } has initial.p and parameters.k.
void collect(const Value::Table& table, const std::string& prefix, std::vector<Varied>& into) {
  for (const Entry& entry : table) {
    const std::string path = prefix.empty() ? entry.key : fmt::format("{}.{}", prefix, entry.key);
    if (const Value::Table* inner = entry.value.table()) {
      collect(*inner, path, into);
    } else if (prefix.empty()) {
      throw ProblemError(entry.location,
                         fmt::format("{} is not an entry of a table of the problem: write its whole path, "
                                     "such as initial.p",
                                     entry.key));
    } else {
      into.push_back({path, &entry.value});
    }
  }
}

[[noreturn]] void refuse_size(const Location& location) {
  throw ProblemError(location, fmt::format("more than {} members", most_members));
}

/// "from:to:count", each a number or a formula of the parameters.
std::vector<std::string> read_range(const Value& value, const std::string& path, const Parameters& parameters) {
  const std::string& text = *value.string();
  const std::size_t first = text.find(':'), second = first == std::string::npos ? first : text.find(':', first + 1);
  if (second == std::string::npos || text.find(':', second + 1) != std::string::npos) {
    throw ProblemError(value.location,
                       fmt::format("{}: expected \"from:to:count\", such as \"0:2:21\", or a list of values", path));
  }
  const auto part = [&](std::size_t begin, std::size_t end) {
    return Value{text.substr(begin, end - begin), value.location};
  };
  const double from = read_number(part(0, first), path, parameters);
  const double to = read_number(part(first + 1, second), path, parameters);
  const std::int64_t count =
      read_integer(part(second + 1, text.size()), fmt::format("the count of {}", path), parameters, 1);
  if (static_cast<std::size_t>(count) > most_members) {
    refuse_size(value.location);
  }
  if (count == 1 && from != to) {
    throw ProblemError(
        value.location,
        fmt::format("{}: one value cannot reach from {} to {}; give a count of 2 or more", path, from, to));
  }
  std::vector<std::string> values;
  // Both ends to the last bit.
  const auto last = static_cast<double>(std::max<std::int64_t>(count - 1, 1));
  for (std::int64_t i = 0; i < count; ++i) {
    const auto x = static_cast<double>(i);
    const double between = (from * (last - x) + to * x) / last;
    // Between them what a person would write: 1.4 and not 1.4000000000000001.
    values.push_back(i == 0           ? fmt::format("{}", from)
                     : i + 1 == count ? fmt::format("{}", to)
                                      : fmt::format("{:.15g}", between));
  }
  return values;
}

void read_grid(const Value& value, const Parameters& parameters, Ensemble& ensemble) {
  if (value.table() == nullptr) {
    wrong_type(value, "grid", "a table such as { initial.p = \"0:2:21\" }");
  }
  std::vector<Varied> varied;
  collect(*value.table(), "", varied);
  std::vector<std::vector<std::string>> axes;
  std::size_t members = varied.empty() ? 0 : 1;
  for (const Varied& entry : varied) {
    ensemble.paths.push_back(entry.path);
    auto& values = axes.emplace_back();
    if (const Value::Array* list = entry.value->array()) {
      for (const Value& item : *list) {
        values.push_back(write_value(item));
      }
    } else if (entry.value->string() != nullptr) {
      values = read_range(*entry.value, entry.path, parameters);
    } else {
      wrong_type(*entry.value, entry.path, "\"from:to:count\" or a list of values");
    }
    if (values.empty()) {
      throw ProblemError(entry.value->location, fmt::format("{} has no value", entry.path));
    }
    if (members > most_members / values.size()) {
      refuse_size(value.location);
    }
    members *= values.size();
  }
  for (std::size_t m = 0; m < members; ++m) {
    std::vector<std::string> chosen(axes.size());
    std::size_t rest = m;
    for (std::size_t a = axes.size(); a-- > 0;) {
      chosen[a] = axes[a][rest % axes[a].size()];
      rest /= axes[a].size();
    }
    ensemble.values.push_back(std::move(chosen));
  }
}

void read_members(const Value& value, Ensemble& ensemble) {
  for (const Value& member : read_array(value, "members", "tables such as { initial.p = 1 }")) {
    if (member.table() == nullptr) {
      wrong_type(member, "a member", "a table such as { initial.p = 1 }");
    }
    std::vector<Varied> varied;
    collect(*member.table(), "", varied);
    if (ensemble.values.empty()) {
      for (const Varied& entry : varied) {
        ensemble.paths.push_back(entry.path);
      }
    }
    auto& values = ensemble.values.emplace_back();
    for (const std::string& path : ensemble.paths) {
      const auto entry = std::ranges::find(varied, path, &Varied::path);
      if (entry == varied.end() || varied.size() != ensemble.paths.size()) {
        throw ProblemError(member.location, fmt::format("every member gives the same entries; the first has {}",
                                                        fmt::join(ensemble.paths, ", ")));
      }
      values.push_back(write_value(*entry->value));
    }
  }
}

/// A formula in which uniform(a, b) and normal(mean, deviation) are drawn anew for every member.
class RandomFormula {
public:
  RandomFormula(const Value& value, const std::string& path, const Parameters& parameters, std::uint64_t& draws)
      : first_(draws), path_(path), location_(value.location) {
    const FormulaText text = read_formula(value, path);
    formula::Graph graph;
    std::vector<formula::Expression> variables;
    const auto draw = [&] {
      variables.push_back(graph.variable(fmt::format("draw {}", variables.size())));
      return variables.back();
    };
    std::vector<std::string> known;
    for (const Parameter& parameter : parameters) {
      known.push_back(parameter.name);
    }
    const formula::ParseContext context{
        .resolve = [&](std::string_view name) -> std::optional<formula::Expression> {
          const Parameter* const parameter = parameters.find(name);
          return parameter == nullptr || parameter->definition ? std::nullopt
                                                               : std::optional(graph.constant(parameter->value));
        },
        .call = [&](std::string_view name,
                    std::span<const formula::Expression> arguments) -> std::optional<formula::Expression> {
          if (arguments.size() != 2) {
            return std::nullopt;
          }
          if (name == "uniform") {
            if (arguments[0].is_constant() && arguments[1].is_constant() &&
                arguments[0].constant_value() > arguments[1].constant_value()) {
              throw ProblemError(text.location, "uniform(from, to) needs from to be no larger than to");
            }
            return arguments[0] + (arguments[1] - arguments[0]) * draw();
          }
          if (name == "normal") {  // Box and Muller
            if (arguments[1].is_constant() && !(arguments[1].constant_value() >= 0.0)) {
              throw ProblemError(text.location,
                                 fmt::format("the deviation of normal(mean, deviation) is {}: write one that is not "
                                             "negative",
                                             arguments[1].constant_value()));
            }
            const formula::Expression radius = sqrt(-2.0 * log(draw()));
            return arguments[0] + arguments[1] * radius * cos(2.0 * std::numbers::pi * draw());
          }
          return std::nullopt;
        },
        .known_names = known};
    try {
      const std::array outputs = {formula::parse(text.text, graph, context)};
      evaluate_ = formula::ScalarEvaluator(formula::Bytecode(outputs, variables));
    } catch (const formula::ParseError& error) {
      throw ProblemError(place_in_file(text.location, error.line(), error.column()),
                         fmt::format("{}\nuniform(from, to) and normal(mean, deviation) are drawn here", error.what()));
    }
    count_ = variables.size();
    draws += count_;
  }

  [[nodiscard]] std::string value(const Draws& draws, std::size_t member) {
    for (std::size_t i = 0; i < count_; ++i) {
      evaluate_.inputs()[i] = draws.at(member, first_ + i);
    }
    evaluate_.run();
    const double result = evaluate_.output(0);
    if (!std::isfinite(result)) {
      throw ProblemError(location_, fmt::format("{} is {} for member {}", path_, result, member));
    }
    return fmt::format("{}", result);
  }

private:
  std::uint64_t first_;
  std::size_t count_ = 0;
  std::string path_;
  Location location_;
  formula::ScalarEvaluator evaluate_;
};

void read_random(Section& random, const Parameters& parameters, Ensemble& ensemble) {
  const std::int64_t count = read_integer(random.require("count", "how many members").value, "count", parameters, 1);
  const Entry* seed = random.take("seed");
  const std::int64_t number = seed == nullptr ? 1 : read_integer(seed->value, "seed", parameters, 0);
  if (static_cast<std::size_t>(count) > most_members) {
    refuse_size(random.location());
  }
  Value::Table rest;
  std::ranges::copy_if(random.entries(), std::back_inserter(rest),
                       [](const Entry& entry) { return entry.key != "count" && entry.key != "seed"; });
  std::vector<Varied> varied;
  collect(rest, "", varied);
  std::vector<RandomFormula> formulas;
  std::uint64_t draws = 0;
  for (const Varied& entry : varied) {
    ensemble.paths.push_back(entry.path);
    formulas.emplace_back(*entry.value, entry.path, parameters, draws);
  }
  const Draws numbers(static_cast<std::uint64_t>(number));
  for (std::size_t m = 0; m < static_cast<std::size_t>(count) && !formulas.empty(); ++m) {
    auto& values = ensemble.values.emplace_back();
    for (RandomFormula& formula : formulas) {
      values.push_back(formula.value(numbers, m));
    }
  }
}

}  // namespace

std::string Ensemble::described(std::size_t member) const {
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    parts.push_back(fmt::format("{} = {}", paths[i], values[member][i]));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

std::optional<Ensemble> read_ensemble(Section& root, const Parameters& parameters) {
  auto section = root.take_section("ensemble");
  if (!section) {
    return std::nullopt;
  }
  Ensemble ensemble;
  ensemble.location = section->location();
  const Entry* members = section->take("members");
  const Entry* grid = section->take("grid");
  auto random = section->take_section("random");
  section->finish();
  if ((members != nullptr ? 1 : 0) + (grid != nullptr ? 1 : 0) + (random ? 1 : 0) != 1) {
    throw ProblemError(ensemble.location, "[ensemble] takes one of members, grid and random");
  }
  if (members != nullptr) {
    read_members(members->value, ensemble);
  } else if (grid != nullptr) {
    read_grid(grid->value, parameters, ensemble);
  } else {
    read_random(*random, parameters, ensemble);
  }
  if (ensemble.values.empty() || ensemble.paths.empty()) {
    throw ProblemError(ensemble.location, "the ensemble changes nothing: name the entries, such as initial.p");
  }
  std::vector<std::string> sorted = ensemble.paths;
  std::ranges::sort(sorted);
  for (const std::string& path : sorted) {
    for (const std::string_view other : {"output", "ensemble", "title"}) {
      if (path.starts_with(fmt::format("{}.", other))) {
        throw ProblemError(ensemble.location,
                           fmt::format("{} is one for all members; an ensemble cannot change it", path));
      }
    }
  }
  return ensemble;
}

}  // namespace rubato
