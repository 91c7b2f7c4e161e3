// S(z, x, t) from problem files: media that vary in space, and driven lattices.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

std::string refusal_of_junction(const std::vector<std::string>& settings) {
  try {
    static_cast<void>(make_lattice(read_problem("josephson-junction", settings)));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

const figures::Named<Spread>& named(const std::vector<figures::Named<Spread>>& all, std::string_view name) {
  const auto found = std::ranges::find(all, name, &figures::Named<Spread>::name);
  REQUIRE(found != all.end());
  return *found;
}

/// Ω of a series that is c + A cos(Ωt + φ), from r(t+τ) + r(t-τ) = 2 cos(Ωτ) r(t) + constant by least squares.
double frequency_of(const std::vector<double>& r, double tau) {
  double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
  for (std::size_t i = 1; i + 1 < r.size(); ++i) {
    const double sum = r[i + 1] + r[i - 1];
    n += 1.0;
    x += r[i];
    y += sum;
    xx += r[i] * r[i];
    xy += r[i] * sum;
  }
  return std::acos(0.5 * (n * xy - x * y) / (n * xx - x * x)) / tau;
}

}  // namespace

TEST_CASE("a condensate in a trap sloshes with omega and breathes with 2 omega") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Outcome ran = run_problem("trapped-condensate", file,
                                  {"scheme.until=7", "scheme.composition=blanes-moan-4", "scheme.step=0.02"});
  REQUIRE(ran.status == ExitStatus::done);
  {
    const record::Reader reader(file);
    const std::size_t rows = reader.rows("/output/t");
    const auto place = reader.read("/output/quantities/place", 0, rows);
    const auto size = reader.read("/output/quantities/size", 0, rows);
    // Order 4 at h = 0.02: 1e-7 a period, beyond what 1e-4 asks for.
    CHECK(frequency_of(place, 0.1) == Approx(1.0).epsilon(1e-4));
    CHECK(frequency_of(size, 0.1) == Approx(2.0).epsilon(1e-4));
    CHECK(*std::ranges::max_element(size) > 1.5 * *std::ranges::min_element(size));
  }
  // The momentum that the trap gives and takes is of the order of the mass. Its balance sees aliasing here, as the law
  // of charge does: 1.2e-2 and 4e-4 on 64 cells, 8e-4 and 1.3e-5 on 81, and 9e-5 and 6e-6 on 97, where the step shows.
  const auto& residuals = ran.statistics.residuals;
  CHECK(named(residuals, "momentum_balance_x").value.largest() < 2e-3);
  CHECK(named(residuals, "charge").value.largest() < 1e-4);
  CHECK(ran.statistics.totals.front().name == "momentum_balance_x");
  CHECK(ran.statistics.totals.front().value.max() > 0.5);
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  CHECK(differences(ran, checked) == Names{});
}

namespace {

/// A condensate on a line that sloshes in a trap, which ends at ±R.
const std::string trap = R"toml(title = "T"
[multisymplectic]
fields = ["p", "q", "v", "w"]
M = [["p", "q", -1]]
K.x = [["p", "v", 0.5], ["q", "w", 0.5]]
S = "x^2/4*density + density^2/2 - (v^2 + w^2)/4"
[definitions]
density = "p^2 + q^2"
[parameters]
R = 16
[grid]
x = { from = "-R", to = "R", cells = 384 }
[initial]
p = "exp(-0.6*(x - 1)^2)"
q = 0
[scheme]
lagrangian = "splitting"
levels = "fixed"
step = 0.05
until = 1.2
)toml";

struct Balance {
  double residual, change;  ///< the rms of its residual, and how much momentum itself changed
};

Balance balance_of_trap(const std::vector<std::string>& settings) {
  const Folder folder;
  const Outcome ran = run(parse_problem(trap, "t.toml", settings), {.output = folder / "a.h5"});
  REQUIRE(ran.status == ExitStatus::done);
  return {named(ran.statistics.residuals, "momentum_balance").value.rms(), ran.statistics.totals.front().value.max()};
}

/// The order that two halvings of the step show.
double order_of_balance(const std::vector<std::string>& scheme, double h, double halving = 2.0) {
  std::array<double, 2> residuals{};
  for (std::size_t k = 0; k < 2; ++k) {
    std::vector<std::string> settings = scheme;
    settings.push_back(fmt::format("scheme.step={}", h / std::pow(halving, static_cast<double>(k))));
    const Balance balance = balance_of_trap(settings);
    CHECK(balance.change > 0.5);  // of a mass of 1.6
    residuals[k] = balance.residual;
  }
  return std::log(residuals[0] / residuals[1]) / std::log(halving);
}

}  // namespace

TEST_CASE("the balance of momentum falls with the order of the scheme while momentum changes by its own size") {
  // 2.00, 3.99, 5.87 and, over a factor of the square root of 2, 7.86: from below, with the next order.
  CHECK(order_of_balance({"scheme.composition=verlet"}, 0.025) == Approx(2.0).margin(0.1));
  CHECK(order_of_balance({"scheme.composition=blanes-moan-4"}, 0.025) == Approx(4.0).margin(0.1));
  CHECK(order_of_balance({"scheme.composition=kahan-li-6"}, 0.05) == Approx(6.0).margin(0.3));
  CHECK(order_of_balance({"scheme.composition=kahan-li-8"}, 0.0353553, std::sqrt(2.0)) == Approx(8.0).margin(0.3));
  // Gauss's stages keep what is quadratic, as momentum is, with what S gives it at the stages: to rounding.
  for (const char* const stages : {"scheme.stages=1", "scheme.stages=3"}) {
    CHECK(balance_of_trap({"scheme.lagrangian=fourier", stages, "grid.x.cells=384"}).residual < 1e-12);
  }
  // Of cells, with the spacing halved as well.
  const auto box = [](const char* step, const char* cells) {
    return balance_of_trap({"scheme.lagrangian=box", step, cells, "parameters.R=8"}).residual;
  };
  CHECK(std::log2(box("scheme.step=0.1", "grid.x.cells=161") / box("scheme.step=0.05", "grid.x.cells=321")) ==
        Approx(2.0).margin(0.15));
  // The twin: a medium is periodic, and where a trap ends, S has a corner. What of the condensate reaches it is of no
  // order.
  CHECK(order_of_balance({"scheme.composition=blanes-moan-4", "parameters.R=5", "grid.x.cells=120"}, 0.025) < 2.0);
}

TEST_CASE("a fixed point that runs away to what is not finite is one that does not contract") {
  // The trap's force is 36 at its ends, and the iterates' cubes overflow: Newton's method takes these steps.
  for (const char* const stages : {"scheme.stages=2", "scheme.stages=3"}) {
    CHECK(
        balance_of_trap({"scheme.lagrangian=fourier", stages, "parameters.R=12", "grid.x.cells=288", "scheme.step=0.2"})
            .residual < 1e-12);
  }
  // The twin: what is not defined where the solution goes stays so.
  const std::string text = R"toml(title = "T"
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 - log(1.2 + u)"
[grid]
x = { from = 0, to = "2*pi", cells = 32 }
[initial]
u = "sin(x)"
v = -3
[scheme]
lagrangian = "fourier"
stages = 2
levels = "fixed"
step = 0.1
until = 3
)toml";
  const Folder folder;
  const Outcome ended = run(parse_problem(text, "t.toml"), {.output = folder / "a.h5"});
  CHECK(ended.status == ExitStatus::failed);
  CHECK_THAT(ended.message, Contains("undefined"));
}

TEST_CASE("the energy balance of a driven lattice holds on every step, and its record goes on bit by bit") {
  for (const std::vector<std::string>& scheme :
       {std::vector<std::string>{"scheme.lagrangian=box", "grid.x.cells=101"},
        std::vector<std::string>{"scheme.lagrangian=fourier", "grid.x.cells=64"},
        std::vector<std::string>{"scheme.lagrangian=fourier", "scheme.stages=2", "grid.x.cells=64"},
        std::vector<std::string>{"scheme.lagrangian=splitting", "scheme.composition=blanes-moan-4",
                                 "grid.x.cells=64"}}) {
    INFO(fmt::format("{}", fmt::join(scheme, " ")));
    const Folder folder;
    const std::string straight = folder / "straight.h5", stopped = folder / "stopped.h5";
    const auto until = [&](int t) {
      std::vector<std::string> settings = scheme;
      settings.insert(settings.end(), {"scheme.step=0.1", fmt::format("scheme.until={}", t)});
      return settings;
    };
    const Outcome ran = run_problem("josephson-junction", straight, until(6));
    REQUIRE(ran.status == ExitStatus::done);
    CHECK(ran.statistics.balance);
    CHECK(ran.statistics.off_law_steps == 0);
    // The tolerance, 1e-13, is relative to an energy of 16 η = 12.8.
    CHECK(ran.statistics.energy_deviation() <= 2e-12);
    REQUIRE(run_problem("josephson-junction", stopped, until(3)).status == ExitStatus::done);
    REQUIRE(resume(stopped, 6.0, {.threads = 1}).status == ExitStatus::done);
    CHECK(different_datasets(straight, stopped) == Names{});
    const Outcome checked = check(straight);
    CHECK(checked.status == ExitStatus::done);
    CHECK(differences(ran, checked) == Names{});
    falsify(straight, "/states/minus_work", 70, 1e-7);
    CHECK(check(straight).status == ExitStatus::contradiction);
  }
}

TEST_CASE("the work done on a driven lattice is the change of its energy") {
  // At the levels H(z, t) + minus_work keeps its value to the square of the step, while both change.
  const auto last = [](double step) {
    LatticeIntegrator lattice = make_lattice(
        read_problem("josephson-junction",
                     std::vector<std::string>{"scheme.levels=fixed", "scheme.until=6", "parameters.amplitude=0.2",
                                              fmt::format("scheme.step={}", step)}));
    const double start = lattice.node().energy;
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
    }
    double work = 0.0;
    const auto field = lattice.field(lattice.system().field("minus_work"));
    for (const double value : field) {
      work -= lattice.grid().cell_volume() * value;
    }
    return std::pair{work, lattice.node().energy - start};
  };
  const auto [work, coarse] = last(0.1);
  const auto [again, fine] = last(0.05);
  CHECK(std::abs(work) > 0.5);
  CHECK(std::abs(coarse) < 0.01 * std::abs(work));
  CHECK(coarse / fine == Approx(4.0).epsilon(0.1));
}

TEST_CASE("driven lattices converge with the order of their scheme") {
  // A junction (kicks), and a condensate in a trap that shakes (turns).
  const std::string condensate = R"toml(
[multisymplectic]
fields = ["p", "q", "v", "w"]
M = [["p", "q", -1]]
K.x = [["p", "v", 0.5], ["q", "w", 0.5]]
S = "(x - 0.5*sin(2*t))^2/4*(p^2 + q^2) + (p^2 + q^2)^2/4 - (v^2 + w^2)/4"
[grid]
x = { from = -8, to = 8, cells = 64 }
[initial]
p = "exp(-x^2/2)"
q = 0
[scheme]
step = 0.1
until = 1
)toml";
  struct Row {
    std::vector<std::string> scheme;
    int order;
    double step;
  };
  for (const Row& row :
       {Row{{"scheme.lagrangian=fourier"}, 2, 0.1}, Row{{"scheme.lagrangian=fourier", "scheme.stages=2"}, 4, 0.1},
        Row{{"scheme.lagrangian=splitting"}, 2, 0.1},
        Row{{"scheme.lagrangian=splitting", "scheme.composition=blanes-moan-4"}, 4, 0.2}}) {
    for (const bool turns : {false, true}) {
      INFO(row.scheme.back() << (turns ? ", condensate" : ", junction"));
      std::vector<std::vector<double>> ends;
      for (const double step : {row.step, row.step / 2, row.step / 4}) {
        std::vector<std::string> settings = row.scheme;
        settings.insert(settings.end(), {"grid.x.cells=64", "scheme.levels=fixed", "scheme.until=2",
                                         fmt::format("scheme.step={}", step)});
        LatticeIntegrator lattice = make_lattice(turns ? parse_problem(condensate, "t.toml", settings)
                                                       : read_problem("josephson-junction", settings));
        while (!lattice.finished()) {
          REQUIRE(lattice.step().status == Status::success);
        }
        const auto all = lattice.level().fields.all();
        ends.emplace_back(all.begin(), all.end());
      }
      const auto difference = [&](std::size_t i) {
        double largest = 0.0;
        for (std::size_t j = 0; j < ends[i].size(); ++j) {
          largest = std::max(largest, std::abs(ends[i][j] - ends[i + 1][j]));
        }
        return largest;
      };
      CHECK(std::log2(difference(0) / difference(1)) == Approx(row.order).margin(0.1 * row.order + 0.1));
    }
  }
}

TEST_CASE("what a lattice in space and time cannot have is refused with the reason") {
  CHECK_THAT(refusal_of_junction({"multisymplectic.S=(v^2 - w^2)/2 + y*u"}), Contains("y"));
  CHECK_THAT(
      refusal_of_junction({"parameters={ weakness = 0.3, amplitude = 0.02, frequency = 0.5, eta = 0.8, time = 2 }"}),
      Contains("\"time\" cannot name one of the pair"));
  CHECK_THAT(refusal_of_junction({"multisymplectic.S=v^2/2 - (1 + x^2)*w^2/2", "scheme.lagrangian=splitting"}),
             Contains("constant coefficients S depends on w"));
}
