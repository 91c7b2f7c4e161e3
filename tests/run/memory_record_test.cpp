#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

#include <rubato/record/reader.hpp>
#include <rubato/run/memory_record.hpp>

#include "records.hpp"

using namespace rubato;

namespace {

/// How many numbers of `memory` are not those of the record in `file`.
std::size_t differences(const MemoryRecord& memory, const std::string& file, std::size_t& compared) {
  const record::Reader reader(file);
  std::size_t count = 0;
  for (std::size_t i = 0; i < memory.layout().datasets.size(); ++i) {
    const std::vector<double> stored = reader.read(memory.layout().datasets[i].path);
    std::visit(
        [&](const auto& values) {
          count += values.size() == stored.size() ? 0 : 1;
          for (std::size_t k = 0; k < std::min(values.size(), stored.size()); ++k) {
            const auto value = static_cast<double>(values[k]);
            count += value == stored[k] || (std::isnan(value) && std::isnan(stored[k])) ? 0 : 1;
          }
          compared += stored.size();
        },
        memory.values(i));
  }
  return count;
}

}  // namespace

TEST_CASE("a run in memory has the rows of its record", "[run]") {
  const tests::Folder folder;
  const std::string file = folder / "a.h5";
  const auto [name, settings] = GENERATE(table<std::string, std::vector<std::string>>(
      {{"kepler", {"scheme.until=2", "output.every=7"}},
       {"pendulum", {"scheme.until=5", "output.interval=0.3", "events.a={crossing=\"q\"}"}},
       {"sine-gordon", {"scheme.until=0.3", "laws.every=2"}},
       {"bbm", {"scheme.until=0.2", "grid.x.cells=51"}}}));
  const Problem problem = read_problem(name, settings);
  const Outcome stored = run(problem, {.output = file});
  MemoryRecord memory;
  const Outcome kept = run(problem, memory);
  CHECK(kept.status == stored.status);
  CHECK(kept.file.empty());
  CHECK(run_tests::differences(kept, stored) == run_tests::Names{});
  std::size_t compared = 0;
  CHECK(differences(memory, file, compared) == 0);
  CHECK(compared > 100);

  // Another run has other rows.
  static_cast<void>(run(problem, memory));
  CHECK(differences(memory, file, compared) == 0);
  static_cast<void>(run(read_problem(name, std::vector<std::string>{"scheme.until=0.1"}), memory));
  CHECK(differences(memory, file, compared) > 0);
}

TEST_CASE("a run in memory that leaves the domain of its formula keeps whole levels", "[run]") {
  const Problem problem = parse_problem(R"toml(
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 + log(q)"
[initial]
q = 0.2
p = -1
[scheme]
levels = "fixed"
step = 0.05
until = 10
)toml",
                                        "falls.toml");
  MemoryRecord memory;
  const Outcome outcome = run(problem, memory);
  CHECK(outcome.status != ExitStatus::done);
  CHECK_FALSE(outcome.message.empty());
  std::optional<std::size_t> levels, steps;
  for (std::size_t i = 0; i < memory.layout().datasets.size(); ++i) {
    const std::size_t rows =
        std::visit([](const auto& values) { return values.size(); }, memory.values(i)) / memory.row_size(i);
    std::optional<std::size_t>& known = memory.layout().datasets[i].axis == "/levels/step" ? steps : levels;
    CHECK(known.value_or(rows) == rows);
    known = rows;
  }
  CHECK(*levels == *steps + 1);
  CHECK(outcome.statistics.steps == *steps);
}
