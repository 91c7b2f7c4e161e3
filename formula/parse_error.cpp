#include <rubato/formula/parse.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/tokens.hpp>

namespace rubato::formula {

namespace {

constexpr std::size_t excerpt_width = 80;

struct Place {
  std::size_t line = 1, column = 1;
  std::string_view line_text;
};

Place place_of(std::string_view text, std::size_t offset) {
  offset = std::min(offset, text.size());
  const std::string_view before = text.substr(0, offset);
  const std::size_t newline = before.rfind('\n');
  const std::size_t begin = newline == std::string_view::npos ? 0 : newline + 1;
  const std::string_view left = before.substr(begin);
  std::string_view line = text.substr(begin, text.find('\n', offset) - begin);
  if (line.ends_with('\r')) {
    line.remove_suffix(1);
  }
  return {1 + static_cast<std::size_t>(std::count(before.begin(), before.end(), '\n')),
          1 + static_cast<std::size_t>(std::count_if(left.begin(), left.end(), begins_character)), line};
}

/// The line around `column`, at most excerpt_width characters of it, and a caret below the column.
std::string excerpt(std::string_view line, std::size_t column) {
  std::vector<std::string_view> characters;
  for (std::size_t begin = 0; begin < line.size();) {
    std::size_t end = begin + 1;
    while (end < line.size() && !begins_character(line[end])) {
      ++end;
    }
    characters.push_back(line.substr(begin, end - begin));
    begin = end;
  }
  const std::size_t place = column - 1;
  std::size_t first = 0;
  std::size_t last = characters.size();
  if (last > excerpt_width) {
    first = std::min(place > excerpt_width / 2 ? place - excerpt_width / 2 : 0, last - excerpt_width);
    last = first + excerpt_width;
  }
  std::string shown = first > 0 ? "  ..." : "  ";
  const std::string caret = std::string(shown.size() + (place - first), ' ') + '^';
  for (std::size_t i = first; i < last; ++i) {
    const bool is_control = characters[i].size() == 1 && static_cast<unsigned char>(characters[i].front()) < 0x20U;
    shown += is_control ? std::string_view(" ") : characters[i];
  }
  return shown + (last < characters.size() ? "...\n" : "\n") + caret;
}

std::string message(std::string_view text, std::size_t offset, const std::string& reason) {
  const Place place = place_of(text, offset);
  return reason + '\n' + excerpt(place.line_text, place.column);
}

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

/// Number of insertions, deletions, replacements and exchanges of neighbours (case aside) that turn x into y.
std::size_t edit_distance(std::string_view x, std::string_view y) {
  std::vector<std::size_t> before(y.size() + 1), above(y.size() + 1), row(y.size() + 1);
  for (std::size_t j = 0; j <= y.size(); ++j) {
    above[j] = j;
  }
  for (std::size_t i = 1; i <= x.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= y.size(); ++j) {
      const auto same = [&](std::size_t k, std::size_t l) { return lower(x[k - 1]) == lower(y[l - 1]); };
      row[j] = std::min({above[j] + 1, row[j - 1] + 1, above[j - 1] + (same(i, j) ? 0 : 1)});
      if (i > 1 && j > 1 && same(i, j - 1) && same(i - 1, j)) {
        row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    std::swap(before, above);
    std::swap(above, row);
  }
  return above[y.size()];
}

}  // namespace

ParseError::ParseError(std::string_view text, std::size_t offset, const std::string& reason)
    : std::invalid_argument(message(text, offset, reason)), offset_(offset), reason_(reason) {
  const Place place = place_of(text, offset);
  line_ = place.line;
  column_ = place.column;
}

namespace {

void refuse_bracket(std::string_view text, const Token& token) {
  if (is_comparison(token)) {
    throw ParseError(
        text, token.offset,
        fmt::format("unexpected '{}': in a formula a comparison stands in where(a < b, f, g) only", token.text));
  }
  if (token.is('[') || token.is(']') || token.is(':')) {
    throw ParseError(
        text, token.offset,
        fmt::format("unexpected character '{}': only ( ) group; name[i] is a component of a vector", token.text));
  }
}

}  // namespace

void refuse_missing_operand(std::string_view text, const Token& previous, const Token& token) {
  refuse_bracket(text, token);
  if (token.kind == Token::Kind::end) {
    throw ParseError(text, token.offset, fmt::format("a number, name or ( is missing after '{}'", previous.text));
  }
  if (token.is('+')) {
    throw ParseError(text, token.offset,
                     "a number, name or ( is missing before '+': a plus sign stands only between two operands");
  }
  if (previous.is('(') && token.is(')')) {
    throw ParseError(text, previous.offset, "nothing stands between ( and )");
  }
  throw ParseError(text, token.offset, fmt::format("a number, name or ( is missing before '{}'", token.text));
}

void refuse_after_operand(std::string_view text, const Token& previous, const Token& token) {
  refuse_bracket(text, token);
  if (token.is(',')) {
    const bool decimal = previous.kind == Token::Kind::number;
    throw ParseError(text, token.offset,
                     decimal ? "a comma separates the arguments of a function: decimals are written with a point"
                             : "a comma separates the arguments of a function");
  }
  const bool whole = !previous.is(')') && !token.is('(');
  throw ParseError(text, token.offset,
                   whole ? fmt::format("an operator is missing: for a product write {}*{}", previous.text, token.text)
                         : fmt::format("an operator is missing before '{}': for a product write *", token.text));
}

namespace {

std::string did_you_mean(std::string_view name, std::span<const std::string> known,
                         std::span<const std::string> others) {
  auto nearest = nearest_name(name, known);
  if (!nearest) {
    nearest = nearest_name(name, others);
  }
  return nearest ? fmt::format(": did you mean '{}'?", *nearest) : std::string();
}

void refuse_foreign(std::string_view text, const Token& token, std::string_view kind) {
  if (const std::string_view advice = foreign_advice(token.text); !advice.empty()) {
    throw ParseError(text, token.offset, fmt::format("unknown {} '{}': {}", kind, token.text, advice));
  }
}

}  // namespace

void refuse_name(std::string_view text, const Token& name, std::span<const std::string> known) {
  if (find_function(name.text) != nullptr) {
    throw ParseError(text, name.offset, fmt::format("{0} is a function: write {0}(...)", name.text));
  }
  refuse_foreign(text, name, "name");
  throw ParseError(text, name.offset,
                   fmt::format("unknown name '{}'{}", name.text, did_you_mean(name.text, known, reserved_names())));
}

void refuse_function(std::string_view text, const Token& called, std::span<const std::string> known) {
  refuse_foreign(text, called, "function");
  throw ParseError(
      text, called.offset,
      fmt::format("unknown function '{}'{}", called.text, did_you_mean(called.text, reserved_names(), known)));
}

std::optional<std::string> nearest_name(std::string_view name, std::span<const std::string> known) {
  constexpr std::size_t farthest = 2;
  std::size_t least = farthest + 1;
  std::optional<std::string> nearest;
  for (const std::string& candidate : known) {
    const std::size_t gap =
        candidate.size() > name.size() ? candidate.size() - name.size() : name.size() - candidate.size();
    if (gap >= least) {
      continue;
    }
    if (const std::size_t distance = edit_distance(name, candidate); distance < least && 2 * distance < name.size()) {
      least = distance;
      nearest = candidate;
    }
  }
  return nearest;
}

}  // namespace rubato::formula
