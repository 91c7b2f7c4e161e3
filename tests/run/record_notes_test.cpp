// What a page needs to know of a record's problem: the order of its fields, and how much of a residual is rounding.

#include <cmath>
#include <filesystem>

#include <catch2/catch.hpp>

#include <rubato/run/record_notes.hpp>
#include <rubato/run/run.hpp>

#include "record/sample.hpp"

using namespace rubato;

namespace {

/// The record of a problem, run into a folder of its own.
class Run {
public:
  explicit Run(const rubato::Problem& problem) : reader_(make(problem, folder_ / "record.h5")) {}

  [[nodiscard]] rubato::RecordNotes notes() const { return rubato::notes_on(reader_); }
  [[nodiscard]] double largest(const std::string& dataset) const {
    double largest = 0.0;
    for (const double value : reader_.read(dataset)) {
      largest = std::isfinite(value) ? std::max(largest, std::abs(value)) : largest;
    }
    return largest;
  }

private:
  static record::Reader make(const rubato::Problem& problem, const std::filesystem::path& file) {
    REQUIRE(rubato::run(problem, {.output = file.string()}).status == rubato::ExitStatus::done);
    return record::Reader(file);
  }

  sample::Folder folder_;
  record::Reader reader_;
};

rubato::Problem wave(const std::string& S, const std::string& amplitude = "1") {
  return rubato::parse_problem(R"toml(
title = "a wave"
[multisymplectic]
fields = ["v", "w", "u"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = ")toml" + S + R"toml("
[parameters]
A = )toml" + amplitude + R"toml(
[grid]
x = { from = -10, to = 10, cells = 101 }
[initial]
u = "A*exp(-x^2)"
v = "0"
[scheme]
lagrangian = "box"
levels = "fixed"
step = 0.05
until = 3
)toml",
                               "wave.toml");
}

}  // namespace

TEST_CASE("rounding is told from a violation of a law") {
  // S quadratic: energy and momentum hold in every cell but for rounding (theory, section 5).
  const Run linear(wave("(v^2 - w^2)/2 + u^2/2"));
  const auto levels = linear.notes().rounding;
  for (const std::string law : {"energy", "momentum"}) {
    CAPTURE(law);
    const double level = levels.at("/laws/" + law + "_max"), size = linear.largest("/laws/" + law + "_max");
    CHECK(size > 0.0);
    CHECK(size < level);
    CHECK(level < 1000.0 * size);  // an order of magnitude or two, and not any large number
    CHECK(levels.at("/laws/fields/" + law) == level);
    CHECK(levels.at("/laws/" + law + "_rms") == level);
  }
  // S of the fourth order: the law of energy is met to O(h²).
  const Run curved(wave("(v^2 - w^2)/2 + u^4/4"));
  CHECK(curved.largest("/laws/energy_max") > 1e6 * curved.notes().rounding.at("/laws/energy_max"));
}

TEST_CASE("the level of rounding scales as the law does") {
  const double one = Run(wave("(v^2 - w^2)/2 + u^2/2")).notes().rounding.at("/laws/energy_max");
  const double scaled = Run(wave("(v^2 - w^2)/2 + u^2/2", "1000")).notes().rounding.at("/laws/energy_max");
  CHECK(scaled == Approx(1e6 * one).epsilon(0.01));  // z enters squared; rounding differs from run to run
}

TEST_CASE("invariants of an orbit have a level of rounding") {
  const Run kepler(rubato::read_problem("kepler", std::vector<std::string>{"scheme.until=20"}));
  const auto levels = kepler.notes().rounding;
  const double level = levels.at("/laws/angular_momentum");
  CHECK(level > 1e-17);
  CHECK(level < 1e-13);
  CHECK(levels.at("/levels/energy") < 1e-13);
  CHECK(levels.at("/levels/node_energy") == levels.at("/levels/energy"));
}

TEST_CASE("the unknown of an equation comes before what follows from it") {
  const auto first = [](const std::string& name, std::vector<std::string> settings) {
    return Run(rubato::read_problem(name, settings)).notes().fields;
  };
  using Names = std::vector<std::string>;
  CHECK(first("sine-gordon", {"scheme.until=0.2", "grid.x.cells=41"}) == Names{"u", "v", "w"});
  CHECK(first("kdv", {"scheme.until=0.02", "grid.x.cells=61"}) == Names{"u", "phi", "v", "w"});
  // Declared as velocity, slope, unknown, without an exact solution.
  CHECK(Run(wave("(v^2 - w^2)/2 + 1 - cos(u)")).notes().fields == Names{"u", "v", "w"});
}
