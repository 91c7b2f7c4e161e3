#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/formula/language.hpp>

/// Reading a formula word by word. Used by parse.cpp.
namespace rubato::formula {

struct Token {
  enum class Kind { end, number, name, symbol };  ///< a symbol is one of + - * / ^ ( ) [ ] , < > <= >=
  Kind kind = Kind::end;
  std::size_t offset = 0;
  std::string_view text = {};
  double value = 0.0;  ///< of a number

  [[nodiscard]] bool is(char symbol) const { return kind == Kind::symbol && text.front() == symbol; }
};

/// Reads the token of `text` that begins at or after `offset`, past white space.
/// \throws ParseError for a character outside the language, a malformed number, or one that overflows
[[nodiscard]] Token next_token(std::string_view text, std::size_t offset);

[[nodiscard]] inline bool is_comparison(const Token& token) {
  return token.is('<') || token.is('>');
}

/// What is wrong where an operand ought to begin, or where one has been read and neither an operator nor a closing
/// parenthesis follows; `previous` and `token` are the last two tokens of `text` that were read.
/// \throws ParseError
///@{
[[noreturn]] void refuse_missing_operand(std::string_view text, const Token& previous, const Token& token);
[[noreturn]] void refuse_after_operand(std::string_view text, const Token& previous, const Token& token);
///@}

/// What is wrong with a name, or with that of a function, which neither the language nor the caller knows; `known` are
/// the caller's names. \throws ParseError
///@{
[[noreturn]] void refuse_name(std::string_view text, const Token& name, std::span<const std::string> known);
[[noreturn]] void refuse_function(std::string_view text, const Token& called, std::span<const std::string> known);
///@}

/// The names of all functions, words and constants, whether they may be given to something else or not.
[[nodiscard]] const std::vector<std::string>& reserved_names();

/// True if a byte of UTF-8 text begins a character.
[[nodiscard]] constexpr bool begins_character(char byte) {
  return (static_cast<unsigned char>(byte) & 0xC0U) != 0x80U;
}

}  // namespace rubato::formula
