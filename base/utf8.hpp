#pragma once

#include <string>
#include <string_view>

#include <fmt/format.h>

namespace rubato {

/// One character at the beginning of a text: its code, and how many bytes it takes. Of what is not UTF-8 (a broken or
/// overlong sequence, a surrogate) one byte is taken, and `is_valid` is false.
struct Character {
  char32_t code = 0;
  std::size_t length = 1;
  bool is_valid = false;
};

[[nodiscard]] inline Character first_character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) {
    return {lead, 1, true};
  }
  const std::size_t length = lead >= 0xF0 && lead < 0xF8 ? 4 : lead >= 0xE0 ? 3 : 2;
  if (lead < 0xC0 || lead >= 0xF8 || text.size() < length) {
    return {lead, 1, false};
  }
  char32_t code = lead & (0x7FU >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) {
      return {lead, 1, false};
    }
    code = code << 6U | (byte(i) & 0x3FU);
  }
  constexpr char32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool is_surrogate = code >= 0xD800 && code < 0xE000;
  return code < least[length] || is_surrogate || code > 0x10FFFF ? Character{lead, 1, false}
                                                                 : Character{code, length, true};
}

/// The text with U+FFFD in place of every byte that belongs to no character, so that it is UTF-8.
[[nodiscard]] inline std::string valid_utf8(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const Character first = first_character(text);
    result += first.is_valid ? text.substr(0, first.length) : std::string_view("\xEF\xBF\xBD");
    text.remove_prefix(first.length);
  }
  return result;
}

/// The text as it can be shown on a terminal without commanding it: UTF-8, with control characters (all but newline and
/// tab), and those that turn the direction of writing, spelt out as \x1b or \u202e.
[[nodiscard]] inline std::string printable(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const Character first = first_character(text);
    const char32_t code = first.code;
    const bool is_control = (code < 0x20 && code != '\n' && code != '\t') || (code >= 0x7F && code < 0xA0);
    const bool turns = (code >= 0x202A && code <= 0x202E) || (code >= 0x2066 && code <= 0x2069);
    if (!first.is_valid) {
      result += "\xEF\xBF\xBD";
    } else if (is_control) {
      result += fmt::format("\\x{:02x}", static_cast<unsigned>(code));
    } else if (turns) {
      result += fmt::format("\\u{:04x}", static_cast<unsigned>(code));
    } else {
      result += text.substr(0, first.length);
    }
    text.remove_prefix(first.length);
  }
  return result;
}

}  // namespace rubato
