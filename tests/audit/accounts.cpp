#include "audit/accounts.hpp"

#include <algorithm>
#include <cmath>
#include <regex>
#include <sstream>
#include <vector>

#include <fmt/format.h>

#include "audit/bounded.hpp"

namespace audit {

namespace {

bool begins(const std::string& key, const char* with) {
  return key.rfind(with, 0) == 0;
}

/// What the figure may differ by in two evaluations; nullopt-like NaN for a figure that both take from the record.
long double rounding_of(const std::string& key, const Json& run, const Roundings& roundings) {
  long double smallest =
      std::abs(static_cast<long double>(run.has("discrete_energy.value") ? run["discrete_energy.value"] : 0.0));
  smallest = std::max(smallest, std::abs(static_cast<long double>(run["node_energy.initial"])));
  if (key == "discrete_energy.value") {
    return roundings.energy;
  }
  if (key == "discrete_energy.max_relative_deviation" || key == "off_law.max_deviation") {
    return smallest > 0 ? 2 * roundings.energy / smallest : 1.0L;
  }
  if (begins(key, "discrete_energy")) {
    return 2 * roundings.energy;
  }
  if (begins(key, "node_energy")) {
    return 2 * roundings.node_energy;
  }
  if (begins(key, "gamma")) {
    // That of a lattice comes from differences of levels, whose rounding nobody has bounded.
    return roundings.gamma > 0 ? roundings.gamma
                               : 1e-9L * std::abs(run["gamma.min"]) + 1e-9L * std::abs(run["gamma.max"]);
  }
  for (const auto& [name, rounding] : roundings.errors) {
    if (begins(key, ("error." + name + ".").c_str())) {
      return rounding;
    }
  }
  for (const auto& [name, rounding] : roundings.invariants) {
    if (begins(key, ("totals." + name + ".").c_str()) || begins(key, ("invariants." + name + ".").c_str())) {
      return 2 * rounding;
    }
  }
  return 0.0L;
}

}  // namespace

void compare_accounts(const Json& run, const Json& check, const Roundings& roundings, bool sparse,
                      Disagreements& findings) {
  for (const auto& [key, value] : run.numbers) {
    if (key == "status" || key == "wall_seconds" || begins(key, "residuals.")) {
      continue;
    }
    if (!check.has(key)) {
      findings.add("check lacks " + key, fmt::format("run has {}", value));
      continue;
    }
    long double rounding = rounding_of(key, run, roundings);
    if (begins(key, "step_condition")) {
      rounding = 1e-6L * value;  // of a slope
    }
    const long double difference = static_cast<long double>(check[key]) - value;
    const bool least = key.ends_with(".min"), most = key.ends_with(".max") || key.ends_with("deviation");
    const long double wrong = sparse && least ? -difference : sparse && most ? difference : std::abs(difference);
    findings.within("run and check: " + key, wrong, rounding, [&] {
      return fmt::format("run {:.17g}, check {:.17g}, rounding {:.2g}", value, check[key],
                         static_cast<double>(rounding));
    });
  }
}

void same_account(const std::string& kind, const Json& first, const Json& second, Disagreements& findings) {
  for (const auto& [key, text] : first.texts) {
    if (key == "wall_seconds" || key == "file") {
      continue;
    }
    const auto found = second.texts.find(key);
    if (found == second.texts.end() || found->second != text) {
      findings.add(kind + ": " + key,
                   fmt::format("{} and {}", text, found == second.texts.end() ? "nothing" : found->second));
    }
  }
}

namespace {

/// Rows of tables and where the object has their numbers.
std::vector<std::string> prefixes_of(const std::string& row) {
  static const std::map<std::string, std::vector<std::string>> known = {
      {"steps", {"steps", "t"}},
      {"h", {"h."}},
      {"step length", {"h."}},
      {"discrete energy", {"discrete_energy.", "off_law.", "steps"}},
      {"discrete energy, relative deviation", {"discrete_energy.", "off_law.", "steps"}},
      {"step potential", {"step_potential."}},
      {"node energy H(z_k)", {"node_energy."}},
      {"node energy, deviation", {"node_energy."}},
      {"Gamma", {"gamma."}},
      {"steps off the law", {"off_law.", "steps"}},
      {"step condition", {"step_condition."}},
      {"iterations per step", {"newton_iterations."}},
  };
  if (const auto found = known.find(row); found != known.end()) {
    return found->second;
  }
  std::string name = row;
  for (const std::string& suffix : {std::string(", deviation"), std::string(", largest")}) {
    name = name.ends_with(suffix) ? name.substr(0, name.size() - suffix.size()) : name;
  }
  for (const auto& [word, group] :
       {std::pair{"residual ", "residuals."}, {"total ", "totals."}, {"error in ", "error."}}) {
    if (begins(name, word)) {
      return {group + name.substr(std::string(word).size()) + "."};
    }
  }
  return {"invariants." + name + "."};
}

/// Whether the digits printed are those of the value.
bool is_print_of(const std::string& printed, double value) {
  const double read = std::stod(printed);
  std::string digits = printed.substr(0, printed.find_first_of("eE"));
  std::erase_if(digits, [](char c) { return c == '.' || c == '-' || c == '+'; });
  digits.erase(0, std::min(digits.find_first_not_of('0'), digits.size()));
  const auto count = std::max<std::size_t>(digits.size(), 1);
  // Trailing zeros are not printed, so that any number of digits from here on may have been meant.
  for (std::size_t precision = count; precision <= 17; ++precision) {
    if (std::stod(fmt::format("{:.{}g}", value, precision)) == read) {
      return true;
    }
  }
  return false;
}

std::vector<std::string> cells_of(const std::string& line) {
  static const std::regex gap(" {2,}");
  const std::string text = line.substr(line.find_first_not_of(' '));
  return {std::sregex_token_iterator(text.begin(), text.end(), gap, -1), std::sregex_token_iterator()};
}

}  // namespace

void compare_table(const std::string& table, const Json& json, std::size_t column, Disagreements& findings) {
  static const std::regex number(R"([-+]?\d+\.?\d*(?:[eE][-+]?\d+)?)");
  static const std::regex words(R"(\(3\.4\)|H\(z_k\))");
  std::istringstream lines(table);
  for (std::string line; std::getline(lines, line);) {
    // Deeper in stand the values that `check` found to disagree.
    if (line.rfind("  ", 0) != 0 || line.rfind("    ", 0) == 0) {
      continue;
    }
    std::vector<std::string> cells = cells_of(line);
    if (cells.size() == 1 && cells[0].find(' ') != std::string::npos) {  // a long name leaves one blank
      const std::size_t split = cells[0].find(' ', cells[0].rfind("residual ", 0) == 0 ? 9 : 0);
      cells = {cells[0].substr(0, split), cells[0].substr(split + 1)};
    }
    if (cells.size() < column + 2 || cells[0] == "record" || cells[0] == "recomputed" || cells[0] == "time taken" ||
        cells[0] == "verdict" ||  // its sentences are in the object as texts
        cells[0].find(" = ") != std::string::npos) {
      continue;
    }
    const std::string text = std::regex_replace(cells[column + 1], words, "");
    for (auto at = std::sregex_iterator(text.begin(), text.end(), number); at != std::sregex_iterator(); ++at) {
      bool found = false;
      for (const std::string& prefix : prefixes_of(cells[0])) {
        for (const auto& [key, value] : json.numbers) {
          found = found || (begins(key, prefix.c_str()) && is_print_of(at->str(), value));
        }
      }
      if (!found) {
        findings.add("table: " + cells[0],
                     fmt::format("{} in \"{}\" is in no figure of the JSON object", at->str(), line));
      }
    }
  }
}

}  // namespace audit
