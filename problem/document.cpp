#include <rubato/problem/document.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>

#include <fmt/format.h>

// The parser asserts what a file may violate, such as a name after the bracket in "[.x]", and refuses it afterwards
// nevertheless: a build with assertions must not end there.
#define TOML_ASSERT(expression) static_assert(true)
#include <toml++/toml.h>

#include <rubato/base/quoted.hpp>
#include <rubato/problem/toml_precheck.hpp>

namespace rubato {
namespace {

constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";

/// Turns the parser's tree into ours, which keeps the order of the file.
class Converter {
public:
  Converter(std::string_view text, const std::string& source) : source_(source) {
    std::size_t begin = 0;
    while (begin <= text.size()) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      lines_.push_back(text.substr(begin, end - begin));
      begin = end + 1;
    }
  }

  [[nodiscard]] Location location(const toml::source_position& position) const {
    return {source_, static_cast<int>(position.line), static_cast<int>(position.column)};
  }

  [[nodiscard]] Value convert(const toml::node& node) {
    Value value{{}, location(node.source().begin)};
    if (const auto* table = node.as_table()) {
      value.data = convert_table(*table);
    } else if (const auto* array = node.as_array()) {
      Value::Array items;
      items.reserve(array->size());
      for (const toml::node& item : *array) {
        items.push_back(convert(item));
      }
      value.data = std::move(items);
    } else if (const auto* string = node.as_string()) {
      value.data = string->get();
      value.location = content_of_string(value.location);
      if (string->get().find('\0') != std::string::npos) {
        throw ProblemError(value.location, "this text holds the character U+0000, which ends a text everywhere else");
      }
    } else if (const auto* integer = node.as_integer()) {
      value.data = integer->get();
    } else if (const auto* real = node.as_floating_point()) {
      value.data = real->get();
    } else if (const auto* boolean = node.as_boolean()) {
      value.data = boolean->get();
    } else {
      value.data = Value::Date{};
    }
    return value;
  }

private:
  [[nodiscard]] Value::Table convert_table(const toml::table& table) {
    Value::Table entries;
    for (const auto& [key, node] : table) {
      entries.push_back({std::string(key.str()), location(key.source().begin), convert(node)});
    }
    std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
      return std::pair(a.location.line, a.location.column) < std::pair(b.location.line, b.location.column);
    });
    return entries;
  }

  /// The first character inside the quotes of a string that opens at `opening`.
  [[nodiscard]] Location content_of_string(Location opening) {
    const auto line = static_cast<std::size_t>(opening.line) - 1;
    if (line >= lines_.size()) {
      return opening;
    }
    // From the last string on, where that stands before in the same line: a line may hold very many.
    if (opening.line != last_.line || opening.column < last_.column) {
      last_ = {opening.line, 1, lines_[line]};
    }
    std::string_view& rest = last_.rest;
    for (; last_.column < opening.column && !rest.empty(); ++last_.column) {  // columns count characters, not bytes
      rest.remove_prefix(1);
      while (!rest.empty() && (static_cast<unsigned char>(rest.front()) & 0xC0) == 0x80) {
        rest.remove_prefix(1);
      }
    }
    const bool long_form = rest.starts_with(R"(""")") || rest.starts_with("'''");
    const std::string_view after = long_form ? rest.substr(3) : std::string_view();
    if (long_form && (after.empty() || after == "\r")) {
      return {opening.file, opening.line + 1, 1};  // TOML drops a newline right after the opening
    }
    opening.column += long_form ? 3 : 1;
    return opening;
  }

  /// A place in a line, and what stands from there on.
  struct Place {
    int line = 0, column = 1;
    std::string_view rest;
  };

  const std::string& source_;
  std::vector<std::string_view> lines_;
  Place last_;
};

/// The parser's message without its preamble ("Error while parsing key-value pair: "), in one line fit for a terminal.
std::string reworded(std::string_view description) {
  constexpr std::string_view preamble = "Error while parsing ";
  if (const std::size_t colon = description.find(": ");
      description.starts_with(preamble) && colon != description.npos) {
    description.remove_prefix(colon + 2);
  }
  std::string result;
  constexpr std::size_t longest = 300;
  for (const char c : description.substr(0, longest)) {
    result += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return result;
}

bool is_bare_key(std::string_view key) {
  return !key.empty() && std::all_of(key.begin(), key.end(),
                                     [](unsigned char c) { return std::isalnum(c) != 0 || c == '_' || c == '-'; });
}

std::string written_key(const std::string& key) {
  return is_bare_key(key) ? key : rubato::quoted(key);
}

/// Shortest digits that read back to the same double, in TOML's spelling of a float.
std::string written_real(double value) {
  if (!std::isfinite(value)) {
    return std::isnan(value) ? "nan" : value < 0 ? "-inf" : "inf";
  }
  std::string digits = fmt::format("{}", value);
  return digits.find_first_of(".e") == std::string::npos ? digits + ".0" : digits;
}

struct Writer {
  std::string operator()(const std::string& text) const { return rubato::quoted(text); }
  std::string operator()(std::int64_t number) const { return fmt::format("{}", number); }
  std::string operator()(double number) const { return written_real(number); }
  std::string operator()(bool value) const { return value ? "true" : "false"; }
  std::string operator()(Value::Date) const { return "1970-01-01"; }
  std::string operator()(const Value::Array& array) const {
    std::string result = "[";
    for (const Value& item : array) {
      result += (result.size() > 1 ? ", " : "") + write_value(item);
    }
    return result + "]";
  }
  std::string operator()(const Value::Table& table) const {
    std::string result = "{";
    for (const Entry& entry : table) {
      result +=
          fmt::format("{} {} = {}", result.size() > 1 ? "," : "", written_key(entry.key), write_value(entry.value));
    }
    return result + (table.empty() ? "}" : " }");
  }
};

void write_table(const Value::Table& table, const std::string& path, std::string& out) {
  for (const Entry& entry : table) {
    if (entry.value.table() == nullptr) {
      out += fmt::format("{} = {}\n", written_key(entry.key), write_value(entry.value));
    }
  }
  for (const Entry& entry : table) {
    if (const auto* inner = entry.value.table()) {
      const std::string inner_path = path.empty() ? written_key(entry.key) : path + "." + written_key(entry.key);
      out += fmt::format("{}[{}]\n", out.empty() ? "" : "\n", inner_path);
      write_table(*inner, inner_path, out);
    }
  }
}

}  // namespace

std::string_view Value::type_name() const {
  static constexpr std::string_view names[] = {"a string",       "an integer", "a number", "a boolean",
                                               "a date or time", "an array",   "a table"};
  return names[data.index()];
}

const Entry* find(const Value::Table& table, std::string_view key) {
  const auto found = std::find_if(table.begin(), table.end(), [key](const Entry& entry) { return entry.key == key; });
  return found == table.end() ? nullptr : &*found;
}

Entry* find(Value::Table& table, std::string_view key) {
  return const_cast<Entry*>(find(std::as_const(table), key));
}

Value read_document(std::string_view text, const std::string& source) {
  if (text.starts_with(byte_order_mark)) {
    text.remove_prefix(byte_order_mark.size());
  }
  precheck_toml(text, source);
  Converter converter(text, source);
  try {
    const toml::table table = toml::parse(text, source);
    Value root = converter.convert(table);
    root.location = {source, 1, 1};
    return root;
  } catch (const toml::parse_error& error) {
    throw ProblemError(converter.location(error.source().begin), "not TOML: " + reworded(error.description()));
  }
}

std::string write_document(const Value& root) {
  std::string out;
  write_table(*root.table(), "", out);
  return out;
}

std::string write_value(const Value& value) {
  return std::visit(Writer{}, value.data);
}

}  // namespace rubato
