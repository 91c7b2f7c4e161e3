#include <algorithm>
#include <cctype>
#include <charconv>

#include <fmt/format.h>

#include <rubato/formula/language.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {
namespace {

constexpr std::size_t longest_vector = 10'000;

/// "r[3]" as its base and its length; a plain name has no length.
struct Declaration {
  std::string base;
  std::optional<std::size_t> length;
};

Declaration read_declaration(const Value& value, std::string_view what, const Names& names) {
  const std::string& text = read_string(value, what);
  const std::size_t bracket = text.find('[');
  if (bracket == std::string::npos) {
    return {text, std::nullopt};
  }
  std::size_t length = 0;
  const char* const end = text.data() + text.size();
  if (const auto size =
          text.ends_with(']') ? names.size(text.substr(bracket + 1, text.size() - bracket - 2)) : std::nullopt) {
    if (*size < 1 || *size > static_cast<std::int64_t>(longest_vector)) {
      throw ProblemError(value.location, fmt::format("{}: \"{}\" has {} components; a vector has from 1 to {}", what,
                                                     text.substr(0, 100), *size, longest_vector));
    }
    return {text.substr(0, bracket), static_cast<std::size_t>(*size)};
  }
  const auto [rest, error] = std::from_chars(text.data() + bracket + 1, end, length);
  if (error != std::errc() || std::string_view(rest, end) != "]" || length < 1 || length > longest_vector) {
    throw ProblemError(value.location,
                       fmt::format("{}: \"{}\" does not declare a vector; write \"r[3]\", with a length from 1 to {} "
                                   "or the name of an integer in [parameters]",
                                   what, text.substr(0, 100), longest_vector));
  }
  return {text.substr(0, bracket), length};
}

}  // namespace

bool is_identifier(std::string_view name) {
  const auto is_letter = [](unsigned char c) { return (c < 0x80 && std::isalpha(c) != 0) || c == '_'; };
  return !name.empty() && is_letter(static_cast<unsigned char>(name.front())) &&
         std::all_of(name.begin(), name.end(), [&](unsigned char c) { return is_letter(c) || (c >= '0' && c <= '9'); });
}

void Names::know_sizes(const Section& root) {
  const Entry* section = find(root.entries(), "parameters");
  const Value::Table* table = section == nullptr ? nullptr : section->value.table();
  for (const Entry& entry : table == nullptr ? Value::Table() : *table) {
    if (const auto* integer = std::get_if<std::int64_t>(&entry.value.data)) {
      sizes_.emplace(entry.key, *integer);
    }
  }
}

std::optional<std::int64_t> Names::size(std::string_view name) const {
  const auto found = sizes_.find(name);
  return found == sizes_.end() ? std::nullopt : std::optional(found->second);
}

void Names::reserve(std::string_view name, std::string_view reason) {
  taken_.emplace(std::string(name), reason);
}

void Names::declare(std::string_view name, std::string_view role, const Location& location) {
  const auto refuse = [&](std::string_view reason) {
    throw ProblemError(location, fmt::format("\"{}\" cannot name {}: {}", name.substr(0, 100), role, reason));
  };
  if (!is_identifier(name)) {
    refuse(malformed_name);
  }
  if (formula::is_reserved_name(name)) {
    refuse(formula::find_constant(name) != nullptr ? "it is the number" : "it is a function");
  }
  const auto [place, is_new] = taken_.emplace(std::string(name), fmt::format("it is already {}", role));
  if (!is_new) {
    refuse(place->second);
  }
}

NameList read_names(const Value& value, std::string_view what, std::string_view role, Names& names) {
  NameList list;
  for (const Value& item : read_array(value, what, "names")) {
    const auto [base, length] = read_declaration(item, what, names);
    names.declare(base, length ? "a vector" : role, item.location);
    list.groups.push_back({base, list.names.size(), length.value_or(1), length.has_value()});
    if (!length) {
      list.names.push_back(base);
      continue;
    }
    for (std::size_t i = 1; i <= *length; ++i) {
      list.names.push_back(fmt::format("{}{}", base, i));
      names.declare(list.names.back(), role, item.location);
    }
  }
  if (list.names.empty()) {
    throw ProblemError(value.location, fmt::format("{} names nothing", what));
  }
  return list;
}

std::vector<const Value*> take_values(Section& section, const NameList& list) {
  std::vector<const Value*> values(list.names.size(), nullptr);
  for (const NameList::Group& group : list.groups) {
    const Entry* whole = group.is_vector ? section.take(group.base) : nullptr;
    if (whole != nullptr && whole->value.string() != nullptr) {
      // One formula of the index i, for all components: a sum of one term knows i.
      for (std::size_t i = 1; i <= group.count; ++i) {
        const std::string prefix = fmt::format("sum(i, {0}, {0}, ", i);
        Location location = whole->value.location;
        location.column -= static_cast<int>(prefix.size());  // messages count from the beginning of the formula
        values[group.first + i - 1] = &section.keep({prefix + *whole->value.string() + ")", location});
      }
    } else if (whole != nullptr && whole->value.array() == nullptr) {
      for (std::size_t i = 0; i < group.count; ++i) {  // one number for all
        values[group.first + i] = &whole->value;
      }
    } else if (whole != nullptr) {
      const auto& items = *whole->value.array();
      if (items.size() != group.count) {
        throw ProblemError(whole->value.location,
                           fmt::format("{0} has {1} values, and was declared as {0}[{2}]: give {2}, one number for "
                                       "all, or one formula of the index i",
                                       group.base, items.size(), group.count));
      }
      for (std::size_t i = 0; i < group.count; ++i) {
        values[group.first + i] = &items[i];
      }
    }
    for (std::size_t i = group.first; i < group.first + group.count; ++i) {
      const Entry* entry = section.take(list.names[i]);
      if (entry != nullptr && whole != nullptr) {
        throw ProblemError(entry->location, fmt::format("{0} is given twice, here and in {1} = [..]; write one of them",
                                                        list.names[i], group.base));
      }
      if (entry != nullptr) {
        values[i] = &entry->value;
      }
    }
  }
  return values;
}

Parameters with_time(Parameters parameters, double t, const Location& location) {
  parameters.push_back({.name = "t", .value = t, .location = location});
  return parameters;
}

void take_numbers(Section& section, const NameList& list, const Parameters& parameters, std::vector<double>& into,
                  std::vector<std::string>& missing) {
  const auto values = take_values(section, list);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (values[i] == nullptr) {
      missing.push_back(list.names[i]);
    } else {
      into.push_back(read_number(*values[i], list.names[i], parameters));
    }
  }
}

}  // namespace rubato
