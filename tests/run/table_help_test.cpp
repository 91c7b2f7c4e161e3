// `rubato help table` explains every line that the table of a run has.

#include <catch2/catch.hpp>

#include <algorithm>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <rubato/figures/text.hpp>
#include <rubato/problem/help.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;

namespace {

/// Whether a label is that of an entry, with some name in place of NAME.
bool is_label_of(const figures::LineEntry& entry, const std::string& label) {
  const std::string_view known = entry.label;
  const std::size_t name = known.find("NAME");
  return name == std::string_view::npos ? label == known
                                        : label.size() > name && label.starts_with(known.substr(0, name));
}

/// Labels of the lines of a table, which are aligned unless they are longer.
std::set<std::string> labels_in(const std::string& table) {
  std::set<std::string> labels;
  std::istringstream lines(table);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("  ")) {
      const std::size_t end = std::min(line.find("  ", 2), line.size());
      labels.insert(line.substr(2, end - 2));
    }
  }
  return labels;
}

}  // namespace

TEST_CASE("help table explains every line of the tables of runs") {
  const Folder folder;
  const std::string help = help_text("table");
  std::set<figures::LineKind> seen;
  for (const auto& [name, settings] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"kepler", {"scheme.until=2", "events.far=x", "laws.every=2"}},
           {"kepler", {"scheme.until=2", "events.far={crossing=\"x\", stop=1}", "hamiltonian.time_scale=x^2+y^2"}},
           {"driven-pendulum", {"scheme.until=2"}},
           {"pendulum-rotation", {"scheme.until=5", "scheme.step_potential=none"}},
           {"sine-gordon", {"scheme.until=1", "grid.x.cells=51"}}}) {
    INFO(name);
    const Outcome outcome = run_problem(name, folder / (name + ".h5"), settings);
    std::filesystem::remove(folder / (name + ".h5"));
    for (const std::string& label : labels_in(to_table(outcome))) {
      INFO(label);
      const auto all = figures::line_entries();
      // That of an invariant is any name: the last to be asked.
      auto entry = std::ranges::find_if(
          all, [&](const auto& one) { return one.kind != figures::LineKind::invariant && is_label_of(one, label); });
      if (entry == all.end()) {
        const auto& invariants = outcome.statistics.invariants;
        const std::string first = label.substr(0, label.find(' '));
        REQUIRE(std::ranges::any_of(invariants, [&](const auto& one) { return one.name == first; }));
        entry = all.begin() + static_cast<int>(figures::LineKind::invariant);
      }
      seen.insert(entry->kind);
      CHECK_THAT(help, Catch::Contains("\n  " + std::string(entry->label) + "\n      "));
    }
  }
  CHECK(seen.size() >= 20);
  CHECK_THAT(help, !Catch::Contains("\n  residual energy\n"));  // names are those of problems
}
