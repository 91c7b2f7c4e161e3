#include <rubato/problem/cell_counts.hpp>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

#include <fmt/format.h>

#include <rubato/pde/lattice_method.hpp>

namespace rubato {

namespace {

constexpr std::string_view word = "about", blanks = " \t";

/// What follows "about"; nothing if the entry says something else.
std::optional<std::size_t> wanted_cells(const Value& value) {
  const std::string* const text = value.string();
  if (text == nullptr) {
    return std::nullopt;
  }
  std::string_view rest(*text);
  rest.remove_prefix(std::min(rest.find_first_not_of(blanks), rest.size()));
  if (!rest.starts_with(word) || (rest.size() > word.size() && blanks.find(rest[word.size()]) == blanks.npos)) {
    return std::nullopt;
  }
  rest.remove_prefix(word.size());
  rest.remove_prefix(std::min(rest.find_first_not_of(blanks), rest.size()));
  rest = rest.substr(0, rest.find_last_not_of(blanks) + 1);
  std::uint32_t number = 0;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), number);
  if (error != std::errc() || end != rest.data() + rest.size() || number < 3) {
    throw ProblemError(value.location,
                       fmt::format("cells = \"{}\": after \"about\" goes a whole number from 3 to {}, as in \"about "
                                   "128\"",
                                   *text, std::numeric_limits<std::uint32_t>::max()));
  }
  return number;
}

/// What [scheme] says of it, as far as it can be reported here; what is wrong with it is said where it is read.
std::unique_ptr<LatticeMethod> method_of(Value& root) {
  LatticeMethodChoice choice;
  const Entry* const section = find(*root.table(), "scheme");
  if (const Value::Table* const scheme = section == nullptr ? nullptr : section->value.table()) {
    const auto read = [&](std::string_view key, auto& to) {
      using Type = std::remove_reference_t<decltype(to)>;
      if (const Entry* const entry = find(*scheme, key)) {
        if constexpr (std::is_same_v<Type, int>) {
          const auto* const number = std::get_if<std::int64_t>(&entry->value.data);
          to = number == nullptr ? to : static_cast<int>(std::clamp<std::int64_t>(*number, 0, 1000));
        } else if (const std::string* const text = entry->value.string()) {
          to = *text;
        }
      }
    };
    read("lagrangian", choice.name);
    read("stages", choice.stages);
    read("space_stages", choice.space_stages);
    read("space", choice.space);
  }
  try {
    return make_lattice_method(choice);
  } catch (const std::invalid_argument&) {
    return make_lattice_method({});
  }
}

}  // namespace

bool choose_cells(Value& root) {
  Entry* const section = find(*root.table(), "grid");
  Value::Table* const grid = section == nullptr ? nullptr : section->value.table();
  if (grid == nullptr) {
    return false;
  }
  bool chosen = false;
  std::unique_ptr<LatticeMethod> method;
  for (Entry& axis : *grid) {
    Entry* const cells = axis.value.table() == nullptr ? nullptr : find(*axis.value.table(), "cells");
    const std::optional<std::size_t> wanted = cells == nullptr ? std::nullopt : wanted_cells(cells->value);
    if (!wanted) {
      continue;
    }
    if (method == nullptr) {
      method = method_of(root);
    }
    cells->value.data = static_cast<std::int64_t>(method->count_near(*wanted, static_cast<int>(grid->size())));
    chosen = true;
  }
  return chosen;
}

}  // namespace rubato
