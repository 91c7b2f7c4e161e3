#pragma once

#include <string>
#include <string_view>

#include <fmt/format.h>

#include <rubato/base/utf8.hpp>

namespace rubato {

/// `text` (UTF-8) in double quotes, as a string of JSON and of TOML alike: `"`, `\` and control characters are escaped,
/// newline and tab as \n and \t, the others as \uXXXX, which both formats read. What is not UTF-8 becomes U+FFFD.
[[nodiscard]] inline std::string quoted(std::string_view text) {
  constexpr unsigned char first_printable = 0x20, del = 0x7F;
  std::string result = "\"";
  for (const char c : valid_utf8(text)) {
    const auto byte = static_cast<unsigned char>(c);
    switch (c) {
      case '"': result += "\\\""; break;
      case '\\': result += "\\\\"; break;
      case '\n': result += "\\n"; break;
      case '\t': result += "\\t"; break;
      default: result += byte < first_printable || byte == del ? fmt::format("\\u{:04x}", byte) : std::string(1, c);
    }
  }
  return result + '"';
}

}  // namespace rubato
