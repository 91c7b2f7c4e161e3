#include <rubato/report/comparison.hpp>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/text.hpp>
#include <rubato/report/contents.hpp>

namespace rubato::report {

namespace {

std::vector<std::string> names_of(const Contents& contents) {
  if (contents.kind == Contents::Kind::orbit) {
    return contents.coordinates;
  }
  std::vector<std::string> names;
  for (const Contents::Field& field : contents.fields) {
    names.push_back(field.name);
  }
  return names;
}

std::string described(const Contents& contents) {
  return fmt::format("{} in {}", contents.kind == Contents::Kind::orbit ? "an orbit" : "a lattice",
                     fmt::join(names_of(contents), ", "));
}

void require_something_in_common(const record::Reader& a, const Contents& in_a, const record::Reader& b,
                                 const Contents& in_b) {
  std::set<std::string> left, both;
  std::ranges::copy(names_of(in_a), std::inserter(left, left.end()));
  for (const std::string& name : names_of(in_b)) {
    if (left.contains(name)) {
      both.insert(name);
    }
  }
  if (in_a.kind != in_b.kind || in_a.axes.size() != in_b.axes.size() || both.empty()) {
    throw std::invalid_argument(fmt::format("nothing can be compared: {} is {}, {} is {}", a.file().string(),
                                            described(in_a), b.file().string(), described(in_b)));
  }
}

/// A line of TOML without its comment and the blanks around it. (Texts of several lines may lose what looks like one:
/// both problems lose it.)
std::string_view without_comment(std::string_view line) {
  char quote = 0;
  std::size_t end = 0;
  for (; end < line.size() && (quote != 0 || line[end] != '#'); ++end) {
    if (quote == 0 && (line[end] == '"' || line[end] == '\'')) {
      quote = line[end];
    } else if (line[end] == quote) {
      quote = 0;
    }
  }
  line = line.substr(0, end);
  const std::size_t first = line.find_first_not_of(" \t\r"), last = line.find_last_not_of(" \t\r");
  return first == std::string_view::npos ? std::string_view() : line.substr(first, last + 1 - first);
}

std::vector<std::string> lines_of_text(std::string_view text) {
  std::vector<std::string> lines;
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    const std::string_view line = without_comment(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (!line.empty()) {
      lines.emplace_back(line);
    }
  }
  return lines;
}

/// What remains of each text when a longest common subsequence of lines is taken out of both.
std::array<std::vector<std::string>, 2> differing_lines(const std::vector<std::string>& a,
                                                        const std::vector<std::string>& b) {
  // common[i][j]: length of the longest common subsequence of a[i…] and b[j…]. Problem files are short.
  std::vector<std::vector<std::size_t>> common(a.size() + 1, std::vector<std::size_t>(b.size() + 1, 0));
  for (std::size_t i = a.size(); i-- > 0;) {
    for (std::size_t j = b.size(); j-- > 0;) {
      common[i][j] = a[i] == b[j] ? common[i + 1][j + 1] + 1 : std::max(common[i + 1][j], common[i][j + 1]);
    }
  }
  std::array<std::vector<std::string>, 2> only;
  std::size_t i = 0, j = 0;
  while (i < a.size() || j < b.size()) {
    if (i < a.size() && j < b.size() && a[i] == b[j]) {
      ++i;
      ++j;
    } else if (j == b.size() || (i < a.size() && common[i + 1][j] >= common[i][j + 1])) {
      only[0].push_back(a[i++]);
    } else {
      only[1].push_back(b[j++]);
    }
  }
  return only;
}

/// Lines with the same label side by side, in the order of the first; what only the second has comes last.
std::vector<std::array<std::string, 3>> side_by_side(const std::vector<figures::Line>& a,
                                                     const std::vector<figures::Line>& b) {
  std::vector<std::array<std::string, 3>> rows;
  rows.reserve(a.size() + b.size());
  const auto value_in = [](const std::vector<figures::Line>& lines, const std::string& label) {
    const auto found = std::ranges::find(lines, label, &figures::Line::label);
    return found == lines.end() ? std::string() : found->value;
  };
  for (const figures::Line& line : a) {
    rows.push_back({line.label, line.value, value_in(b, line.label)});
  }
  for (const figures::Line& line : b) {
    if (std::ranges::find(a, line.label, &figures::Line::label) == a.end()) {
      rows.push_back({line.label, "", line.value});
    }
  }
  return rows;
}

}  // namespace

std::array<std::vector<std::string>, 2> problem_differences(const record::Reader& a, const record::Reader& b,
                                                            const Canonical& canonical) {
  const auto problem = [&](const record::Reader& reader) {
    try {
      return lines_of_text(canonical ? canonical(reader.header().problem) : reader.header().problem);
    } catch (const std::invalid_argument& error) {
      throw record::Error(reader.file(), fmt::format("the problem in it cannot be read ({})", error.what()));
    }
  };
  return differing_lines(problem(a), problem(b));
}

Comparison compare(const record::Reader& a, const record::Reader& b, const Canonical& canonical) {
  const Contents in_a = contents_of(a), in_b = contents_of(b);
  require_something_in_common(a, in_a, b, in_b);
  Comparison comparison{.files = {a.file().string(), b.file().string()},
                        .titles = {a.header().title, b.header().title},
                        .statistics = {summarise(a, in_a), summarise(b, in_b)},
                        .lines = {},
                        .only_in = problem_differences(a, b, canonical)};
  comparison.lines =
      side_by_side(figures::lines_of(comparison.statistics[0]), figures::lines_of(comparison.statistics[1]));
  return comparison;
}

std::string table_side_by_side(const std::array<std::string, 2>& titles, const std::array<std::string, 2>& files,
                               const std::vector<std::array<std::string, 3>>& lines) {
  std::vector<std::array<std::string, 3>> rows{{"", files[0], files[1]}};
  rows.insert(rows.end(), lines.begin(), lines.end());
  std::array<std::size_t, 2> width{0, 0};
  for (const auto& row : rows) {
    for (const std::size_t column : {0, 1}) {
      width[column] = std::max(width[column], row[column].size());
    }
  }
  std::string text = titles[0];
  if (titles[0] != titles[1]) {
    text += " | " + titles[1];
  }
  text += '\n';
  for (const auto& [label, a, b] : rows) {
    text += fmt::format("  {:<{}}  {:<{}}  {}\n", label, width[0], a.empty() && !label.empty() ? "-" : a, width[1],
                        b.empty() ? "-" : b);
  }
  return text;
}

std::string told_differences(const std::array<std::string, 2>& files,
                             const std::array<std::vector<std::string>, 2>& only_in) {
  std::string text;
  for (const std::size_t i : {0, 1}) {
    if (!only_in[i].empty()) {
      text += fmt::format("only in the problem of {}:\n", files[i]);
      for (const std::string& line : only_in[i]) {
        text += "  " + line + '\n';
      }
    }
  }
  return text;
}

std::string to_table(const Comparison& comparison) {
  return table_side_by_side(comparison.titles, comparison.files, comparison.lines) +
         told_differences(comparison.files, comparison.only_in);
}

std::string to_json(const Comparison& comparison) {
  std::vector<figures::JsonObject> records(2);
  for (const std::size_t i : {0, 1}) {
    records[i].text("file", comparison.files[i]);
    figures::add_figures(records[i], comparison.statistics[i]);
  }
  return figures::JsonObject()
      .objects("records", records)
      .lists("problem_differences", {comparison.only_in[0], comparison.only_in[1]})
      .str();
}

}  // namespace rubato::report
