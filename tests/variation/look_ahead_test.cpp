// The look-ahead for a step potential (theory, section 9): what it sees of η, for how many steps, on a scheme whose η
// is a given function of time.

#include <catch2/catch.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>
#include <vector>

#include <rubato/base/interrupt.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/variation/look_ahead.hpp>

using namespace rubato;

namespace {

/// A scheme of order s of which only η(t) is known: dK/dh = s(s+1) h^(s-1) η, η in the middle of the step.
class KnownEta final : public LevelScheme {
public:
  explicit KnownEta(std::function<double(double)> eta, double longest = infinity, std::size_t size = 1)
      : eta_(std::move(eta)), longest_(longest), size_(size) {}

  [[nodiscard]] Status advance(double h, double) override {
    ++tried;
    h_ = h;
    iterations_ += std::abs(h) > dear_from ? dear : 1;
    return std::abs(h) > longest_ ? Status::not_converged : Status::success;
  }
  [[nodiscard]] double discrete_energy() const override { return 1.0; }
  [[nodiscard]] formula::SumSize energy_size() override { return {.terms = 1.0}; }
  [[nodiscard]] double discrete_energy_slope() const override {
    return s * (s + 1.0) * std::pow(h_, s - 1) * eta_(time + 0.5 * h_);
  }
  [[nodiscard]] int order() const override { return s; }
  [[nodiscard]] NodeEnergy node() override { return {}; }
  [[nodiscard]] int iterations() const override { return iterations_; }
  void accept() override {
    all_iterations += std::exchange(iterations_, 0);
    time += h_;
  }
  void save(StateWriter& state) const override { state.write(std::vector<double>(size_, time)); }
  void restore(StateReader& state) override {
    for (std::size_t i = 0; i < size_; ++i) {
      time = state.read();
    }
  }

  int s = 2;
  double time = 5.0;
  int tried = 0, all_iterations = 0;
  double dear_from = infinity;  ///< a step longer than this takes so many iterations
  int dear = 1;

private:
  std::function<double(double)> eta_;
  double longest_;
  std::size_t size_;
  double h_ = 0.0;
  int iterations_ = 0;
};

constexpr double h = 0.01;

}  // namespace

TEST_CASE("A look-ahead takes no strides that cost more than they save") {
  KnownEta steady([](double) { return -2e-4; });
  steady.dear_from = 10.0 * h;
  steady.dear = 1000;
  const LookAhead seen = look_ahead(steady, h, false, 1e-13);
  CHECK(seen.duration >= 400.0 * h * (1.0 - 1e-9));
  // 1, 2, 4, 8 steps at once, then 16, once, which are dear; then 8, 46 times.
  CHECK(steady.all_iterations < 1100);
  KnownEta saving([](double) { return -2e-4; });
  saving.dear_from = 10.0 * h;
  saving.dear = 2;  // twice the iterations for twice the time, and less for more
  (void)look_ahead(saving, h, false, 1e-13);
  CHECK(saving.tried < 20);
}

TEST_CASE("A look-ahead sees 6400 first steps in a few where η stays, and goes back") {
  KnownEta steady([](double) { return -2e-4; });
  const LookAhead seen = look_ahead(steady, h, false, 1e-13);
  CHECK(seen.duration >= 6400.0 * h * (1.0 - 1e-9));
  CHECK(seen.eta.size() <= 18);  // 1 + 1 + 2 + 4 + … + 1024 first steps, and some more as long
  CHECK(seen.eta.front() == Approx(-2e-4));
  CHECK(seen.time.front() == Approx(0.5 * h));
  CHECK(steady.time == 5.0);
  // Where it changes as fast as first steps resolve, the steps are those.
  KnownEta fast([](double t) { return std::sin(0.5 * t / h); });
  const std::size_t taken = look_ahead(fast, h, false, 1e-13).eta.size();
  CHECK(taken >= 400);
  CHECK(taken <= 500);  // a little longer where a peak happens to be at the end
  // Backward in time it is the same.
  KnownEta backward([](double) { return -2e-4; });
  CHECK(look_ahead(backward, -h, false, 1e-13).eta.size() == seen.eta.size());
}

TEST_CASE("A look-ahead that set out from a peak of η goes on until it sees the next one") {
  // Peaks a hundredth as wide as they are apart, 20000 first steps.
  const double period = 20000.0 * h;
  const auto eta = [period](double t) {
    const double x = std::sin(std::numbers::pi * (t - 5.0) / period) * 100.0;
    return 1.0 / (1.0 + x * x);
  };
  KnownEta peaks(eta);
  const LookAhead seen = look_ahead(peaks, h, false, 1e-13);
  CHECK(seen.duration > period);
  CHECK(seen.eta.size() < 400);
  const double later =
      *std::ranges::max_element(seen.eta.begin() + static_cast<std::ptrdiff_t>(seen.eta.size() / 2), seen.eta.end());
  CHECK(later == Approx(1.0).epsilon(0.02));  // changes by at most a twentieth a step near the top
  for (std::size_t i = 0; i < seen.eta.size(); ++i) {
    REQUIRE(seen.eta[i] == Approx(eta(5.0 + seen.time[i])));
  }
  // The twin: a state so large that 400 steps have to do is left where they end.
  KnownEta large([](double t) { return 1.0 / (1.0 + 1e4 * std::pow(std::sin(0.5 * (t - 5.0) / h), 2)) / (t - 4.0); },
                 infinity, 1000);
  CHECK(look_ahead(large, h, false, 1e-13).eta.size() == 400);
}

TEST_CASE("A look-ahead's long steps are those that can be taken; its first decides whether there is one") {
  KnownEta stiff([](double) { return 1.0; }, 3.0 * h);
  const LookAhead seen = look_ahead(stiff, h, false, 1e-13);
  CHECK(seen.duration >= 400.0 * h * (1.0 - 1e-9));
  CHECK(seen.eta.size() >= 200);
  CHECK(seen.eta.size() <= 230);  // now and then four first steps are tried, and two follow
  CHECK(stiff.tried <= 1.2 * static_cast<double>(seen.eta.size()));
  KnownEta never([](double) { return 1.0; }, 0.5 * h);
  CHECK(look_ahead(never, h, false, 1e-13).eta.empty());
  KnownEta one([](double) { return 1.0; });
  CHECK(look_ahead(one, h, true, 1e-13).eta.size() == 1);
}

TEST_CASE("A look-ahead takes no strides that pass over the motion") {
  // (s+1)|η|h² is a thousandth of K in a first step, and a tenth in one of ten.
  KnownEta coarse([](double) { return 1e-3 / (3.0 * h * h); });
  const LookAhead seen = look_ahead(coarse, h, false, 1e-13);
  CHECK(seen.eta.size() >= 100);  // 8 first steps each
  CHECK(seen.eta.size() <= 104);
}

TEST_CASE("At order 4 a look-ahead looks no longer than it takes to see what repeats, or that K tells nothing") {
  const auto size_of = [](double period, double eta) {
    KnownEta swinging([=](double t) { return eta * std::cos(2.0 * std::numbers::pi * (t - 5.0) / period); });
    swinging.s = 4;
    return look_ahead(swinging, h, false, 1e-13).duration / h;
  };
  const double eta = 1e-6 / (5.0 * std::pow(h, 4));
  CHECK(size_of(6.0 * h, eta) == Approx(16.0));
  CHECK(size_of(11.0 * h, eta) == Approx(32.0));
  CHECK(size_of(40.0 * h, eta) == Approx(128.0).margin(8.0));
  CHECK(size_of(300.0 * h, eta) >= 400.0);  // not seen to turn four times
  // Where K shows nothing, as of 1e-15, it sees hundreds of times as much in strides, unless they cost as much as first
  // steps, or cannot be taken.
  CHECK(size_of(40.0 * h, 1e-9 * eta) > 6400.0);
  for (const bool is_dear : {true, false}) {
    KnownEta none([eta](double) { return 1e-6 * eta; }, is_dear ? infinity : 3.0 * h);
    none.s = 4;
    none.dear_from = is_dear ? 3.0 * h : infinity;
    none.dear = 5;
    CHECK(look_ahead(none, h, false, 1e-13).duration < 40.0 * h);
    CHECK(none.all_iterations < 40);
  }
  // Where K does not depend on the step it looks to the end of the run, in strides.
  KnownEta exact([](double) { return 0.0; });
  exact.s = 4;
  CHECK(look_ahead(exact, h, false, 1e-13, 1e5 * h).duration >= 1e5 * h);
  CHECK(exact.all_iterations < 400);
  // No farther than it is told to, strides included.
  KnownEta none([](double) { return 0.0; });
  none.s = 4;
  const double seen = look_ahead(none, h, false, 1e-13, 1e5 * h, 777.0 * h).duration;
  CHECK(seen <= 777.0 * h * (1.0 + 1e-9));
  CHECK(seen > 776.0 * h);
  // The twin: at order 2, where steps may follow, all of it is looked at.
  KnownEta second([](double t) { return std::cos(t / h); });
  CHECK(look_ahead(second, h, false, 1e-13).duration >= 400.0 * h * (1.0 - 1e-9));
}

TEST_CASE("a look-ahead that comes far in few strides goes on to what happens later") {
  // Of order 2: η is 1, and 400 times that in a peak as wide as 40 steps, beyond the 400 first steps that are seen at
  // least.
  const auto with_peak_at = [](double steps) {
    KnownEta peak([=](double t) { return 1.0 + 400.0 * std::exp(-std::pow((t - 5.0 - steps * h) / (20.0 * h), 2)); });
    return look_ahead(peak, h, false, 1e-13);
  };
  const LookAhead near = with_peak_at(300.0), far = with_peak_at(1000.0);
  CHECK(near.largest_eta() > 300.0);
  CHECK(far.largest_eta() > 300.0);
  CHECK(far.eta.size() < 400);
  // The twin: where strides are as short as the first step it has seen enough with the 400.
  KnownEta wavy([](double t) { return 2.0 + std::sin(t / h); });
  CHECK(look_ahead(wavy, h, false, 1e-13).duration < 450.0 * h);
}

TEST_CASE("A look-ahead does not look beyond a blow-up") {
  /// K has terms that grow by 10⁴⁰ with every step.
  class Exploding final : public LevelScheme {
  public:
    [[nodiscard]] Status advance(double step, double) override {
      h_ = step;
      return Status::success;
    }
    [[nodiscard]] double discrete_energy() const override { return terms_; }
    [[nodiscard]] formula::SumSize energy_size() override { return {.terms = terms_}; }
    [[nodiscard]] double discrete_energy_slope() const override { return terms_ * h_; }
    [[nodiscard]] NodeEnergy node() override { return {}; }
    [[nodiscard]] int iterations() const override { return 1; }
    void accept() override { terms_ *= 1e40; }
    void save(StateWriter& state) const override { state.write(terms_); }
    void restore(StateReader& state) override { terms_ = state.read(); }

  private:
    double h_ = 0.0, terms_ = 1.0;
  };
  Exploding scheme;
  const LookAhead seen = look_ahead(scheme, h, false, 1e-13);
  CHECK(seen.eta.size() == 3);  // terms of 1, 1e40 and 1e80
  CHECK(seen.energy_size == Approx(1e80));
}

TEST_CASE("a look-ahead that is interrupted leaves the scheme where it stood") {
  std::atomic<bool> asked = false;
  int seen = 0;
  KnownEta scheme([&](double) {
    asked = ++seen == 5;
    return 1.0 + 0.5 * std::sin(0.1 * seen);
  });
  const double start = scheme.time;
  {
    const Interruptible here(&asked);
    CHECK_THROWS_AS(look_ahead(scheme, 0.01, false, 1e-13), Interrupted);
  }
  CHECK(seen == 5);
  CHECK(scheme.time == start);
  // The twin: outside of its scope the flag ends nothing.
  seen = 0;
  asked = false;
  CHECK(look_ahead(scheme, 0.01, false, 1e-13).eta.size() > 5);
}
