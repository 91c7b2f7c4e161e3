// Members of an ensemble that go side by side in vectors.

#include <catch2/catch.hpp>

#include <atomic>
#include <chrono>
#include <cmath>
#include <string>
#include <thread>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/study/document.hpp>
#include <rubato/study/ensemble.hpp>
#include <rubato/study/ensemble_lanes.hpp>
#include <rubato/study/reader.hpp>

#include "study/problem_texts.hpp"
#include "study/records.hpp"

using namespace rubato;
using namespace rubato::study;
using namespace rubato::study_tests;

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

bool go_side_by_side(const std::string& ensemble, const std::vector<std::string>& settings = {}) {
  return MemberLanes::make(with("[ensemble]\n" + ensemble + "\n", settings), {}) != nullptr;
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

  std::vector<std::optional<MemberResult>> results;
  bool halts = false;

private:
  std::size_t taken_ = 0;
};

bool same(const std::vector<double>& a, const std::vector<double>& b) {
  return std::ranges::equal(a, b, [](double x, double y) { return x == y || (x != x && y != y); });
}

}  // namespace

TEST_CASE("members side by side are the runs of their problems, bit by bit") {
  for (const std::string composition : {"golden", "blanes-moan-4"}) {
    for (const std::string laws : {"1", "false"}) {
      const Problem problem = with(starts, {"scheme.composition=" + composition, "laws.every=" + laws});
      const std::vector<std::string> names = figure_names(member_problem(problem, 0));
      const auto lanes = MemberLanes::make(problem, names);
      REQUIRE(lanes != nullptr);
      Desk desk(45);
      run_members(problem, names, desk);
      std::size_t side_by_side = 0, different = 0;
      for (std::size_t first = 0; first < 45; first += lanes->width()) {
        std::vector<std::size_t> numbers;
        for (std::size_t m = first; m < std::min<std::size_t>(first + lanes->width(), 45); ++m) {
          numbers.push_back(m);
        }
        const auto results = lanes->run(numbers, desk);
        for (std::size_t i = 0; i < numbers.size(); ++i) {
          const std::size_t m = numbers[i];
          INFO(composition << ", laws " << laws << ", member " << m);
          // By itself: an ensemble of one.
          Problem one = problem;
          one.ensemble->values = {problem.ensemble->values[m]};
          Desk alone(1);
          run_members(one, names, alone);
          const MemberResult& expected = *alone.results[0];
          CHECK(desk.results[m]->status == expected.status);
          CHECK(desk.results[m]->message == expected.message);
          CHECK(same(desk.results[m]->figures, expected.figures));
          CHECK(desk.results[m]->states == expected.states);
          if (results[i]) {
            ++side_by_side;
            CHECK(expected.status == ExitStatus::done);
            CHECK(same(results[i]->figures, expected.figures));
            CHECK(results[i]->states == expected.states);
            different += results[i]->states == alone.results[0]->states ? 0 : 1;
          } else {
            // All others are left to those who run them alone, and some of these have a reason.
            CHECK((expected.status != ExitStatus::done || laws == "1"));
          }
        }
      }
      CHECK(different == 0);
      CHECK(side_by_side > 10);
      CHECK(side_by_side < 45);
    }
  }
}

TEST_CASE("which members go side by side") {
  CHECK(go_side_by_side("grid = { initial.y = [0.1, -2, 3e-2] }"));
  CHECK(go_side_by_side("grid = { initial.y = \"0:1:3\", initial.u = \"0:1:3\" }"));
  CHECK_FALSE(go_side_by_side("grid = { initial.y = [0.1, \"k\"] }"));
  CHECK_FALSE(go_side_by_side("grid = { initial.t = [0.1, 0.2] }"));
  CHECK_FALSE(go_side_by_side("grid = { parameters.k = [0.1, 0.2] }"));
  CHECK_FALSE(go_side_by_side("grid = { initial.y = [0.1, 0.2] }", {"scheme.levels=variable"}));
  CHECK_FALSE(go_side_by_side("grid = { initial.y = [0.1, 0.2] }", {"scheme.lagrangian=midpoint"}));
  CHECK_FALSE(go_side_by_side("grid = { initial.y = [0.1, 0.2] }", {"events.top=v"}));
  CHECK_FALSE(go_side_by_side("grid = { initial.y = [0.1, 0.2] }", {"output.interval=1"}));
  CHECK_FALSE(go_side_by_side("grid = { initial.y = [0.1, 0.2] }", {"exact.x=sin(t)"}));
  CHECK_FALSE(go_side_by_side("grid = { initial.y = [0.1, 0.2] }", {"laws.every=3"}));
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
  CHECK(different_datasets(folder / "one.h5", folder / "three.h5") == study_tests::Names{});
  const std::string file = folder / "stopped.h5";
  EnsembleOutcome outcome;
  std::size_t stops = 0;
  for (int attempt = 0; attempt < 100; ++attempt) {
    std::atomic<bool> stop = false;
    std::jthread clock([&stop] {
      std::this_thread::sleep_for(std::chrono::milliseconds(8));
      stop = true;
    });
    const RunOptions options{.output = file, .threads = 2, .interrupt = &stop};
    outcome = attempt == 0 ? run_ensemble(problem, options) : resume_ensemble(file, options);
    if (outcome.status != ExitStatus::interrupted) {
      break;
    }
    ++stops;
  }
  if (outcome.status == ExitStatus::interrupted) {  // on a machine too slow for the clock above
    outcome = resume_ensemble(file);
  }
  CHECK(stops > 0);
  CHECK(outcome.finished == 300);
  CHECK(different_datasets(folder / "one.h5", file) == study_tests::Names{});
  const EnsembleOutcome checked = check_ensemble(file);
  CHECK(checked.compared == 300 * (4 + one.summary.size() + 4));  // number, status, two entries, figures, q and p
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
