// Members of an ensemble that go side by side in vectors.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include <rubato/problem/document.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/ensemble_lanes.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;

namespace {

const std::string orbits = R"toml(title = "T"
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "(u^2 + v^2)/2 + (x^2 + y^2)/2 + k*(x^2*y - y^3/3) + sin(x)/20 + 2"
[parameters]
k = 1
[initial]
x = "k/20"
y = 0.1
u = 0.3
v = 0
t = 1.5
[invariants]
L = "x*v - y*u"
K = "sqrt(1.5 + x)"
[scheme]
lagrangian = "splitting"
levels = "fixed"
step = 0.05
until = 30
)toml";

/// Many start where they run away; of others K has no value somewhere.
const std::string starts = R"toml([ensemble]
random = { count = 45, seed = 1, initial.x = "uniform(-0.9, 0.9)", initial.v = "uniform(-0.9, 0.9)" }
)toml";

Problem with(const std::string& ensemble, const std::vector<std::string>& settings = {}) {
  return parse_problem(orbits + ensemble, "t.toml", settings);
}

/// A desk for some members of an ensemble.
class Desk final : public MemberDesk {
public:
  explicit Desk(std::size_t members) : results(members) {}
  std::optional<std::size_t> next() override {
    return taken_ < results.size() ? std::optional(taken_++) : std::nullopt;
  }
  void hand_in(std::size_t member, MemberResult result) override { results[member] = std::move(result); }
  void fail(std::exception_ptr error) override { std::rethrow_exception(error); }
  void halt() override {}
  [[nodiscard]] bool halted() const override { return halts; }
  [[nodiscard]] const std::atomic<bool>* interrupt() const override { return nullptr; }

  std::vector<std::optional<MemberResult>> results;
  bool halts = false;

private:
  std::size_t taken_ = 0;
};

bool same(const std::vector<double>& a, const std::vector<double>& b) {
  return std::ranges::equal(a, b, [](double x, double y) { return x == y || (x != x && y != y); });
}

/// Whether two results are one, bit by bit.
bool same(const MemberResult& a, const MemberResult& b) {
  const auto all = [](const auto& x, const auto& y) {
    return std::ranges::equal(x, y, [](const auto& one, const auto& other) { return same(one, other); });
  };
  return a.status == b.status && a.message == b.message && same(a.figures, b.figures) && all(a.states, b.states) &&
         all(a.series, b.series);
}

/// A problem of one member, which has nobody to go beside.
Problem alone(const Problem& ensemble, std::size_t member) {
  Problem one = ensemble;
  one.ensemble->values = {ensemble.ensemble->values[member]};
  return one;
}

std::vector<std::optional<MemberResult>> run_all(const Problem& problem, const std::vector<std::string>& names) {
  Desk desk(problem.ensemble->members());
  run_members(problem, names, desk);
  return std::move(desk.results);
}

/// Of the members that went side by side all, the others are nothing.
std::vector<std::optional<MemberResult>> run_side_by_side(const Problem& problem,
                                                          const std::vector<std::string>& names) {
  const std::size_t members = problem.ensemble->members();
  std::vector<std::optional<MemberResult>> results;
  const auto lanes = MemberLanes::make(problem, names);
  const Desk desk(members);
  while (results.size() < members) {
    std::vector<std::size_t> numbers;
    const std::size_t last = lanes == nullptr ? members : std::min(results.size() + lanes->width(), members);
    for (std::size_t m = results.size(); m < last; ++m) {
      numbers.push_back(m);
    }
    auto some = lanes == nullptr ? std::vector<std::optional<MemberResult>>(numbers.size()) : lanes->run(numbers, desk);
    std::ranges::move(some, std::back_inserter(results));
  }
  return results;
}

/// How many members go side by side.
std::size_t side_by_side(const std::string& ensemble, const std::vector<std::string>& settings = {}) {
  const Problem problem = with("[ensemble]\n" + ensemble + "\n", settings);
  const auto results = run_side_by_side(problem, {});
  return static_cast<std::size_t>(
      std::ranges::count_if(results, [](const auto& result) { return result.has_value(); }));
}

struct Beside {
  std::size_t side_by_side = 0, crossings = 0, stopped = 0;
};

/// Members of a problem beside runs of each alone.
Beside expect_same_as_alone(const Problem& problem) {
  Beside counted;
  const std::vector<std::string> names = figure_names(member_problem(problem, 0));
  const auto stopped = std::ranges::find(names, "stopped/t") - names.begin();
  const auto together = run_all(problem, names);
  const auto beside = run_side_by_side(problem, names);
  for (std::size_t m = 0; m < together.size(); ++m) {
    INFO("member " << m);
    const MemberResult expected = *run_all(alone(problem, m), names).front();
    CHECK(same(*together[m], expected));
    if (beside[m]) {
      CHECK(same(*beside[m], expected));
      CHECK(expected.status == ExitStatus::done);
      ++counted.side_by_side;
      counted.crossings += expected.series.empty() ? 0 : expected.series.front().size();
      counted.stopped += stopped < std::ssize(names) && expected.figures[stopped] == expected.figures[stopped] ? 1 : 0;
    }
  }
  return counted;
}

}  // namespace

TEST_CASE("members side by side are the runs of their problems, bit by bit") {
  for (const std::string composition : {"golden", "blanes-moan-4"}) {
    for (const std::string laws : {"1", "false"}) {
      INFO(composition << ", laws " << laws);
      const Beside found =
          expect_same_as_alone(with(starts, {"scheme.composition=" + composition, "laws.every=" + laws}));
      // All others are left to those who run them alone: they run away, or K has no value.
      CHECK(found.side_by_side > 10);
      CHECK(found.side_by_side < 45);
    }
  }
}

TEST_CASE("what is not the same bit by bit is told apart") {
  MemberResult one;
  one.figures = {1.0, std::nan("")};
  one.states = {{0.5}, {0.25}};
  one.series = {{1.0, 2.0}, {}};
  CHECK(same(one, one));
  const auto changed = [&one](const auto& change) {
    MemberResult other = one;
    change(other);
    return !same(one, other);
  };
  CHECK(changed([](MemberResult& other) { other.status = ExitStatus::failed; }));
  CHECK(changed([](MemberResult& other) { other.message = "why"; }));
  CHECK(changed([](MemberResult& other) { other.figures[0] = std::nextafter(1.0, 2.0); }));
  CHECK(changed([](MemberResult& other) { other.figures[1] = 0.0; }));
  CHECK(changed([](MemberResult& other) { other.states[1][0] = std::nextafter(0.25, 0.0); }));
  CHECK(changed([](MemberResult& other) { other.series[0][1] = std::nextafter(2.0, 0.0); }));
  CHECK(changed([](MemberResult& other) { other.series[1].push_back(0.0); }));
}

TEST_CASE("members side by side find the crossings that they find alone") {
  const std::string moderate = R"toml([ensemble]
random = { count = 40, seed = 3, initial.x = "uniform(-0.2, 0.2)", initial.v = "uniform(-0.3, 0.3)" }
)toml";
  for (const std::string composition : {"golden", "blanes-moan-4"}) {
    // Zeros of both directions and of one, of formulas that come near to zero without passing it, in one step twice.
    const std::vector<std::string> settings = {
        "scheme.composition=" + composition,
        "events.left={ crossing = \"x\", quantities = [\"y\", \"v\"] }",
        "events.down={ crossing = \"u + v/3 - k/20\", direction = \"down\" }",
        "events.near={ crossing = \"y^2 - 2e-6\" }",
        "events.far={ crossing = \"2 + sin(x)\" }",
    };
    INFO(composition);
    const Beside found = expect_same_as_alone(with(moderate, settings));
    CHECK(found.side_by_side == 40);
    CHECK(found.crossings > 40 * 3);
    CHECK(found.stopped == 0);
    // The twin: crossings of another step are not these.
    const Problem problem = with(moderate, settings);
    const std::vector<std::string> names = figure_names(member_problem(problem, 0));
    CHECK_FALSE(same(run_side_by_side(problem, names).front()->series.front(),
                     run_side_by_side(with(moderate, {"scheme.step=0.05000000000000001", settings[1]}), names)
                         .front()
                         ->series.front()));

    // Runs that end with one: with the third crossing, where a condition holds, some of them at the start.
    std::vector<std::string> ends = settings;
    ends[1] = "events.third={ crossing = \"x\", stop = 3 }";
    ends[2] = "events.out={ crossing = \"y > 0.25 + v\", stop = true }";
    const Beside ended = expect_same_as_alone(with(moderate, ends));
    CHECK(ended.side_by_side > 20);
    CHECK(ended.side_by_side < 40);
    CHECK(ended.stopped > 20);
  }
}

TEST_CASE("members side by side have steps, times and parameters of their own") {
  for (const std::string grid : {R"(initial.t = "-1:1:7")", R"(scheme.step = "0.02:0.07:7")",
                                 R"(scheme.until = "3:9:7")", R"(parameters.k = [0.5, 1], initial.y = "-0.1:0.2:4")",
                                 R"(scheme.until = "5:9:4", scheme.step = [0.05, 0.1], parameters.k = [0.5, 1])"}) {
    for (const std::string event : {"events.none=x - 100", "events.left={ crossing = \"x\", quantities = [\"t\"] }"}) {
      INFO(grid << ", " << event);
      const Problem problem = with("[ensemble]\ngrid = { " + grid + " }\n", {"scheme.until=7", event});
      CHECK(expect_same_as_alone(problem).side_by_side == problem.ensemble->members());
    }
  }
  // The twin: members next to each other are not the same.
  const Problem problem = with("[ensemble]\ngrid = { scheme.step = \"0.02:0.07:7\" }\n");
  const auto results = run_side_by_side(problem, figure_names(member_problem(problem, 0)));
  CHECK_FALSE(same(*results[2], *results[3]));
}

TEST_CASE("which members go side by side") {
  CHECK(side_by_side("grid = { initial.y = [0.1, -0.2, 3e-2, 0] }") == 4);
  CHECK(side_by_side("grid = { initial.y = \"0:0.2:3\", initial.u = \"0:0.2:3\" }") == 9);
  CHECK(side_by_side("grid = { initial.y = [0.1, \"k/10\", \"0.2\", \"sin(0)\"] }") == 4);
  CHECK(side_by_side("grid = { scheme.step = [0.1, 0.05, 0.2, 0.01] }") == 4);
  // Of each H so many that it pays; where no two have the same, nobody looks again.
  CHECK(side_by_side("grid = { parameters.k = [0.1, 0.2], initial.y = [0.1, 0.2, 0.3, 0.05] }") == 8);
  CHECK(side_by_side("grid = { parameters.k = [0.1, 0.2, 0.3], initial.y = [0.1, 0.2, 0.3] }") == 0);
  CHECK(side_by_side("grid = { parameters.k = \"0.1:0.3:20\" }") == 0);
  const std::string four = "grid = { initial.y = [0.1, 0.2, 0.3, 0.05] }";
  CHECK(side_by_side(four) == 4);
  CHECK(side_by_side(four, {"events.top=v"}) == 4);
  CHECK(side_by_side(four, {"events.top=v - t/10"}) == 0);
  CHECK(side_by_side(four, {"scheme.levels=variable"}) == 0);
  CHECK(side_by_side(four, {"scheme.lagrangian=midpoint"}) == 0);
  CHECK(side_by_side(four, {"output.interval=1"}) == 0);
  CHECK(side_by_side(four, {"exact.x=sin(t)"}) == 0);
  CHECK(side_by_side(four, {"laws.every=3"}) == 0);
  CHECK(side_by_side(four, {"scheme.max_steps=100"}) == 0);  // each shows why it ends
  CHECK(side_by_side("grid = { scheme.lagrangian = [\"splitting\", \"midpoint\"], initial.y = \"0:0.3:4\" }") == 4);
}

TEST_CASE("numbers as they are usually written") {
  for (const std::string text : {"0", "-0.0", "1.25", "-1e-3", "12", "2.5E+7", "100000000000000"}) {
    INFO(text);
    const Value value = read_document("value = " + text, "");
    const auto number = plain_number(text);
    REQUIRE(number);
    CHECK(*number == read_number(value.table()->front().value, "", {}));
    CHECK(std::signbit(*number) == std::signbit(read_number(value.table()->front().value, "", {})));
  }
  for (const std::string text : {"", "-", "-0", "007", "1_000", ".5", "5.", "1.e3", "+1", "inf", "nan", "0x10", "1e999",
                                 "\"1\"", "1 ", "12345678901234567890", "true", "[1]"}) {
    INFO(text);
    CHECK_FALSE(plain_number(text));
  }
}

TEST_CASE("an ensemble whose members go side by side is interrupted, continued and checked") {
  const Folder folder;
  const Problem problem = with(starts, {"ensemble.random.count=300", "scheme.until=300"});
  const EnsembleOutcome one = run_ensemble(problem, {.output = folder / "one.h5", .threads = 1});
  CHECK(one.finished == 300);
  const EnsembleOutcome three = run_ensemble(problem, {.output = folder / "three.h5", .threads = 3});
  CHECK(different_datasets(folder / "one.h5", folder / "three.h5") == run_tests::Names{});
  const std::string file = folder / "stopped.h5";
  EnsembleOutcome outcome;
  std::size_t stops = 0;
  do {
    const std::size_t before = outcome.finished;
    outcome = interrupt_after(40, problem, file, before == 0, stops < 2 ? 1 : 2);
    stops += outcome.status == ExitStatus::interrupted ? 1 : 0;
    REQUIRE(outcome.finished > before);
  } while (outcome.finished < 300);
  CHECK(stops > 1);
  CHECK(outcome.finished == 300);
  CHECK(different_datasets(folder / "one.h5", file) == run_tests::Names{});
  const EnsembleOutcome checked = check_ensemble(file);
  CHECK(checked.compared ==
        300 * (5 + one.summary.size() + 4));  // number, status, verdict, two entries, figures, q and p
  CHECK(checked.status == ExitStatus::done);

  // Halted, they are nobody's result.
  const std::vector<std::string> names = figure_names(member_problem(problem, 0));
  Desk desk(300);
  desk.halts = true;
  const std::vector<std::size_t> numbers = {0, 1, 2};
  for (const auto& result : MemberLanes::make(problem, names)->run(numbers, desk)) {
    CHECK_FALSE(result);
  }
}
