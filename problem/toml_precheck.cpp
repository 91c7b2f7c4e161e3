#include <rubato/problem/toml_precheck.hpp>

#include <cctype>

#include <fmt/format.h>

#include <rubato/problem/location.hpp>

namespace rubato {
namespace {

constexpr std::size_t longest_line = 1'000'000;
constexpr int deepest_nesting = 100;

/// Length of the UTF-8 sequence at the start of `text`, or 0 if it is not one.
std::size_t sequence_length(std::string_view text) {
  const auto byte = [text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) {
    return 1;
  }
  const std::size_t length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  if (lead < 0xC2 || lead > 0xF4 || text.size() < length) {
    return 0;
  }
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) {
      return 0;
    }
  }
  // Overlong forms, surrogates and code points past U+10FFFF show in the second byte.
  const unsigned char second = byte(1);
  const bool bad = (lead == 0xE0 && second < 0xA0) || (lead == 0xED && second > 0x9F) ||
                   (lead == 0xF0 && second < 0x90) || (lead == 0xF4 && second > 0x8F);
  return bad ? 0 : length;
}

/// Walks once through the text, one character at a time, keeping the place.
class Scanner {
public:
  Scanner(std::string_view text, const std::string& source) : text_(text), source_(source) {}

  void run() {
    check_lines();
    while (!at_end()) {
      step();
    }
  }

private:
  [[nodiscard]] bool at_end() const { return position_ >= text_.size(); }
  [[nodiscard]] bool starts_with(std::string_view what) const { return text_.substr(position_).starts_with(what); }
  [[nodiscard]] Location here() const { return {source_, line_, column_}; }

  void check_lines() const {
    std::size_t begin = 0;
    for (int line = 1; begin < text_.size(); ++line) {
      const std::size_t end = std::min(text_.find('\n', begin), text_.size());
      if (end - begin > longest_line) {
        throw ProblemError({source_, line, 1},
                           fmt::format("this line is {} bytes long; the limit is {}. Is this a problem file?",
                                       end - begin, longest_line));
      }
      begin = end + 1;
    }
  }

  /// Goes past one character.
  void advance() {
    const std::size_t length = sequence_length(text_.substr(position_));
    const auto byte = static_cast<unsigned char>(text_[position_]);
    if (length == 0 || byte == 0x7F || (byte < 0x20 && byte != '\t' && byte != '\n' && byte != '\r')) {
      throw ProblemError(here(), fmt::format("byte 0x{:02X} does not belong in a text file; a problem file is TOML in "
                                             "UTF-8",
                                             byte));
    }
    if (byte == '\n') {
      ++line_;
      column_ = 0;
    }
    ++column_;
    position_ += length;
  }

  void advance(std::size_t characters) {
    for (std::size_t i = 0; i < characters; ++i) {
      advance();
    }
  }

  void step() {
    const char c = text_[position_];
    if (c == '#') {
      while (!at_end() && text_[position_] != '\n') {
        advance();
      }
    } else if (c == '"' || c == '\'') {
      skip_string(c);
    } else {
      refuse_beyond_ascii();
      count(c);
      advance();
    }
  }

  /// Typographic quotes, most often. (The parser's own classification of such characters has gaps.)
  void refuse_beyond_ascii() const {
    const std::size_t length = sequence_length(text_.substr(position_));
    if (length > 1) {
      throw ProblemError(here(),
                         fmt::format("'{}' may stand in strings and comments only; elsewhere names are of plain "
                                     "letters, and quotes are \" and '",
                                     text_.substr(position_, length)));
    }
  }

  void skip_string(char quote) {
    const Location opening = here();
    const std::string triple(3, quote);
    const bool long_form = starts_with(triple);
    advance(long_form ? 3 : 1);
    while (!at_end()) {
      const char c = text_[position_];
      if (c == '\n' && !long_form) {
        break;
      }
      if (c == '\\' && quote == '"' && position_ + 1 < text_.size() && text_[position_ + 1] != '\n') {
        advance(2);
      } else if (long_form && starts_with(triple)) {
        advance(3);
        while (!at_end() && text_[position_] == quote) {  // """" closes after a quote of the content
          advance();
        }
        return;
      } else if (!long_form && c == quote) {
        advance();
        return;
      } else {
        advance();
      }
    }
    throw ProblemError(opening, fmt::format("the string that opens here is not closed; end it with {}",
                                            long_form ? triple : std::string(1, quote)));
  }

  void count(char c) {
    if (c == '[' || c == '{') {
      check_depth(++brackets_, "brackets");
    } else if (c == ']' || c == '}') {
      --brackets_;
    } else if (c == '.') {
      check_depth(++dots_, "keys");
    }
    if (c == ',' || c == '=' || c == '\n' || c == '[' || c == ']' || c == '{' || c == '}') {
      dots_ = 0;  // a dotted name ends here
    }
  }

  void check_depth(int depth, std::string_view what) const {
    if (depth > deepest_nesting) {
      throw ProblemError(here(), fmt::format("{} nested deeper than {} levels", what, deepest_nesting));
    }
  }

  std::string_view text_;
  const std::string& source_;
  std::size_t position_ = 0;
  int line_ = 1;
  int column_ = 1;
  int brackets_ = 0;
  int dots_ = 0;
};

}  // namespace

void precheck_toml(std::string_view text, const std::string& source) {
  Scanner(text, source).run();
}

}  // namespace rubato
