// Draws the tables of docs/performance-tables.md as diagrams of work and precision: what is drawn is what stands there.
//
//     benchmark_diagrams docs/performance-tables.md docs/figures           writes the diagrams
//     benchmark_diagrams docs/performance-tables.md docs/figures --check   says whether they are those of the tables

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "../examples/figure.hpp"

namespace {

/// Those of a row that reached their errors: log10 of the CPU time in ms and of the error.
struct Row {
  std::string label;
  Points points;
};
struct Table {
  std::string measure;  ///< "energy", "position"; empty: the error of the solution
  std::vector<double> errors;
  std::vector<Row> rows;
};
struct Section {
  std::string title;
  std::string file;  ///< that the section shows
  std::vector<Table> tables;
};

std::vector<std::string> cells_of(std::string_view line) {
  std::vector<std::string> cells;
  for (std::size_t from = 1; from < line.size();) {
    const std::size_t to = std::min(line.find('|', from), line.size());
    std::string_view cell = line.substr(from, to - from);
    const std::size_t begin = std::min(cell.find_first_not_of(' '), cell.size());
    cell = cell.substr(begin, cell.find_last_not_of(' ') + 1 - begin);
    cells.emplace_back(cell);
    from = to + 1;
  }
  return cells;
}

/// The number that a cell begins with.
std::optional<double> number_of(const std::string& cell) {
  char* end = nullptr;
  const double value = std::strtod(cell.c_str(), &end);
  return end != cell.c_str() && value > 0.0 ? std::optional(value) : std::nullopt;
}

const std::map<std::string, const char*>& colours() {
  static const std::map<std::string, const char*> all = {{"by hand", grey},       {"Boost.Odeint", "#d08a1e"},
                                                         {"SUNDIALS", "#7d5ba6"}, {"fixed levels", blue},
                                                         {"with laws", green},    {"variable levels", red}};
  return all;
}

std::vector<Section> read(std::istream& page) {
  std::vector<Section> sections;
  Table* table = nullptr;
  for (std::string line; std::getline(page, line);) {
    if (line.starts_with("### ")) {
      sections.push_back({line.substr(4), "", {}});
      table = nullptr;
    } else if (constexpr std::string_view figures = "](figures/"; line.starts_with("![") && !sections.empty()) {
      const std::size_t from = line.find(figures);
      if (from != std::string::npos) {
        sections.back().file = line.substr(from + figures.size(), line.find(')', from) - from - figures.size());
      }
    } else if (!line.starts_with("|") || sections.empty()) {
      table = nullptr;
    } else if (const std::vector<std::string> cells = cells_of(line); table == nullptr) {
      // A table of times by errors: all its heads but the first are errors.
      std::vector<double> errors;
      for (std::size_t i = 1; i < cells.size(); ++i) {
        const auto error = cells[i].starts_with("1e-") ? number_of(cells[i]) : std::nullopt;
        if (!error) {
          errors.clear();
          break;
        }
        errors.push_back(*error);
      }
      if (!errors.empty()) {
        sections.back().tables.push_back({cells[0], errors, {}});
        table = &sections.back().tables.back();
      }
    } else {
      const std::string label = cells[0].substr(0, cells[0].find(','));
      if (!colours().contains(label)) {
        continue;
      }
      Row row{label, {}};
      for (std::size_t i = 1; i < std::min(cells.size(), table->errors.size() + 1); ++i) {
        if (const auto time = number_of(cells[i])) {
          row.points.push_back({std::log10(*time), std::log10(table->errors[i - 1])});
        }
      }
      table->rows.push_back(std::move(row));
    }
  }
  std::erase_if(sections, [](const Section& section) { return section.tables.empty(); });
  return sections;
}

std::string draw(const Section& section) {
  Point low{1e9, 1e9}, high{-1e9, -1e9};
  for (const Table& table : section.tables) {
    for (const Row& row : table.rows) {
      for (const Point& point : row.points) {
        low = {std::min(low.x, point.x), std::min(low.y, point.y)};
        high = {std::max(high.x, point.x), std::max(high.y, point.y)};
      }
    }
  }
  const double room = 0.35 * (high.x - low.x);  // for the names of the curves, at the right
  // Five round numbers along each axis.
  const double left = std::floor(2.0 * low.x - 0.2) / 2.0, width = std::ceil((high.x + room - left) / 2.0) * 2.0;
  const double bottom = low.y - 1.0, height = std::ceil((high.y + 1.0 - bottom) / 4.0) * 4.0;
  Figure figure(section.title.substr(0, section.title.find(':')), "log10 of CPU time in ms", "log10 of the error",
                {left, bottom}, {left + width, bottom + height});
  std::vector<std::string> named;
  double place = bottom + 0.92 * height;
  for (const Table& table : section.tables) {
    const bool dashed = &table != &section.tables.front();
    for (const Row& row : table.rows) {
      const char* colour = colours().at(row.label);
      figure.curve(row.points, colour, dashed);
      figure.marks(row.points, colour);
      if (std::ranges::find(named, row.label) == named.end()) {
        named.push_back(row.label);
        figure.note({left + 0.78 * width, place}, row.label, colour);
        place -= 0.08 * height;
      }
    }
    if (section.tables.size() > 1) {
      figure.note({left + 0.78 * width, place}, (dashed ? "dashed: " : "solid: ") + table.measure, "#000");
      place -= 0.08 * height;
    }
  }
  return figure.text();
}

std::string contents_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 3) {
    std::fputs("benchmark_diagrams PAGE FOLDER [--check]\n", stderr);
    return 2;
  }
  const bool check = count > 3 && std::string_view(arguments[3]) == "--check";
  std::ifstream page(arguments[1]);
  const std::vector<Section> sections = read(page);
  int wrong = sections.empty() ? 1 : 0;
  for (const Section& section : sections) {
    const std::filesystem::path file = std::filesystem::path(arguments[2]) / section.file;
    if (section.file.empty()) {
      fmt::print("{}: \"{}\" shows no diagram\n", arguments[1], section.title);
      ++wrong;
    } else if (!check) {
      std::ofstream(file) << draw(section);
    } else if (contents_of(file) != draw(section)) {
      fmt::print("{} is not what its table says: run benchmark_diagrams {} {}\n", section.file, arguments[1],
                 arguments[2]);
      ++wrong;
    }
  }
  return wrong == 0 ? 0 : 1;
}
