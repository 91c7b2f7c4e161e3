#include <rubato/problem/help.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/text.hpp>
#include <rubato/formula/language.hpp>
#include <rubato/problem/browse.hpp>
#include <rubato/problem/keys.hpp>

namespace rubato {

namespace {

constexpr std::size_t page_width = 100;

/// The text in lines of the page's width, every one behind `indent` spaces.
std::string wrapped(std::string_view text, std::size_t indent) {
  std::string result;
  std::string line;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(' '), text.size());
    if (!line.empty() && indent + line.size() + 1 + end > page_width) {
      result += std::string(indent, ' ') + line + "\n";
      line.clear();
    }
    if (!line.empty()) {
      line += ' ';
    }
    line += text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return line.empty() ? result : result + std::string(indent, ' ') + line + "\n";
}

std::string function_line(const formula::Function& function) {
  return fmt::format("  {:<16}{}{}\n", fmt::format("{}({})", function.name, function.arguments), function.meaning,
                     function.domain.empty() ? "" : fmt::format("; defined for {}", function.domain));
}

std::string formulas() {
  std::string text =
      "Formulas\n\nA formula is one expression, written in quotes in a problem file: \"p^2/2 - "
      "cos(q)\".\n\nOperators\n";
  for (const formula::Operator& op : formula::operators()) {
    text += fmt::format("  a {} b           {}{}\n", op.symbol, op.meaning,
                        op.to_the_right ? fmt::format(": a {0} b {0} c is a {0} (b {0} c)", op.symbol) : "");
  }
  text += "  -a              the opposite\n  ( )             grouping; there are no other brackets\n";
  // From the tightest to the loosest.
  std::vector<std::string> levels;
  for (int strength = formula::strength_of_power; strength >= formula::strength_of_sum; --strength) {
    std::string level;
    for (const formula::Operator& op : formula::operators()) {
      if (op.strength == strength) {
        level += fmt::format("{}{}", level.empty() ? "" : " and ", op.symbol);
      }
    }
    levels.push_back(level);
    if (strength == formula::strength_of_power) {
      levels.emplace_back("the sign of -a");
    }
  }
  text +=
      wrapped(fmt::format("Precedence, from the tightest: {}. So -x^2 is -(x^2) and 2^-x is 2^(-x). A product needs "
                          "its *: 2*x, not 2x.",
                          fmt::join(levels, "; then ")),
              2);
  text += "\nFunctions\n";
  for (const formula::Function& function : formula::functions()) {
    text += function_line(function);
  }
  for (const formula::Word& word : formula::words()) {
    text += fmt::format("  {:<16}{}\n", fmt::format("{}({})", word.name, word.arguments), word.meaning);
  }
  text += "  a^b with a < 0 is defined for integers b.\n\nNumbers\n";
  for (const formula::Constant& constant : formula::constants()) {
    text += fmt::format("  {:<16}{}\n", constant.name, constant.meaning);
  }
  text += "  1.5e-3          decimals have a point; e marks a power of ten\n\nNames\n";
  text += wrapped(
      "A letter or _, then letters, digits and _. Capitals count. Coordinates, momenta, fields, parameters "
      "and invariants may have any names but those above; t, and x, y, z on a lattice, are taken. e is an "
      "ordinary name: write exp(1). The functions from erf on give way: a problem may have something called norm, and "
      "norm(...) is no function there.",
      2);
  text += "\nVectors\n";
  text += wrapped(
      "q = [\"r[3]\"] declares r1, r2, r3, and formulas name these. Where values are given, "
      "r = [1, 0, \"a/2\"] or r1 = ..., r2 = ..., r3 = ... may be written, not both; "
      "r = 0 gives all components one number, r = \"sin(i*pi/4)\" every component by its index i. In formulas r[i] is "
      "a component, for an i that is a "
      "number, a parameter or the index of a sum: sum(i, 1, 2, (r[i+1] - r[i])^2). \"r[N]\" is as long as the integer "
      "N "
      "of [parameters]. In norm and dot, and nowhere else, r is the whole vector, as far as r1, r2, ... go, and r[1:2] "
      "a part of it; there is r + s, r - s, -r, 2*r, r/2: norm(r - s), dot(r, p), norm(r[1:2]). norm(x, y) is "
      "sqrt(x^2 + y^2): sum(i, 1, N, sum(j, i + 1, N, 1/norm(x[i] - x[j], y[i] - y[j]))).",
      2);
  text += "\nChoices\n";
  text += wrapped(
      "where(a < b, f, g), with <, <=, > or >=, is f where that holds, and g elsewhere; the other one need not be "
      "defined there (with generating both have to be). Derivatives are those of f and of g, and know nothing of a "
      "jump "
      "between them: where f and g differ on the border there is no force, and the energy of the solution jumps. A "
      "formula is as smooth as f and g fit together: if their n-th derivatives differ on the border, and none before, "
      "a "
      "step over it errs by the step to the power n, whatever the order of the scheme.",
      2);
  text += "\nRandom numbers\n";
  text += wrapped(
      "noise(3) is a normal random number, of mean 0 and deviation 1, always the same for the same integer: "
      "r = \"0.1*noise(i)\" gives every component its own. In [initial] and S of a lattice noise(3, 8) is a random "
      "function of x (y, z): all waves with up to 8 periods along each axis, of mean 0 and deviation 1, the same "
      "however many cells the grid has.",
      2);
  text += "\nWhat a formula may name, beside parameters\n";
  const auto where = [&](std::string_view place, std::string_view names) {
    text += fmt::format("  {:<32}{}\n", place, names);
  };
  std::vector<std::string> derivatives;
  for (const std::string_view axis : axis_letters) {
    derivatives.push_back(fmt::format("d{}(f)", axis));
  }
  where("H of [hamiltonian]", "coordinates and momenta");
  where("L of [lagrangian]", "coordinates, and velocities: coordinates with _dot");
  where("S of [multisymplectic]", "fields");
  where("L of [scheme]", "t_0, t_1, and coordinates and momenta with _0 and _1");
  where("[initial] of an orbit", "t, the start");
  where("[initial] of a lattice", fmt::format("{}, t, the start; {} of other initial fields and of formulas",
                                              fmt::join(axis_letters, ", "), fmt::join(derivatives, ", ")));
  where("[invariants] of an orbit", "coordinates and momenta");
  where("  with [lagrangian]", "coordinates, velocities, and momenta: coordinates after p_");
  where("[invariants] of a lattice",
        fmt::format("fields, {} of fields, {}, t", fmt::join(derivatives, ", "), fmt::join(axis_letters, ", ")));
  where("[output.quantities], [events]", "the same, and t; on a lattice also integral(f)");
  where("[exact]", fmt::format("t, and on a lattice {}", fmt::join(axis_letters, ", ")));
  where("[parameters], and every number", "other parameters");
  text += wrapped(fmt::format("{} are derivatives on the grid (spectral), and may be nested: dx(dx(u)).",
                              fmt::join(derivatives, ", ")),
                  2);
  return text;
}

std::string key_text(const KeyEntry& key) {
  std::string text = fmt::format("  {:<18}{}; {}\n", key.name, key.type,
                                 key.fallback.starts_with("required") || key.fallback == "none"
                                     ? (key.fallback == "none" ? "may be left out" : key.fallback)
                                     : "default: " + key.fallback);
  text += wrapped(key.meaning, 20);
  if (!key.words.empty()) {
    text += wrapped(fmt::format("One of \"{}\".", fmt::join(key.words, "\", \"")), 20);
  }
  return text;
}

/// A table of the problem file with its keys; those that are tables of the file itself go to `tables`.
std::string table_text(const TableEntry& table, std::vector<std::string>& tables) {
  std::string text = table.name.empty() ? "The file\n" : fmt::format("[{}]\n", table.name);
  text += wrapped(table.meaning, 2);
  for (const KeyEntry& key : problem_keys()) {
    if (key.table != table.name) {
      continue;
    }
    if (table.name.empty() && key.type == "table") {
      tables.push_back(
          fmt::format("[{}]{}", key.name, key.fallback == "none" ? "" : fmt::format(" ({})", key.fallback)));
    } else {
      text += key_text(key);
    }
  }
  text += tables.empty() ? "" : wrapped(fmt::format("Tables: {}.", fmt::join(tables, ", ")), 2);
  if (!table.names_what.empty()) {
    text += fmt::format("  {:<18}the value of {}\n", "NAME", table.names_what);
  }
  return text;
}

std::string problem() {
  std::string text =
      "Problem files\n\n" +
      wrapped(
          "A problem is a TOML file. `rubato show NAME` prints a complete one to start from, `rubato list` the names, "
          "and `rubato help formulas` what a formula may hold. A number may be written as a formula of the "
          "parameters, in quotes. Keys that are not listed here are errors. `rubato run FILE --set "
          "table.key=value` changes one entry, and `--unset table.key` removes one.",
          0);
  for (const TableEntry& table : problem_tables()) {
    std::vector<std::string> tables;
    text += "\n" + table_text(table, tables);
  }
  return text;
}

std::string table_of_run() {
  std::string text = "The table that a run prints\n\n" +
                     wrapped(
                         "Lines appear only where they apply. NAME is a name of the problem. Figures are of all steps "
                         "and levels, whatever the record stores. `--json` prints the same numbers.",
                         0) +
                     "\n";
  for (const figures::LineEntry& line : figures::line_entries()) {
    text += fmt::format("  {}\n", line.label) + wrapped(line.meaning, 6);
  }
  return text;
}

}  // namespace

const std::vector<std::string>& help_topics() {
  static const std::vector<std::string> topics = [] {
    std::vector<std::string> all = {"formulas", "problem", "table"};
    for (const TableEntry& table : problem_tables()) {
      if (!table.name.empty()) {
        all.emplace_back(table.name);
      }
    }
    return all;
  }();
  return topics;
}

std::string help_text(std::string_view topic) {
  if (topic == "formulas") {
    return formulas();
  }
  if (topic == "problem") {
    return problem();
  }
  if (topic == "table") {
    return table_of_run();
  }
  if (const auto table = std::ranges::find(problem_tables(), topic, &TableEntry::name);
      !topic.empty() && table != problem_tables().end()) {
    std::vector<std::string> tables;
    return table_text(*table, tables);
  }
  const std::string guess = did_you_mean(topic, help_topics());
  throw std::invalid_argument(
      fmt::format("there is no help on {}; {}", topic.substr(0, 100),
                  guess.empty() ? fmt::format("topics are {}", fmt::join(help_topics(), ", ")) : guess));
}

}  // namespace rubato
