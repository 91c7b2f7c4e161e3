// Zeros of functions along a run: each one once, to rounding, in its direction.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <vector>

#include <rubato/variation/clear_of_zero.hpp>
#include <rubato/variation/crossing.hpp>

using namespace rubato;

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

struct Run {
  std::vector<double> t;
  std::vector<int> direction;
  int undefined = 0, jumps = 0;
  int asked = 0;  ///< values between levels
};

using Function = std::function<double(double)>;

/// Over steps of length h from `start`. With `slope`, rates are known.
Run follow(const Function& g, const Function& slope, double start, double h, int steps,
           Direction wanted = Direction::both) {
  Run run;
  CrossingSearch search(wanted);
  search.begin(g(start));
  for (int k = 0; k < steps; ++k) {
    const double t = start + k * h;
    const auto sample = [&](double fraction) -> CrossingSearch::Sample {
      const double at = fraction == 1.0 ? start + (k + 1) * h : t + fraction * h;
      return {fraction, g(at), slope ? h * slope(at) : none};
    };
    const auto between = [&](double fraction) {
      ++run.asked;
      return sample(fraction);
    };
    for (const Crossing& crossing : search.follow(h, sample(0.0), sample(1.0), between)) {
      if (crossing.jump) {
        ++run.jumps;
        continue;
      }
      run.t.push_back(t + crossing.fraction * h);
      run.direction.push_back(static_cast<int>(crossing.direction));
    }
    run.undefined += search.undefined() ? 1 : 0;
  }
  return run;
}

const double pi = std::acos(-1.0);

}  // namespace

TEST_CASE("zeros of an oscillation are found once each, to rounding", "[variation]") {
  for (const bool rates : {true, false}) {
    const Function slope = rates ? Function([](double t) { return std::cos(t); }) : Function();
    const Run both = follow([](double t) { return std::sin(t); }, slope, -1.0, 0.37, 100);
    REQUIRE(both.t.size() == 12);  // from -1 to 36
    for (std::size_t i = 0; i < both.t.size(); ++i) {
      const double expected = pi * static_cast<double>(i);
      // The place in the step, of length 0.37, to four roundings; sin to one.
      CHECK(std::abs(both.t[i] - expected) < 1e-15 + 4e-16 * expected);
      CHECK(both.direction[i] == (i % 2 == 0 ? 1 : -1));
    }
    CHECK(follow([](double t) { return std::sin(t); }, slope, -1.0, 0.37, 100, Direction::up).t.size() == 6);
    CHECK(follow([](double t) { return std::sin(t); }, slope, -1.0, 0.37, 100, Direction::down).t.size() == 6);
    // Few values between levels: some for each crossing, none elsewhere.
    CHECK(both.asked < 10 * 12);
  }
}

TEST_CASE("two crossings within a step are found", "[variation]") {
  for (const bool rates : {true, false}) {
    for (const double depth : {0.3, 0.03, 1e-3, 1e-6}) {
      if (depth < 1e-4 && !rates) {
        continue;  // a parabola is not as near as that
      }
      // Below zero around π/2 + 2πn for 2 acos(1 - depth): in steps of 0.5 for 2 √(2 depth) at least.
      const auto g = [depth](double t) { return 1.0 - depth - std::sin(t); };
      const Function slope = rates ? Function([](double t) { return -std::cos(t); }) : Function();
      const Run run = follow(g, slope, 0.0, 0.5, 1000);
      INFO(depth << " " << rates);
      CHECK(run.t.size() == 2 * 79 + (std::fmod(500.0, 2.0 * pi) > pi / 2.0 + std::acos(1.0 - depth) ? 2 : 0));
      // A twin that does not come to zero.
      const Run above = follow([depth](double t) { return 1.0 + depth - std::sin(t); }, slope, 0.0, 0.5, 1000);
      CHECK(above.t.empty());
    }
  }
}

TEST_CASE("a zero at a level is one crossing, and one that is touched is none", "[variation]") {
  // Levels at the multiples of 1/4, all exact.
  const auto line = [](double t) { return t - 1.0; };
  const auto one = [](double) { return 1.0; };
  for (const Function& slope : {Function(one), Function()}) {
    const Run run = follow(line, slope, 0.0, 0.25, 8);
    CHECK(run.t == std::vector<double>{1.0});
    CHECK(run.direction == std::vector<int>{1});
    CHECK(follow(line, slope, 1.0, 0.25, 8).t.empty());  // the start is none
    CHECK(follow(line, slope, 0.0, 0.25, 4).t.empty());  // nor the end: whether it is passed is not known yet
    CHECK(follow(line, slope, 0.0, 0.25, 5).t.size() == 1);
    // The start reported with rounding.
    CHECK(follow([](double t) { return t - 1.0 - 1e-16; }, slope, 1.0, 0.25, 8).t.empty());
    CHECK(follow([](double t) { return t - 1.0 - 1e-8; }, slope, 1.0, 0.25, 8).t.size() == 1);
  }
  const auto touch = [](double t) { return (t - 1.0) * (t - 1.0); };
  CHECK(follow(touch, {}, 0.0, 0.25, 8).t.empty());
  CHECK(follow([&](double t) { return -touch(t); }, {}, 0.0, 0.25, 8).t.empty());
  CHECK(follow([&](double t) { return touch(t) - 1.0 / 64.0; }, {}, 0.0, 0.25, 8).t.size() == 2);
  // Zero for a while, and then on: crossed where it leaves.
  const auto rests = [](double t) { return t < 1.0 ? t - 1.0 : t > 2.0 ? t - 2.0 : 0.0; };
  CHECK(follow(rests, {}, 0.0, 0.25, 12).t == std::vector<double>{2.0});
  CHECK(follow([](double) { return 0.0; }, {}, 0.0, 0.25, 8).t.empty());
}

TEST_CASE("a zero that is left at the start and passed again within the step is found, or known to be missed",
          "[variation]") {
  // t (r - t): up at 0, down at r. A search looks at g where it turns, r/2, unless that is next to the start.
  struct Case {
    double r;
    Direction wanted;
    bool found, missed;
  };
  const auto [r, wanted, found, missed] =
      GENERATE(values<Case>({{0.3, Direction::down, true, false},
                             {1e-5, Direction::down, false, true},
                             {1e-5, Direction::both, false, true},
                             {1e-5, Direction::up, false, false},    // not asked for
                             {-0.3, Direction::down, false, false},  // it goes on in the direction that it starts in
                             {1e-5 + 1.0, Direction::down, false, false}}));  // not yet
  INFO(r);
  CrossingSearch search(wanted);
  search.begin(0.0);
  const auto g = [r = r](double t) -> CrossingSearch::Sample { return {t, t * (r - t), r - 2.0 * t}; };
  CHECK(search.follow(1.0, g(0.0), g(1.0), g).size() == (found ? 1U : 0U));
  CHECK(search.left_and_returned() == missed);
  // It is of the first step alone.
  const auto next = [&](double t) -> CrossingSearch::Sample { return {t, g(1.0 + t).value, g(1.0 + t).rate}; };
  search.follow(1.0, next(0.0), next(1.0), next);
  CHECK_FALSE(search.left_and_returned());
}

TEST_CASE("poles and what is not a number are no crossings, and are told", "[variation]") {
  const Run pole = follow([](double t) { return 1.0 / (t - 1.03); }, {}, 0.0, 0.25, 8);
  CHECK(pole.t.empty());
  CHECK(pole.jumps + pole.undefined == 1);
  const Run step = follow([](double t) { return t < 1.03 ? -1.0 : 2.0; }, {}, 0.0, 0.25, 8);
  CHECK(step.t.empty());
  CHECK(step.jumps == 1);
  // A steep zero is one: continuous, if only just.
  CHECK(follow([](double t) { return std::cbrt(t - 1.03); }, {}, 0.0, 0.25, 8).t.size() == 1);
  CHECK(follow([](double t) { return std::tanh(1e9 * (t - 1.03)); }, {}, 0.0, 0.25, 8).t.size() == 1);
  const Run root = follow([](double t) { return std::sqrt(t - 1.03) - 0.5; }, {}, 0.0, 0.25, 8);
  CHECK(root.undefined == 5);  // the steps that begin before 1.03
  CHECK(root.t.size() == 1);   // at 1.28, where it is defined
}

TEST_CASE("a search goes on where another one was", "[variation]") {
  const auto g = [](double t) { return std::sin(t) + 0.3 * std::sin(3.1 * t); };
  const double h = 0.31;
  CrossingSearch whole, first, second;
  whole.begin(g(0.0));
  first.begin(g(0.0));
  for (int k = 0; k < 60; ++k) {
    const auto at = [&](double fraction) { return CrossingSearch::Sample{fraction, g((k + fraction) * h)}; };
    CrossingSearch& part = k < 23 ? first : second;
    if (k == 23) {
      StateWriter state;
      first.save(state);
      StateReader reader{std::span<const double>(state.values())};
      second.restore(reader);
      CHECK(reader.done());
    }
    const auto& expected = whole.follow(h, at(0.0), at(1.0), at);
    const auto& found = part.follow(h, at(0.0), at(1.0), at);
    REQUIRE(found.size() == expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      CHECK(found[i].fraction == expected[i].fraction);
    }
  }
}

TEST_CASE("where a function is clear of zero, nothing is looked for", "[variation]") {
  // The rule without what the cubic is off the line by.
  const auto careless = [](double from, double, double to, double) {
    return from * to > 0.0 && std::min(std::abs(from), std::abs(to)) > 0.26 * std::abs(to - from);
  };
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  int clear = 0, looked_at = 0, wrong = 0, careless_wrong = 0, far = 0;
  for (int i = 0; i < 20000; ++i) {
    const double level = 3.0 * unit(random), from = level + 0.5 * unit(random), to = level + 0.5 * unit(random);
    const double size = std::exp2(4.0 * unit(random));
    const double rate_0 = size * unit(random), rate_1 = size * unit(random), change = to - from;
    double least = std::min(from, to), most = std::max(from, to);
    for (int k = 1; k < 400; ++k) {
      const double s = k / 400.0;
      const double value =
          from + s * (rate_0 + s * (3.0 * change - 2.0 * rate_0 - rate_1 + s * (rate_0 + rate_1 - 2.0 * change)));
      least = std::min(least, value);
      most = std::max(most, value);
    }
    // Nearer to zero than a fourth of how much it varies, as CrossingSearch asks of the cubic.
    const bool near = least * most <= 0.0 || std::min(std::abs(least), std::abs(most)) < 0.25 * (most - least);
    const bool says = is_clear_of_zero(from, rate_0, to, rate_1);
    clear += says ? 1 : 0;
    wrong += says && near ? 1 : 0;
    careless_wrong += careless(from, rate_0, to, rate_1) && near ? 1 : 0;
    far += std::min(std::abs(least), std::abs(most)) > most - least && !near ? 1 : 0;
    if (says) {
      // In its first step a search does not ask whether it is clear.
      CrossingSearch search;
      search.begin(from);
      const auto& found = search.follow(1.0, {0.0, from, rate_0}, {1.0, to, rate_1}, [&](double fraction) {
        ++looked_at;
        return CrossingSearch::Sample{fraction, from};
      });
      CHECK(found.empty());
    }
  }
  CHECK(wrong == 0);
  CHECK(looked_at == 0);
  CHECK(careless_wrong > 100);  // the twin
  CHECK(clear > 0.9 * far);     // and it is not so by saying no
  CHECK(far > 2000);
  for (const double odd : {none, std::numeric_limits<double>::infinity()}) {
    CHECK(is_clear_of_zero(1.0, 0.0, 1.0, 0.0));
    CHECK_FALSE(is_clear_of_zero(odd, 0.0, 1.0, 0.0));
    CHECK_FALSE(is_clear_of_zero(1.0, odd, 1.0, 0.0));
    CHECK_FALSE(is_clear_of_zero(1.0, 0.0, odd, 0.0));
    CHECK_FALSE(is_clear_of_zero(1.0, 0.0, 1.0, odd));
  }
  CHECK_FALSE(is_clear_of_zero(0.0, 0.0, 0.0, 0.0));
  CHECK_FALSE(is_clear_of_zero(1.0, 0.0, -1.0, 0.0));
}

TEST_CASE("five crossings within one step are found", "[variation]") {
  const auto g = [](double t) { return t * (t * t * (t * t - 0.5) + 0.05); };
  const auto slope = [](double t) { return t * t * (5.0 * t * t - 1.5) + 0.05; };
  // t² = 0.25 ± sqrt(0.0125)
  const double inner = std::sqrt(0.25 - std::sqrt(0.0125)), outer = std::sqrt(0.25 + std::sqrt(0.0125));
  const Run run = follow(g, slope, -1.0, 2.0, 1);
  REQUIRE(run.t.size() == 5);
  const double zeros[] = {-outer, -inner, 0.0, inner, outer};
  for (std::size_t i = 0; i < 5; ++i) {
    CHECK(std::abs(run.t[i] - zeros[i]) < 1e-14);  // rounding of g by its slope there, 0.05 to 0.36
    CHECK(run.direction[i] == (i % 2 == 0 ? 1 : -1));
  }
  const auto raised = [&](double t) { return g(t) + 0.5; };  // the twin: one zero
  CHECK(follow(raised, slope, -1.0, 2.0, 1).t.size() == 1);
}
