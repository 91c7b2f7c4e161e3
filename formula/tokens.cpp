#include <rubato/formula/tokens.hpp>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

#include <rubato/formula/parse.hpp>

namespace rubato::formula {

namespace {

// The character classes of the C locale, whatever the program's locale is.
bool is_space(char c) {
  return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}
bool is_digit(char c) {
  return c >= '0' && c <= '9';
}
bool is_letter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
}

/// The character that begins at `offset`, whole, or a single byte where the text is not UTF-8.
std::string_view character_at(std::string_view text, std::size_t offset) {
  const auto lead = static_cast<unsigned char>(text[offset]);
  const std::size_t length = lead < 0x80U ? 1 : lead >= 0xF0U ? 4 : lead >= 0xE0U ? 3 : lead >= 0xC2U ? 2 : 0;
  if (length == 0 || offset + length > text.size()) {
    return {};
  }
  const std::string_view character = text.substr(offset, length);
  return std::none_of(character.begin() + 1, character.end(), begins_character) ? character : std::string_view{};
}

struct Hint {
  std::string_view character, advice;
};
constexpr std::array<Hint, 16> hints{{
    {"×", "write * for a product"},
    {"·", "write * for a product"},
    {"⋅", "write * for a product"},
    {"∗", "write * for a product"},
    {"÷", "write / for a quotient"},
    {"−", "write the minus sign as -"},
    {"–", "write the minus sign as -"},
    {"²", "write ^2 for a square"},
    {"³", "write ^3 for a cube"},
    {"√", "write sqrt(...)"},
    {"π", "write pi"},
    {"=", "a formula is one expression, without ="},
    {"{", "only ( ) group"},
    {"}", "only ( ) group"},
    {"|", "write abs(...) for the absolute value"},
    {"'", "derivatives are not written with '"},
}};

[[noreturn]] void refuse_character(std::string_view text, std::size_t offset) {
  const std::string_view character = character_at(text, offset);
  const auto byte = static_cast<unsigned char>(text[offset]);
  if (character.empty()) {
    throw ParseError(text, offset, fmt::format("the byte 0x{:02X} is not valid UTF-8", byte));
  }
  if (byte < 0x20U || byte == 0x7FU) {
    throw ParseError(text, offset, fmt::format("unexpected control character U+{:04X}", byte));
  }
  const auto* const hint =
      std::find_if(hints.begin(), hints.end(), [&](const Hint& known) { return known.character == character; });
  throw ParseError(text, offset,
                   hint == hints.end() ? fmt::format("unexpected character '{}'", character)
                                       : fmt::format("unexpected character '{}': {}", character, hint->advice));
}

/// The value of a number that does not fit the normal range of doubles: 0 (or the nearest) if it is too small.
double extreme_number(std::string_view text, const Token& token) {
  long double wide = 0.0L;
  const auto [end, error] = std::from_chars(token.text.data(), token.text.data() + token.text.size(), wide);
  const bool is_small = error == std::errc{} ? wide < 1.0L : token.text.find('-') != std::string_view::npos;
  if (!is_small) {
    throw ParseError(text, token.offset,
                     fmt::format("the number {} is too large: the largest is about 1.8e308", token.text));
  }
  return error == std::errc{} ? static_cast<double>(wide) : 0.0;
}

Token number_token(std::string_view text, std::size_t offset) {
  std::size_t end = offset;
  const auto digits = [&] {
    while (end < text.size() && is_digit(text[end])) {
      ++end;
    }
  };
  digits();
  if (end < text.size() && text[end] == '.') {
    ++end;
    digits();
  }
  if (end < text.size() && (text[end] == 'e' || text[end] == 'E')) {
    const std::size_t sign = end + 1 < text.size() && (text[end + 1] == '+' || text[end + 1] == '-') ? 1 : 0;
    if (end + 1 + sign < text.size() && is_digit(text[end + 1 + sign])) {
      end += 1 + sign;
      digits();
    }
  }
  Token token{Token::Kind::number, offset, text.substr(offset, end - offset)};
  if (end < text.size() && text[end] == '.') {
    throw ParseError(text, end, fmt::format("the number {} goes on with a second point", token.text));
  }
  const auto [parsed, error] = std::from_chars(token.text.data(), token.text.data() + token.text.size(), token.value);
  if (error == std::errc::result_out_of_range) {
    token.value = extreme_number(text, token);
  }
  return token;
}

}  // namespace

Token next_token(std::string_view text, std::size_t offset) {
  while (offset < text.size() && is_space(text[offset])) {
    ++offset;
  }
  if (offset == text.size()) {
    return {Token::Kind::end, offset};
  }
  const char c = text[offset];
  if (is_digit(c) || (c == '.' && offset + 1 < text.size() && is_digit(text[offset + 1]))) {
    return number_token(text, offset);
  }
  if (is_letter(c)) {
    std::size_t end = offset + 1;
    while (end < text.size() && (is_letter(text[end]) || is_digit(text[end]))) {
      ++end;
    }
    return {Token::Kind::name, offset, text.substr(offset, end - offset)};
  }
  if (c == '<' || c == '>') {
    return {Token::Kind::symbol, offset, text.substr(offset, text.substr(offset + 1).starts_with('=') ? 2 : 1)};
  }
  if (find_operator(c) == nullptr && std::string_view("(),[]:").find(c) == std::string_view::npos) {
    refuse_character(text, offset);
  }
  return {Token::Kind::symbol, offset, text.substr(offset, 1)};
}

const std::vector<std::string>& reserved_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Constant& constant : constants()) {
      all.emplace_back(constant.name);
    }
    for (const Function& function : functions()) {
      all.emplace_back(function.name);
    }
    for (const Word& word : words()) {
      all.emplace_back(word.name);
    }
    return all;
  }();
  return names;
}

bool is_reserved_name(std::string_view name) {
  const Function* const function = find_function(name);
  return find_constant(name) != nullptr || (function != nullptr && !function->yields);
}

bool is_valid_name(std::string_view name) {
  return !name.empty() && is_letter(name.front()) &&
         std::all_of(name.begin(), name.end(), [](char c) { return is_letter(c) || is_digit(c); }) &&
         !is_reserved_name(name);
}

}  // namespace rubato::formula
