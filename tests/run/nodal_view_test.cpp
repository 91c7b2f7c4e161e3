// Fields that a scheme of differences has between nodes: output, quantities and errors are of the nodes.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "folder.hpp"

using namespace rubato;
using Catch::Contains;
using rubato::tests::Folder;

namespace {

/// A standing wave on 0 ≤ x ≤ 2π, u = cos(x + φ) cos(√2 t), with its slope given, too.
std::string wave(const std::string& phase, const std::string& walls, const std::string& scheme, int cells) {
  return fmt::format(
      "[field]\nequation = \"u_tt = u_xx - u\"\n[grid]\nx = {{ from = 0, to = \"2*pi\", cells = {2}{1} }}\n"
      "[exact]\nu = \"cos(x + {0})*cos(sqrt(2)*t)\"\nu_x = \"-sin(x + {0})*cos(sqrt(2)*t)\"\n"
      "[scheme]\n{3}\nlevels = \"fixed\"\nstep = {4:.17g}\nuntil = 1\n[output]\ntimes = [1]\n"
      "[output.quantities]\nslope = \"u_x\"\nmean = \"integral(u_x*cos(x))\"\n",
      phase, walls, cells, scheme, 2.0 / cells);
}

struct Errors {
  double field = 0.0, output = 0.0, quantity = 0.0, state = 0.0;
};

Errors errors_of(const std::string& text, double phase) {
  const Folder folder;
  const std::string file = folder / "wave.h5";
  const Outcome outcome = run(parse_problem(text, "t.toml"), {.output = file, .threads = 1});
  REQUIRE(outcome.status == ExitStatus::done);
  CHECK(check(file).status == ExitStatus::done);
  const record::Reader reader(file);
  const std::vector<double> x = reader.read("/grid/x");
  const auto distance = [&](const std::string& name) {
    const std::vector<double> values = reader.read(name);
    REQUIRE(values.size() >= x.size());
    double largest = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double exact = -std::sin(x[i] + phase) * std::cos(std::numbers::sqrt2);
      largest = std::max(largest, std::abs(values[values.size() - x.size() + i] - exact));
    }
    return largest;
  };
  const auto& errors = outcome.statistics.errors;
  const auto of_slope = std::ranges::find(errors, "u_x", [](const auto& error) { return error.name; });
  REQUIRE(of_slope != errors.end());
  return {of_slope->value.largest(), distance("/output/u_x"), distance("/output/quantities/slope"),
          distance("/states/u_x")};
}

}  // namespace

TEST_CASE("u_x of a scheme of differences is that of its node, of order 2; its states are half a cell off") {
  struct Case {
    std::string scheme, walls;
    double phase;
  };
  const double right_angle = 0.5 * std::numbers::pi;
  const std::string leapfrog = "lagrangian = \"leapfrog\"";
  for (const auto& [scheme, walls, phase] :
       {Case{leapfrog, "", 0.3}, Case{"lagrangian = \"splitting\"\nspace = \"differences\"", "", 0.3},
        Case{leapfrog, ", left = \"free\", right = \"free\"", 0.0},
        Case{leapfrog, ", left = \"fixed\", right = \"fixed\"", right_angle}}) {
    INFO(scheme << walls);
    const auto at = [&](int cells) {
      return errors_of(wave(fmt::format("{:.17g}", phase), walls, scheme, cells), phase);
    };
    const Errors coarse = at(20), middle = at(40), fine = at(80);
    for (const auto error : {&Errors::field, &Errors::output, &Errors::quantity}) {
      CHECK(std::log2(coarse.*error / middle.*error) == Approx(2.0).margin(0.2));
      CHECK(std::log2(middle.*error / fine.*error) == Approx(2.0).margin(0.1));
    }
    // The twin: what is stored of the levels is the difference to the next node.
    CHECK(std::log2(middle.state / fine.state) == Approx(1.0).margin(0.1));
  }
}
