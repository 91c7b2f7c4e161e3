#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <rubato/problem/location.hpp>

namespace rubato {

struct Entry;

/// A TOML value with the place where it was written. Tables keep the order of the file, so that a problem written back
/// lists its invariants and parameters as its author did.
struct Value {
  using Array = std::vector<Value>;
  using Table = std::vector<Entry>;
  /// A date or a time: legal TOML, and wrong everywhere in a problem.
  struct Date {};

  std::variant<std::string, std::int64_t, double, bool, Date, Array, Table> data;
  Location location;  ///< of its first character; for a string, of the first character of its content

  [[nodiscard]] const std::string* string() const { return std::get_if<std::string>(&data); }
  [[nodiscard]] const Array* array() const { return std::get_if<Array>(&data); }
  [[nodiscard]] const Table* table() const { return std::get_if<Table>(&data); }
  [[nodiscard]] Table* table() { return std::get_if<Table>(&data); }
  /// "a string", "an integer", …
  [[nodiscard]] std::string_view type_name() const;
};

struct Entry {
  std::string key;
  Location location;  ///< of the key
  Value value;
};

[[nodiscard]] const Entry* find(const Value::Table& table, std::string_view key);
[[nodiscard]] Entry* find(Value::Table& table, std::string_view key);

/// Reads TOML; `source` names it in locations. The root is a table.
/// Refused before the TOML parser sees them: bytes that are not UTF-8 text, characters beyond ASCII outside strings
/// and comments, unclosed strings (named by where they open), nesting deeper than 100 levels, lines longer than 10^6
/// bytes. \throws ProblemError
[[nodiscard]] Value read_document(std::string_view text, const std::string& source);

/// TOML that read_document() reads back to the same values in the same order.
[[nodiscard]] std::string write_document(const Value& root);

/// The same for one value, in one line.
[[nodiscard]] std::string write_value(const Value& value);

}  // namespace rubato
