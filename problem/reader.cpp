#include <rubato/problem/reader.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <unordered_set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/problem/keys.hpp>

namespace rubato {

Section::Section(const Value::Table& table, Location location, std::string name)
    : table_(&table), location_(std::move(location)), name_(std::move(name)) {
  for (const Entry& entry : table) {
    entries_.emplace(entry.key, &entry);
  }
}

void Section::rewrite(Value::Table table) {
  table_ = keep({std::move(table), location_}).table();
  entries_.clear();
  for (const Entry& entry : *table_) {
    entries_.emplace(entry.key, &entry);
  }
}

const Entry* Section::take(std::string_view key) {
  const std::string_view table =
      name_.empty() ? std::string_view() : std::string_view(name_).substr(1, name_.size() - 2);
  if (!is_documented(table, key)) {
    throw std::logic_error(fmt::format("{} in [{}] is not in the table of keys", key, table));
  }
  known_.emplace_back(key);
  const auto found = entries_.find(key);
  return found == entries_.end() ? nullptr : found->second;
}

const Entry* Section::take_outdated(std::string_view key) {
  const Entry* entry = find(*table_, key);
  if (entry != nullptr) {
    known_.emplace_back(key);
  }
  return entry;
}

const Entry& Section::require(std::string_view key, std::string_view purpose) {
  const Entry* entry = take(key);
  if (entry == nullptr) {
    // A misspelt key says more than a missing one.
    for (const Entry& other : *table_) {
      if (formula::nearest_name(other.key, std::vector<std::string>{std::string(key)})) {
        throw ProblemError(other.location,
                           fmt::format("unknown key {} in {}; did you mean {}?", other.key, name_, key));
      }
    }
    throw ProblemError(location_, fmt::format("{} needs {}: {}", name_, key, purpose));
  }
  return *entry;
}

std::optional<Section> Section::take_section(std::string_view key) {
  const Entry* entry = take(key);
  if (entry == nullptr) {
    return std::nullopt;
  }
  const std::string inner =
      name_.empty() ? std::string(key) : fmt::format("{}.{}", name_.substr(1, name_.size() - 2), key);
  if (entry->value.table() == nullptr) {
    wrong_type(entry->value, inner, fmt::format("a table, [{}]", inner));
  }
  return Section(*entry->value.table(), entry->location, fmt::format("[{}]", inner));
}

void Section::finish() const {
  const std::unordered_set<std::string_view> known(known_.begin(), known_.end());
  for (const Entry& entry : *table_) {
    if (known.contains(entry.key)) {
      continue;
    }
    const auto nearest = formula::nearest_name(entry.key, known_);
    const auto owner = table_of(entry.key);
    const std::string where = name_.empty() ? "" : " in " + name_;
    constexpr std::size_t longest_list = 20;
    const std::string advice = owner                          ? fmt::format("it belongs to [{}]", *owner)
                               : nearest                      ? fmt::format("did you mean {}?", *nearest)
                               : known_.size() > longest_list ? "see the list of names"
                                                              : fmt::format("known here: {}", fmt::join(known_, ", "));
    throw ProblemError(entry.location, fmt::format("unknown {} {}{}; {}", entry.value.table() ? "table" : "key",
                                                   entry.key.substr(0, 100), where, advice));
  }
}

void wrong_type(const Value& value, std::string_view what, std::string_view expected) {
  throw ProblemError(value.location, fmt::format("{}: expected {}, got {}", what, expected, value.type_name()));
}

const std::string& read_string(const Value& value, std::string_view what) {
  if (value.string() == nullptr) {
    wrong_type(value, what, "a string");
  }
  return *value.string();
}

bool read_boolean(const Value& value, std::string_view what) {
  const bool* boolean = std::get_if<bool>(&value.data);
  if (boolean == nullptr) {
    wrong_type(value, what, "true or false");
  }
  return *boolean;
}

const Value::Array& read_array(const Value& value, std::string_view what, std::string_view of) {
  if (value.array() == nullptr) {
    wrong_type(value, what, fmt::format("an array of {}", of));
  }
  return *value.array();
}

FormulaText read_formula(const Value& value, std::string_view what) {
  if (const std::string* text = value.string()) {
    if (text->find_first_not_of(" \t\r\n") == std::string::npos) {
      throw ProblemError(value.location, fmt::format("{}: the formula is empty", what));
    }
    return {*text, value.location};
  }
  if (const auto* integer = std::get_if<std::int64_t>(&value.data)) {
    return {fmt::format("{}", *integer), value.location};
  }
  if (std::holds_alternative<double>(value.data)) {
    return {fmt::format("{}", read_number(value, what, {})), value.location};
  }
  wrong_type(value, what, "a formula or a number");
}

std::int64_t read_integer(const Value& value, std::string_view what, const Parameters& parameters, std::int64_t least) {
  if (const auto* integer = std::get_if<std::int64_t>(&value.data)) {
    if (*integer < least) {
      throw ProblemError(value.location,
                         fmt::format("{} = {}: expected an integer, at least {}", what, *integer, least));
    }
    return *integer;
  }
  constexpr double largest = 9007199254740992.0;  // 2^53: beyond it not every integer is a double
  const double number = read_number(value, what, parameters);
  if (number != std::round(number) || number < static_cast<double>(least)) {
    throw ProblemError(value.location, fmt::format("{} = {}: expected an integer, at least {}", what, number, least));
  }
  if (number > largest) {
    throw ProblemError(value.location, fmt::format("{} = {} is too large: not every integer beyond {} is a double",
                                                   what, number, static_cast<std::int64_t>(largest)));
  }
  return static_cast<std::int64_t>(number);
}

std::size_t read_word(const Value& value, std::string_view what, std::span<const std::string_view> words) {
  const std::string& word = read_string(value, what);
  const auto found = std::find(words.begin(), words.end(), word);
  if (found == words.end()) {
    const auto nearest = formula::nearest_name(word, std::vector<std::string>(words.begin(), words.end()));
    throw ProblemError(value.location,
                       fmt::format("{} = \"{}\" is not known; {}", what, word.substr(0, 100),
                                   nearest ? fmt::format("did you mean \"{}\"?", *nearest)
                                           : fmt::format("it may be \"{}\"", fmt::join(words, "\", \""))));
  }
  return static_cast<std::size_t>(found - words.begin());
}

void refuse_name(const Entry& entry, std::string_view role, std::string_view reason) {
  throw ProblemError(entry.location, fmt::format("\"{}\" cannot name {}: {}", entry.key.substr(0, 100), role, reason));
}

std::vector<NamedFormula> read_invariants(Section& root, const Vocabulary& vocabulary, const Parameters& parameters) {
  static constexpr std::array<std::string_view, 5> names_in_record = {"t", "step", "totals", "fields",
                                                                      "constraints"};  // under /laws
  std::vector<NamedFormula> invariants;
  if (const auto section = root.take_section("invariants")) {
    for (const Entry& entry : section->entries()) {
      if (!is_identifier(entry.key)) {
        refuse_name(entry, "an invariant", malformed_name);
      }
      if (std::ranges::find(names_in_record, entry.key) != names_in_record.end()) {
        refuse_name(entry, "an invariant", name_of_record);
      }
      invariants.push_back({entry.key, read_formula(entry.value, entry.key)});
      check_formula(invariants.back().formula, vocabulary, parameters);
    }
  }
  return invariants;
}

std::vector<NamedFormula> read_exact(Section& root, std::span<const NameList> lists,
                                     std::span<const std::string> arguments, const Parameters& parameters) {
  std::vector<NamedFormula> exact;
  if (auto section = root.take_section("exact")) {
    for (const NameList& list : lists) {
      const auto values = take_values(*section, list);
      for (std::size_t i = 0; i < values.size(); ++i) {
        if (values[i] != nullptr) {
          exact.push_back({list.names[i], read_formula(*values[i], list.names[i])});
          check_formula(exact.back().formula, {arguments}, parameters);
        }
      }
    }
    section->finish();
  }
  return exact;
}

}  // namespace rubato
