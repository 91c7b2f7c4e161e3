#include <rubato/problem/effective.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/catalogue/catalogue.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/problem/cell_counts.hpp>
#include <rubato/problem/initial_record.hpp>

namespace rubato {
namespace {

/// A value of the command line: TOML if it is that, else a string.
Value read_setting_value(const std::string& text, const std::string& source) {
  try {
    Value root = read_document("value = " + text, source);
    if (Value::Table& table = *root.table(); table.size() == 1) {
      return std::move(table.front().value);
    }
  } catch (const ProblemError&) {
    // Not TOML: a bare word, or a formula.
  }
  return {text, {}};
}

std::string without_blanks(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t"), last = text.find_last_not_of(" \t");
  return first == std::string::npos ? "" : text.substr(first, last + 1 - first);
}

/// Every place inside `value` becomes `location`.
void relocate(Value& value, const Location& location) {
  value.location = location;
  if (auto* array = std::get_if<Value::Array>(&value.data)) {
    for (Value& item : *array) {
      relocate(item, location);
    }
  } else if (auto* table = value.table()) {
    for (Entry& entry : *table) {
      entry.location = location;
      relocate(entry.value, location);
    }
  }
}

/// One `--set table.key=value`, or one `--unset table.key`, which is "-table.key".
class Setting {
public:
  explicit Setting(const std::string& text) {
    const bool sets = !text.starts_with('-');
    const std::size_t first = sets ? 0 : 1, equals = sets ? text.find('=') : text.size();
    location_.file = (sets ? "--set " : "--unset ") + text.substr(first, 200);
    if (equals == std::string::npos) {
      throw ProblemError(location_, "expected table.key=value");
    }
    const std::size_t length = equals;
    for (std::size_t begin = first; begin <= length;) {
      const std::size_t end = std::min(text.find('.', begin), length);
      path_.push_back(without_blanks(text.substr(begin, end - begin)));
      if (path_.back().empty()) {
        throw ProblemError(location_, fmt::format("expected table.key{}, with a name on each side of every dot",
                                                  sets ? "=value" : ""));
      }
      begin = end + 1;
    }
    if (path_.size() > 100) {
      throw ProblemError(location_, "keys nested deeper than 100 levels");
    }
    if (sets) {
      value_ = read_setting_value(text.substr(equals + 1), location_.file);
      relocate(*value_, location_);
    }
  }

  [[nodiscard]] bool removes() const { return !value_; }
  [[nodiscard]] bool names_catalogue_entry() const {
    return !removes() && (path_ == std::vector<std::string>{"hamiltonian", "system"} ||
                          path_ == std::vector<std::string>{"lagrangian", "system"} ||
                          path_ == std::vector<std::string>{"multisymplectic", "equation"});
  }

  /// Puts the value in its place. A key that the problem's format does not know is found later, where every unknown key
  /// is; tables whose names are free may only be changed here, since a misspelt name would go unnoticed.
  void apply(Value& root) const {
    static constexpr std::array free_tables = {"parameters", "definitions", "invariants", "symmetries", "constraints"};
    Value* place = &root;
    for (std::size_t i = 0; i < path_.size(); ++i) {
      Value::Table& table = table_at(*place, i);
      Entry* entry = find(table, path_[i]);
      if (entry == nullptr) {
        const bool free = i == 1 && std::find(free_tables.begin(), free_tables.end(), path_[0]) != free_tables.end();
        if (free || removes()) {
          throw ProblemError(location_, unknown_name(table, i));
        }
        entry = &table.emplace_back(Entry{path_[i], location_, Value{Value::Table{}, location_}});
      }
      if (removes() && i + 1 == path_.size()) {
        table.erase(table.begin() + (entry - table.data()));
        return;
      }
      place = &entry->value;
    }
    *place = *value_;
  }

private:
  /// The table that entry number `level` of the path is in.
  [[nodiscard]] Value::Table& table_at(Value& place, std::size_t level) const {
    Value::Table* table = place.table();
    if (table == nullptr) {
      throw ProblemError(location_,
                         fmt::format("unknown path: {} is {}, not a table", path_[level - 1], place.type_name()));
    }
    return *table;
  }

  [[nodiscard]] std::string unknown_name(const Value::Table& table, std::size_t level) const {
    std::vector<std::string> names;
    for (const Entry& entry : table) {
      names.push_back(entry.key);
    }
    const auto nearest = formula::nearest_name(path_[level], names);
    const std::vector<std::string> above(path_.begin(), path_.begin() + static_cast<std::ptrdiff_t>(level));
    return fmt::format("the problem has nothing called {}{}; {}", path_[level],
                       above.empty() ? "" : fmt::format(" in [{}]", fmt::join(above, ".")),
                       nearest         ? fmt::format("did you mean {}?", *nearest)
                       : names.empty() ? "that table is empty or absent"
                                       : fmt::format("it has {}", fmt::join(names, ", ")));
  }

  Location location_;
  std::vector<std::string> path_;
  std::optional<Value> value_;
};

/// Puts the catalogue's entries `keys` of [`table_name`] in the place of `reference` ("system", "equation").
bool expand(Value& root, std::string_view table_name, std::string_view reference,
            std::span<const std::string_view> keys) {
  Entry* section = find(*root.table(), table_name);
  Value::Table* table = section == nullptr ? nullptr : section->value.table();
  Entry* name = table == nullptr ? nullptr : find(*table, reference);
  if (name == nullptr) {
    return false;
  }
  const Location location = name->value.location;
  const std::string* wanted = name->value.string();
  if (wanted == nullptr) {
    throw ProblemError(location, fmt::format("{}: expected a string with a catalogue name, got {}", reference,
                                             name->value.type_name()));
  }
  for (const std::string_view key : keys) {
    if (const Entry* own = find(*table, key)) {
      throw ProblemError(own->location, fmt::format("{0} comes from {1} = \"{2}\"; give either {1}, or {3}", key,
                                                    reference, *wanted, fmt::join(keys, ", ")));
    }
  }
  const auto entry = catalogue::find(*wanted);
  if (!entry) {
    throw ProblemError(location, fmt::format("the catalogue has no \"{}\"{}", *wanted, catalogue_suggestion(*wanted)));
  }
  Value other = read_document(entry->text, fmt::format("{}.toml (built-in)", *wanted));
  Entry* other_section = find(*other.table(), table_name);
  if (other_section == nullptr) {
    throw ProblemError(location,
                       fmt::format("\"{}\" in the catalogue has no [{}]: it is not of this kind", *wanted, table_name));
  }
  // The catalogue's entries go first: H stands before what the user adds to its table.
  Value::Table merged = std::move(*other_section->value.table());
  for (Entry& own : *table) {
    if (own.key != reference) {
      merged.push_back(std::move(own));
    }
  }
  *table = std::move(merged);

  for (const std::string_view key : {"parameters", "constraints"}) {
    Entry* defaults = find(*other.table(), key);
    Entry* entries = find(*root.table(), key);
    if (defaults != nullptr && entries == nullptr) {
      root.table()->push_back(std::move(*defaults));
    } else if (Value::Table* own = entries != nullptr && defaults != nullptr ? entries->value.table() : nullptr) {
      // if it is no table, its reader says so
      for (Entry& value : *defaults->value.table()) {
        if (find(*own, value.key) == nullptr) {
          own->push_back(std::move(value));
        }
      }
    }
  }
  return true;
}

}  // namespace

std::string catalogue_suggestion(std::string_view name) {
  // Names in the catalogue are lower-case words with hyphens.
  std::string word(name);
  for (char& c : word) {
    c = c == '_' || c == ' ' ? '-' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  std::vector<std::string> names, related;
  for (const auto& entry : catalogue::entries()) {
    names.emplace_back(entry.name);
    if (word.size() > 2 && (names.back().find(word) != std::string::npos || word.find(names.back()) == 0)) {
      related.push_back(fmt::format("\"{}\"", names.back()));
    }
  }
  if (const auto nearest = formula::nearest_name(word, names)) {
    return fmt::format("; did you mean \"{}\"?", *nearest);
  }
  std::ranges::sort(related);
  return related.empty() ? fmt::format("; the catalogue has {}", fmt::join(names, ", "))
                         : fmt::format("; did you mean {}?", fmt::join(related, " or "));
}

EffectiveDocument effective_document(std::string_view text, const std::string& source,
                                     std::span<const std::string> settings) {
  static constexpr std::array<std::string_view, 3> hamiltonian_keys = {"q", "p", "H"};
  static constexpr std::array<std::string_view, 2> lagrangian_keys = {"q", "L"};
  static constexpr std::array<std::string_view, 4> multisymplectic_keys = {"fields", "M", "K", "S"};

  EffectiveDocument document{read_document(text, source), {}};
  std::vector<Setting> changes;
  for (const std::string& setting : settings) {
    changes.emplace_back(setting);
  }
  // First those that name a catalogue entry, so that the others can change what it brings; then what is removed.
  std::ranges::stable_sort(changes, {}, [](const Setting& s) {
    return s.names_catalogue_entry() ? 0 : s.removes() ? 1 : 2;
  });
  auto change = changes.begin();
  for (; change != changes.end() && change->names_catalogue_entry(); ++change) {
    change->apply(document.root);
  }
  const bool from_system = expand(document.root, "hamiltonian", "system", hamiltonian_keys);
  const bool from_lagrangian = expand(document.root, "lagrangian", "system", lagrangian_keys);
  const bool from_equation = expand(document.root, "multisymplectic", "equation", multisymplectic_keys);
  for (; change != changes.end(); ++change) {
    change->apply(document.root);
  }
  const bool from_record = resolve_initial_record(document.root);
  const bool cells = choose_cells(document.root);
  const bool changed = !changes.empty() || from_system || from_lagrangian || from_equation || from_record || cells;
  document.text = changed ? write_document(document.root) : std::string(text);
  return document;
}

std::string setting_value(const std::string& text) {
  return write_value(read_setting_value(text, "the command line"));
}

std::string without(std::string_view text, const std::string& source, std::string_view path) {
  Value root = read_document(text, source);
  Value::Table* table = root.table();
  for (auto dot = path.find('.'); dot != path.npos && table != nullptr; dot = path.find('.')) {
    const auto inner = std::ranges::find(*table, path.substr(0, dot), &Entry::key);
    table = inner == table->end() ? nullptr : inner->value.table();
    path.remove_prefix(dot + 1);
  }
  if (table != nullptr) {
    std::erase_if(*table, [path](const Entry& entry) { return entry.key == path; });
  }
  return write_document(root);
}

}  // namespace rubato
