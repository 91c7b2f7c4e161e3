// A run that was stopped and resumed stores the bits of the run in one piece: output between levels and events, too.

#include <catch2/catch.hpp>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using rubato::defect_tests::defect_file;
using rubato::tests::Folder;

namespace {

/// The datasets of numbers in which two records differ by a bit, the checkpoint and iterations left out.
std::vector<std::string> differing(const std::string& one, const std::string& other) {
  const record::Reader a(one), b(other);
  std::vector<std::string> paths;
  for (const record::DatasetInfo& info : a.datasets()) {
    if (info.is_text || info.path.starts_with("/checkpoint")) {
      continue;
    }
    const std::vector<double> x = a.read(info.path);
    const std::vector<double> y = b.has(info.path) ? b.read(info.path) : std::vector<double>();
    const auto bits = [](double value) { return std::bit_cast<std::uint64_t>(value); };
    if (!std::ranges::equal(x, y, {}, bits, bits)) {
      paths.push_back(info.path);
    }
  }
  return paths;
}

const std::string orbit = R"toml(
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 - cos(q)"
[initial]
q = 0
p = 1.9
[scheme]
step = 0.3
until = 9
[output]
interval = 0.23
[output.quantities]
energy = "p^2/2 - cos(q)"
[events]
turn = "p"
)toml";

const std::string mechanism = R"toml(
[lagrangian]
q = ["a", "b"]
L = "a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b) + 2*cos(a) + cos(b)"
[initial]
a = "pi/2"
b = 0
a_dot = 0
b_dot = 0
[scheme]
step = 0.1
until = 6
[output]
interval = 0.23
[output.quantities]
rate = "a_dot"
[events]
e = { crossing = "a", quantities = ["b_dot"] }
)toml";

void run_and_resume(const Problem& whole, const Problem& part, const std::string& until) {
  const Folder folder;
  const std::string one = folder / "one.h5", two = folder / "two.h5";
  REQUIRE(run(whole, {.output = one, .threads = 1}).status == ExitStatus::done);
  REQUIRE(run(part, {.output = two, .threads = 1}).status == ExitStatus::done);
  CHECK(differing(one, two) != std::vector<std::string>());  // the twin
  REQUIRE(resume(two, std::stod(until), {.threads = 1}).status == ExitStatus::done);
  CHECK(differing(one, two) == std::vector<std::string>());
  CHECK(check(two).status == ExitStatus::done);
}

}  // namespace

TEST_CASE("output and events after resume have the bits of the run in one piece", "[defects]") {
  const auto of_text = [](const std::string& text, std::vector<std::string> settings, const std::string& stop,
                          const std::string& until) {
    INFO(fmt::format("{}", fmt::join(settings, ", ")));
    settings.push_back("scheme.until=" + until);
    const Problem whole = parse_problem(text, "a.toml", settings);
    settings.back() = "scheme.until=" + stop;
    run_and_resume(whole, parse_problem(text, "a.toml", settings), until);
  };
  using Settings = std::vector<std::string>;
  for (const char* levels : {"scheme.levels=fixed", "scheme.levels=variable"}) {
    for (Settings scheme : {Settings{"scheme.lagrangian=gauss", "scheme.stages=3"},
                            {"scheme.lagrangian=midpoint"},
                            {"scheme.lagrangian=generating", "scheme.order=4"},
                            {"scheme.lagrangian=splitting"}}) {
      scheme.emplace_back(levels);
      of_text(orbit, scheme, "4.1", "9");
    }
    for (Settings scheme : {Settings{"scheme.lagrangian=gauss", "scheme.stages=3"},
                            {"scheme.lagrangian=midpoint"},
                            {"scheme.lagrangian=trapezoid"},
                            {"scheme.lagrangian=lobatto", "scheme.stages=3"}}) {
      scheme.emplace_back(levels);
      of_text(mechanism, scheme, "3.6", "6");
    }
  }
  of_text(orbit,
          {"scheme.lagrangian=custom", "scheme.levels=fixed",
           "scheme.L=(p_0+p_1)/2*(q_1-q_0)/(t_1-t_0)-((p_0+p_1)/2)^2/2+(cos(q_0)+cos(q_1))/2"},
          "2.1", "3");
}

TEST_CASE("the files that resumed with other bits are resumed with the same", "[defects]") {
  run_and_resume(
      read_problem(defect_file("resume-lagrangian-events.toml"), std::vector<std::string>{"scheme.until=6"}),
      read_problem(defect_file("resume-lagrangian-events.toml"), std::vector<std::string>{"scheme.until=3.6"}), "6");
  std::ifstream in(defect_file("resume-lattice-output.toml"));
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const std::string stages = "stages = 3\n";
  text.erase(text.find(stages), stages.size());
  for (const std::vector<std::string>& chosen : {std::vector<std::string>{"scheme.stages=1"},
                                                 {"scheme.stages=3"},
                                                 {"scheme.levels=fixed"},
                                                 {"scheme.lagrangian=box", "grid.x.cells=97"},
                                                 {"scheme.lagrangian=box", "scheme.stages=3", "grid.x.cells=105"},
                                                 {"scheme.lagrangian=splitting"},
                                                 {"scheme.lagrangian=leapfrog"},
                                                 {"scheme.lagrangian=euler-box", "scheme.levels=fixed"}}) {
    INFO(fmt::format("{}", fmt::join(chosen, ", ")));
    std::vector<std::string> settings = chosen;
    settings.emplace_back("scheme.until=3");
    const Problem whole = parse_problem(text, "a.toml", settings);
    settings.back() = "scheme.until=1.7";
    run_and_resume(whole, parse_problem(text, "a.toml", settings), "3");
  }
}

TEST_CASE("all five crossings within one step are told", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto times = [&](const std::string& step) {
    const Outcome ran = run(read_problem(defect_file("p08-pairs-untold.toml"), std::vector{"scheme.step=" + step}),
                            {.output = file, .threads = 1});
    REQUIRE(ran.status == ExitStatus::done);
    const auto warns = [](const Outcome& outcome) {
      return std::ranges::any_of(outcome.warnings, [](const std::string& warning) {
        return warning.find("event z has several crossings within 1 of 1 steps") != std::string::npos;
      });
    };
    CHECK(warns(ran) == (step == "2"));
    const Outcome checked = check(file);
    CHECK(checked.status == ExitStatus::done);
    CHECK(warns(checked) == (step == "2"));
    std::vector<double> t = record::Reader(file).read("/events/z/t");
    std::filesystem::remove(file);
    return t;
  };
  const std::vector<double> of_one = times("2"), of_twenty = times("0.1");
  REQUIRE(of_one.size() == 5);
  REQUIRE(of_twenty.size() == 5);
  for (std::size_t i = 0; i < 5; ++i) {
    CHECK(std::abs(of_one[i] - of_twenty[i]) < 1e-13);  // four stages have p of degree 5 to rounding
  }
}
